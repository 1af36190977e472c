"""Expected values of all that is read, and the channels' ranges, from the configuration."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from abbe.compcore.machine.machine import Signal
from abbe.compcore.machine.plausible import position_range, signal_range
from abbe.compcore.machine.structure import is_rotary
from abbe.daemon.config import Configuration
from abbe.daemon.config.channels import split, transducer_of
from abbe.daemon.config.sections.readings import SignalSection
from abbe.daemon.pipeline.reading.plausible import PlausibleBounds, SimilarSensors
from abbe.daemon.pipeline.reading.poll import Channel
from abbe.drivers.link import Link, Sample
from abbe.drivers.transducers import AnyTransducerConfig

HEARTBEATS = 1 << 16
"""Where the heartbeat begins again at 0, unless its channel holds less."""

_BEYOND = 15.0
"""K that a thermometer may show beyond what it showed when the machine was measured; more where it
ranged over more."""
_APART = 15.0
"""K that thermometers of one role may be apart, or what they were when the machine was measured if
that is more; twice as much where nobody knows what they were."""
_COMPARED = ("scale", "structure", "workpiece", "ambient", "air")
"""Roles whose thermometers are compared: motors, spindles and coolant may well be far apart."""
_REACH = 10_000.0
"""mm that a tool may be from the origin of a machine whose joints hold it."""
_FINEST = 1e-4
"""mm within which a position counts as the same as another: what a float32 resolves at 1 m."""
_FINEST_TURN = 5e-7
"""rad, likewise: what a float32 resolves at a turn."""


@dataclass(frozen=True)
class Expected:
    """The bounds of what is believed, and of what the channels can hold.

    Attributes
    ----------
    positions
        For each axis, least and greatest position, mm (rotary: rad).
    signals
        By signal.
    similar
        Sensors that are compared.
    tool
        For x, y and z, least and greatest offset, mm.
    steps
        For each target, the difference (mm; rotary: rad) up to which a position counts as what
        was written.
    read_back
        Channels that are written and can be read back.
    beats
        Where the heartbeat begins again at 0.
    """

    positions: tuple[tuple[float, float], ...]
    signals: Mapping[str, PlausibleBounds]
    similar: tuple[SimilarSensors, ...]
    tool: tuple[tuple[float, float], ...]
    steps: tuple[float, ...]
    read_back: tuple[Channel, ...]
    beats: int


def expected_of(
    configuration: Configuration, axes: Sequence[str], links: Mapping[str, Link]
) -> Expected:
    """What is expected of a configuration's channels; `links` need not be open."""
    file, machine = configuration.file, configuration.model.machine
    measured = configuration.model.measured_signals
    known = {name: machine.signals[name] for name in file.signals}
    written = written_axes(configuration, axes)
    return Expected(
        positions=tuple(_positions(configuration, axes)),
        signals={
            name: bounds_of(known[name], file.signals[name], measured.get(name)) for name in known
        },
        similar=tuple(_similar_sensors(known, measured)),
        tool=(_tool(configuration),) * 3,
        steps=tuple(_same_within(configuration, links, axis) for axis in written),
        read_back=tuple(_read_back(configuration, links)),
        beats=beats_of(links, file.output.heartbeat),
    )


def written_axes(configuration: Configuration, axes: Sequence[str]) -> list[str]:
    """Axes that are written, linear ones first, each in the compensator's order."""
    written = [axis for axis in axes if axis in configuration.file.output.axes]
    return sorted(written, key=is_rotary)


def bounds_of(
    signal: Signal, section: SignalSection, measured: tuple[float, float] | None = None
) -> PlausibleBounds:
    """What is believed of a signal.

    That is what the configuration says; else what its role allows and, for temperatures, is not far
    from where it was when the machine was measured.
    """
    allowed = signal_range(signal)
    low, high = allowed.low, allowed.high
    rate = section.max_rate or allowed.rate
    why = f", which is what a signal of role {signal.role} can be"
    if section.range:
        low, high = section.range
        why = " (range in the configuration)"
    elif measured and signal.temperature:
        margin = max(_BEYOND, measured[1] - measured[0])
        low, high = max(low, measured[0] - margin), min(high, measured[1] + margin)
        why = (
            f" ({measured[0]:g} to {measured[1]:g} when the machine was measured; if it can be "
            "more, give the signal a range)"
        )
    return PlausibleBounds(low, high, rate, signal.unit, why)


def beats_of(links: Mapping[str, Link], heartbeat: str | None) -> int:
    """Where the heartbeat begins again at 0: at 65536, or where its channel ends."""
    if heartbeat is None:
        return HEARTBEATS
    link, name = split(heartbeat)
    high = links[link].info(name).high
    return HEARTBEATS if high >= HEARTBEATS - 1 else int(high) + 1


def _positions(configuration: Configuration, axes: Sequence[str]) -> Iterator[tuple[float, float]]:
    for name in axes:
        axis = configuration.model.machine.axes[name]
        if axis.rotary:
            # one that turns for ever is counted on, for ever
            yield -math.inf, math.inf
        else:
            believed = position_range(axis)
            yield believed.low, believed.high


def _similar_sensors(
    known: Mapping[str, Signal], measured: Mapping[str, tuple[float, float]]
) -> Iterator[SimilarSensors]:
    groups: dict[tuple[str, str], list[str]] = {}
    for name, signal in known.items():
        if signal.temperature and signal.role in _COMPARED:
            groups.setdefault((signal.role, signal.unit), []).append(name)
    for (role, unit), names in groups.items():
        if len(names) > 1:
            ranges = [measured[name] for name in names if name in measured]
            apart = 2.0 * _APART
            if len(ranges) == len(names):
                spread = max(high for _, high in ranges) - min(low for low, _ in ranges)
                apart = max(_APART, spread)
            yield SimilarSensors(tuple(names), apart, role, unit)


def _tool(configuration: Configuration) -> tuple[float, float]:
    longest = configuration.file.tool.longest
    if longest is None:
        machine = configuration.model.machine
        if machine.structure.rotary and len(machine.structure.carrying) < len("XYZ"):
            # an arm's tool counts from the machine's origin: no travel says how far that is
            return -_REACH, _REACH
        axes = machine.axes.values()
        longest = max(a.travel[1] - a.travel[0] for a in axes if not a.rotary)
    return -longest, longest


def _same_within(configuration: Configuration, links: Mapping[str, Link], axis: str) -> float:
    file = configuration.file
    read, write = file.axes[axis], file.output.axes[axis]
    steps = _step(links, axis, read.source, read.transducer) + _step(
        links, axis, write.target, write.transducer
    )
    return max(0.51 * steps, _FINEST_TURN if is_rotary(axis) else _FINEST)


def _step(
    links: Mapping[str, Link], axis: str, channel: str, config: AnyTransducerConfig | None
) -> float:
    """What one step of a channel is, mm (rotary: rad)."""
    link, name = split(channel)
    info = links[link].info(name)
    step, transducer = info.step, transducer_of(axis, info.unit, config)
    if transducer is None or not step:
        return step
    first, second = (transducer.convert(Sample(v, 0.0)) for v in (0.0, step))
    way = abs(second.value - first.value)
    return way if math.isfinite(way) else 0.0


def _read_back(configuration: Configuration, links: Mapping[str, Link]) -> Iterator[Channel]:
    output = configuration.file.output
    axes = (section.target for section in output.axes.values())
    echo = (section.target for section in output.echo)
    for channel in (output.status, *axes, *echo, output.heartbeat):
        if channel is not None:
            link, name = split(channel)
            info = links[link].info(name)
            if info.read_back and info.every == 0.0:
                yield link, name
