"""Metrics of a run for Prometheus, in its base units: seconds, metres, radians, degrees Celsius."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from prometheus_client import CollectorRegistry
from prometheus_client.metrics_core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
    StateSetMetricFamily,
)
from prometheus_client.registry import Collector

from abbe.daemon.status.run_status import RunStatus
from abbe.daemon.status_word import Status

_MICRO, _MILLI = 1e-6, 1e-3
_TURN = 0.017453292519943295
_GUARD = ("off", "rising", "active", "holding", "falling")
_LINK = ("closed", "connecting", "up", "degraded", "down")
_LEVELS = ("info", "warning", "error")


class RunCollector(Collector):
    """Metrics of the last status.

    Attributes
    ----------
    status
        What they are made of; None: the run says nothing.
    """

    def __init__(self) -> None:
        self.status: RunStatus | None = None

    def collect(self) -> Iterable[Metric]:
        """Every family, from one status."""
        status = self.status
        yield _gauge(
            "abbe_cycle_alive",
            "1 while the cycle goes round",
            [((), float(status is not None and status.alive))],
        )
        if status is None:
            return
        yield from _run(status)
        yield from _cycle(status)
        yield from _axes(status)
        yield from _signals(status)
        yield from _links(status)
        yield from _checks(status)


def registry(*collectors: Collector) -> CollectorRegistry:
    """A registry of these and no others."""
    made = CollectorRegistry(auto_describe=False)
    for collector in collectors:
        made.register(collector)
    return made


_Samples = Iterable[tuple[tuple[str, ...], float]]


def _gauge(name: str, words: str, samples: _Samples, labels: tuple[str, ...] = ()) -> Metric:
    family = GaugeMetricFamily(name, words, labels=labels)
    for values, number in samples:
        family.add_metric(values, number)
    return family


def _counter(name: str, words: str, samples: _Samples, labels: tuple[str, ...] = ()) -> Metric:
    family = CounterMetricFamily(name, words, labels=labels)
    for values, number in samples:
        family.add_metric(values, number)
    return family


def _run(status: RunStatus) -> Iterator[Metric]:
    files = {f"{file.role}_sha256": file.sha256 for file in status.files if file.role != "grid"}
    info = {"version": status.abbe, "machine": status.machine, **files}
    yield InfoMetricFamily("abbe_run", "What runs", value=info)
    yield _gauge(
        "abbe_start_time_seconds",
        "When the run began, since 1970",
        [((), status.owner.since.timestamp())],
    )
    yield _gauge(
        "abbe_corrected_in_full",
        "1 while every direction is corrected in full and the controller took it",
        [((), float(status.in_full))],
    )
    yield _gauge(
        "abbe_computed_in_full",
        "1 while every direction's correction is handed out in full, written or not",
        [((), float(status.computed_in_full))],
    )
    yield _gauge(
        "abbe_writes", "1 where corrected positions are written", [((), float(status.writes))]
    )
    yield _gauge(
        "abbe_status_bit",
        "Bits of the status word",
        [((str(b.name),), float(bool(status.status_word.word & b))) for b in Status],
        ("bit",),
    )
    yield _gauge(
        "abbe_fault",
        "1 for each fault that stands",
        [((w,), 1.0) for w in status.faults],
        ("what",),
    )
    yield _gauge(
        "abbe_outside_measured",
        "1 for each axis, signal and tool that is where the machine was never measured",
        [((w,), 1.0) for w in status.outside],
        ("what",),
    )
    yield _gauge(
        "abbe_file_differs",
        "1 where a file on disk is not what runs any more",
        [((f.role, f.path), float(f.differs)) for f in status.files],
        ("role", "path"),
    )
    yield _counter(
        "abbe_events",
        "Events of the journal",
        [((level,), float(status.event_counts.get(level.upper(), 0))) for level in _LEVELS],
        ("level",),
    )


def _cycle(status: RunStatus) -> Iterator[Metric]:
    cycle = status.cycle
    yield _counter("abbe_cycles", "Cycles since the start", [((), float(cycle.number))])
    yield _counter(
        "abbe_cycles_missed", "Cycles left out because one took longer", [((), float(cycle.missed))]
    )
    count = max([cycle.number, *cycle.within_ms.values()])
    buckets = [(f"{float(ms) * _MILLI:g}", float(n)) for ms, n in cycle.within_ms.items()]
    histogram = HistogramMetricFamily(
        "abbe_cycle_duration_seconds", "From the poll to the write-back"
    )
    histogram.add_metric((), [*buckets, ("+Inf", float(count))], sum_value=cycle.total_s)
    yield histogram
    yield _gauge(
        "abbe_cycle_period_seconds",
        "As configured; 0: as fast as the links answer",
        [((), cycle.period_ms * _MILLI)],
    )
    if cycle.age_s is not None:
        yield _gauge(
            "abbe_cycle_age_seconds", "Since the last cycle had positions", [((), cycle.age_s)]
        )
    if cycle.position_age_ms is not None:
        yield _gauge(
            "abbe_position_age_seconds",
            "Age of the oldest position when it was about to be written",
            [((), cycle.position_age_ms * _MILLI)],
        )


def _axes(status: RunStatus) -> Iterator[Metric]:
    linear = {n: a for n, a in status.axes.items() if a.unit == "mm"}
    rotary = {n: a for n, a in status.axes.items() if a.unit == "deg"}
    axis = ("axis",)
    for unit, axes, length, small in (
        ("meters", linear, _MILLI, _MICRO),
        ("radians", rotary, _TURN, _MICRO),
    ):
        if not axes:
            continue
        for name, words, values in (
            ("indicated", "As the controller has it", {n: a.indicated for n, a in axes.items()}),
            ("corrected", "Indicated + correction", {n: a.corrected for n, a in axes.items()}),
        ):
            yield _gauge(
                f"abbe_{name}_position_{unit}",
                f"{words}; not there where it is not to be believed",
                [
                    ((n,), length * value)
                    for n, value in values.items()
                    if value is not None and not axes[n].stale
                ],
                axis,
            )
        yield _gauge(
            f"abbe_correction_{unit}",
            "As handed out by the guard",
            [((n,), small * a.correction) for n, a in axes.items() if a.correction is not None],
            axis,
        )
    yield _gauge(
        "abbe_correction_uncertainty_meters",
        "Of the correction, k = 2",
        [((n,), _MICRO * a.uncertainty) for n, a in linear.items() if a.uncertainty is not None],
        axis,
    )
    yield _gauge(
        "abbe_axis_stale",
        "1 where an axis has no sound position",
        [((n,), float(a.stale)) for n, a in status.axes.items()],
        axis,
    )
    states = StateSetMetricFamily("abbe_guard_state", "What the guard does", labels=axis)
    for name, found in status.axes.items():
        if found.guard is not None:
            states.add_metric((name,), {state: state == found.guard for state in _GUARD})
    yield states


def _signals(status: RunStatus) -> Iterator[Metric]:
    signal = ("signal",)
    yield _gauge(
        "abbe_temperature_celsius",
        "Last good value; see abbe_signal_stale",
        [
            ((n,), s.value)
            for n, s in status.signals.items()
            if s.temperature and s.value is not None
        ],
        signal,
    )
    yield _gauge(
        "abbe_signal_value",
        "Last good value of what is no temperature, in its own unit",
        [
            ((n, s.unit), s.value)
            for n, s in status.signals.items()
            if not s.temperature and s.value is not None
        ],
        ("signal", "unit"),
    )
    yield _gauge(
        "abbe_signal_age_seconds",
        "Age of the last good value",
        [((n,), s.age_s) for n, s in status.signals.items() if s.age_s is not None],
        signal,
    )
    yield _gauge(
        "abbe_signal_stale",
        "1 where the value is not fresh and good",
        [((n,), float(s.stale)) for n, s in status.signals.items()],
        signal,
    )


def _checks(status: RunStatus) -> Iterator[Metric]:
    checks = status.checks
    if checks is None:
        return
    verdicts = StateSetMetricFamily("abbe_check_verdict", "What check measurements say")
    states = ("unknown", "sound", "changed")
    verdicts.add_metric((), {state: state == checks.verdict for state in states})
    yield verdicts
    yield _gauge("abbe_checks_recorded", "Checks that count", [((), float(checks.checks))])
    if checks.last is not None:
        yield _gauge(
            "abbe_check_last_time_seconds",
            "When the last check was, since 1970",
            [((), checks.last.timestamp())],
        )
    yield _gauge(
        "abbe_check_chart_ratio",
        "How full the fuller chart of a series is; 1 at its limit",
        [((n,), s.full) for n, s in checks.series.items()],
        ("series",),
    )
    for unit, ours in (("meters", "um"), ("radians", "urad")):
        found = [
            ((n,), _MICRO * s.surprise)
            for n, s in checks.series.items()
            if s.unit == ours and s.surprise is not None
        ]
        if found:
            yield _gauge(
                f"abbe_check_surprise_{unit}",
                "What the last check read beyond what was expected",
                found,
                ("series",),
            )
    yield _gauge(
        "abbe_check_refused",
        "1 for each check point whose last measurement was not recorded",
        [((n,), 1.0) for n in checks.refused],
        ("point",),
    )


def _links(status: RunStatus) -> Iterator[Metric]:
    link = ("link",)
    links = status.links
    states = StateSetMetricFamily("abbe_link_state", "What a link does", labels=link)
    for name, found in links.items():
        states.add_metric((name,), {state: state == found.state for state in _LINK})
    yield states
    yield _gauge(
        "abbe_link_state_seconds",
        "How long it has been in this state",
        [((n,), v.for_s) for n, v in links.items()],
        link,
    )
    yield _gauge(
        "abbe_link_round_trip_seconds",
        "Of the last request that was answered",
        [((n,), v.round_trip_ms * _MILLI) for n, v in links.items() if v.round_trip_ms is not None],
        link,
    )
    for key, words in (
        ("requests", "Requests sent"),
        ("failures", "Requests without a good answer"),
        ("reconnects", "Connections begun anew"),
    ):
        yield _counter(
            f"abbe_link_{key}",
            words,
            [((n,), float(getattr(v, key))) for n, v in links.items()],
            link,
        )
