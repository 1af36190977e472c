"""A run's status as Sparkplug metrics: names, types, values, qualities and moments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime
from typing import Any, Final, NamedTuple

GOOD, BAD, STALE = 192, 0, 500
"""Values of the property ``Quality`` (specification, 6.4.16)."""
INT64, DOUBLE, BOOLEAN, STRING = 4, 10, 11, 12
"""Data types (specification, 6.4.16)."""
REBIRTH: Final = "Node Control/Rebirth"
BD_SEQ: Final = "bdSeq"
_LONGEST = 10_000
"""Characters of a text."""

Value = float | int | bool | str | None


class MetricReading(NamedTuple):
    """One metric's value at one moment.

    Attributes
    ----------
    name
        With ``/`` between its levels.
    datatype
        Its number.
    value
        None: it has none.
    at
        ms since 1970: when it was so.
    quality
        `GOOD`, `STALE` or `BAD`.
    unit
        Of its value; empty: none.
    """

    name: str
    datatype: int
    value: Value
    at: int
    quality: int = GOOD
    unit: str = ""

    @property
    def says(self) -> tuple[Value, int]:
        """What makes it worth saying again."""
        return self.value, self.quality


def moment(text: str) -> int:
    """A moment of a run's JSON in ms since 1970."""
    return round(1000.0 * datetime.fromisoformat(text).timestamp())


def of_node(status: Mapping[str, Any], lost: int) -> Iterator[MetricReading]:
    """What the correction's own computer says: the cycle, the links, what was lost."""
    at = moment(status["at"])
    cycle = status["cycle"]
    yield MetricReading("Abbe/Version", STRING, status["abbe"], at)
    yield MetricReading("Abbe/Host", STRING, _text(status["owner"]["host"]), at)
    yield MetricReading("Cycle/Alive", BOOLEAN, status["alive"], at)
    yield MetricReading("Cycle/Median", DOUBLE, cycle["median_ms"], at, unit="ms")
    yield MetricReading("Cycle/P99", DOUBLE, cycle["p99_ms"], at, unit="ms")
    yield MetricReading("Cycle/Missed", INT64, cycle["missed"], at)
    for level in ("warning", "error"):
        count = status["event_counts"].get(level, 0)
        yield MetricReading(f"Events/Counted/{level}", INT64, count, at)
    yield MetricReading("Publishing/Lost", INT64, lost, at)
    for name, link in sorted(status["links"].items()):
        below = f"Links/{_text(name)}"
        yield MetricReading(f"{below}/State", STRING, link["state"], at)
        yield MetricReading(f"{below}/Requests Failed", INT64, link["failures"], at)
        yield MetricReading(f"{below}/Reconnects", INT64, link["reconnects"], at)


def of_event(event: Mapping[str, Any], number: int) -> Iterator[MetricReading]:
    """One event of the journal; together its metrics are one moment's."""
    at = moment(event["at"])
    yield MetricReading("Events/Text", STRING, _text(event["text"]), at)
    yield MetricReading("Events/Level", STRING, _text(event["level"]), at)
    yield MetricReading("Events/Part", STRING, _text(event["part"]), at)
    yield MetricReading("Events/Number", INT64, number, at)


def no_event(at: int) -> Iterator[MetricReading]:
    """The metrics of events before there was any: a birth names them all."""
    for name, datatype in (("Text", STRING), ("Level", STRING), ("Part", STRING)):
        yield MetricReading(f"Events/{name}", datatype, None, at)
    yield MetricReading("Events/Number", INT64, None, at)


def of_device(status: Mapping[str, Any]) -> Iterator[MetricReading]:
    """What is said of the machine: state, axes, signals, check points, switches, tool."""
    at = moment(status["at"])
    yield MetricReading("State/Text", STRING, _text(status["state"]), at)
    for name, key in (
        ("In Full", "in_full"),
        ("Computed In Full", "computed_in_full"),
        ("Writes", "writes"),
        ("Ending", "ending"),
    ):
        yield MetricReading(f"State/{name}", BOOLEAN, status[key], at)
    yield MetricReading("State/Status Word", INT64, status["status_word"]["word"], at)
    faults = (f"{what}: {why}" for what, why in sorted(status["faults"].items()))
    yield MetricReading("State/Faults", STRING, _text("; ".join(faults)), at)
    yield MetricReading("State/Outside Measured", STRING, _text("; ".join(status["beyond"])), at)
    for name, axis in sorted(status["axes"].items()):
        yield from _of_axis(f"Axes/{_text(name)}", axis, at)
    for name, signal in sorted(status["signals"].items()):
        quality, then = _aged(signal["value"], signal["stale"], signal["age_s"], at)
        unit = signal["unit"]
        yield MetricReading(f"Signals/{_text(name)}", DOUBLE, signal["value"], then, quality, unit)
    if (checks := status.get("checks")) is not None:
        yield MetricReading("Checks/Verdict", STRING, checks["verdict"], at)
        yield MetricReading("Checks/Counted", INT64, checks["checks"], at)
        yield MetricReading("Checks/Words", STRING, _text(" ".join(checks["words"])), at)
    for name, switch in sorted(status["switches"].items()):
        yield MetricReading(f"Compensations/{_text(name)}", STRING, switch, at)
    for name, value in zip("XYZ", status["tool_mm"], strict=True):
        yield MetricReading(f"Tool/{name}", DOUBLE, value, at, unit="mm")


def _of_axis(below: str, axis: Mapping[str, Any], at: int) -> Iterator[MetricReading]:
    quality, then = _aged(axis["indicated"], axis["stale"], axis["age_s"], at)
    unit = axis["unit"]
    yield MetricReading(f"{below}/Indicated", DOUBLE, axis["indicated"], then, quality, unit)
    if axis["guard"] is None:
        return
    # a position that is not to be believed has no corrected one; what is held is a correction still
    fair = GOOD if axis["corrected"] is not None else BAD
    yield MetricReading(f"{below}/Corrected", DOUBLE, axis["corrected"], then, fair, unit)
    unit = axis["correction_unit"]
    fair = GOOD if axis["correction"] is not None else BAD
    yield MetricReading(f"{below}/Correction", DOUBLE, axis["correction"], at, fair, unit)
    yield MetricReading(f"{below}/Uncertainty", DOUBLE, axis["uncertainty"], at, unit=unit)
    yield MetricReading(f"{below}/Guard", STRING, axis["guard"], at)
    yield MetricReading(f"{below}/Written", BOOLEAN, axis["written"], at)


def lives(status: Mapping[str, Any]) -> bool:
    """Whether the machine is there: the cycle goes round, and an axis has a sound position."""
    return status["alive"] and not all(axis["stale"] for axis in status["axes"].values())


def _aged(value: Value, stale: bool, age: float | None, at: int) -> tuple[int, int]:
    """Quality of a reading, and when it was taken."""
    if value is None:
        return BAD, at
    return STALE if stale else GOOD, at - round(1000.0 * (age or 0.0))


def _text(text: str) -> str:
    """A text that UTF-8 can hold, not too long."""
    return text[:_LONGEST].encode("utf-8", "replace").decode("utf-8")
