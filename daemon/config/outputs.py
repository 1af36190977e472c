"""Checks of what is written: it can be, it is not what is read, and its channels can hold it."""

from __future__ import annotations

import math
from collections.abc import Iterator

from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.machine.structure import is_rotary
from abbe.daemon.config.channels import Channels, Key, split, transducer_of
from abbe.daemon.status_word import LARGEST, LARGEST_WITH_TURNS
from abbe.drivers.link import ChannelInfo, LinkConfigError, WirePlace
from abbe.drivers.transducers import SensorFaultError

PER_MM = {"mm": 1.0, "um": 1e3, "µm": 1e3}
"""Units of channels for ± of a correction, and how many are a mm."""
_FEWEST_BEATS = 4
"""A heartbeat that begins again sooner is not distinguished from one that stands still."""


def check_outputs(channels: Channels, machine: Machine) -> None:
    """Refuse outputs that cannot be written, or would be read again.

    Raises
    ------
    InputError
        The first that is wrong.
    """
    _check_guard(channels, machine)
    _check_axes(channels, machine)
    _check_writable(channels)
    _check_apart(channels)
    _check_messages(channels)
    _check_reported(channels, machine)
    _check_ranges(channels, machine)
    _check_one_sample(channels)


def _check_guard(channels: Channels, machine: Machine) -> None:
    """A largest correction for every direction in which the machine has an axis."""
    stated = channels.file.guard.max_correction.stated
    for letter in machine.structure.carrying or "XYZ":
        if letter not in stated:
            raise channels.source.error(
                "missing",
                ("guard", "max_correction", letter),
                expected=f"a key '{letter}'",
            )


def _check_axes(channels: Channels, machine: Machine) -> None:
    file = channels.file
    components: dict[str, str] = {}
    for name in file.output.axes:
        key: Key = ("output", "axes", name)
        if is_rotary(name):
            continue
        component = own_component(name)
        if component in components:
            raise channels.source.error(
                f"{components[component]} takes the correction in {component} already",
                key,
                found=name,
            )
        components[component] = name
    turned = [name for name in file.output.axes if is_rotary(name)]
    missing = [component for component in "XYZ" if component not in components]
    without = [letter for letter in "XYZ" if letter not in machine.structure.carrying]
    if turned and without:
        raise channels.source.error(
            f"a correction of {turned[0]} moves the tool's tip, and the machine has no axis that "
            "takes that back in " + ", ".join(without),
            ("output", "axes", turned[0]),
            expected="linear axes alone",
        )
    if turned and missing:
        raise channels.source.error(
            f"a correction of {turned[0]} moves the tool's tip, and nothing takes that back in "
            + ", ".join(missing),
            ("output", "axes", turned[0]),
            expected=" and ".join(f"[output.axes.{component}]" for component in missing),
        )


def _check_writable(channels: Channels) -> None:
    taken: dict[str, Key] = {}
    read = dict(channels.read())
    for channel, key in channels.written():
        link, name = channels.find(channel, key)
        if not channels.info(channel).writable:
            raise channels.source.error(
                f"channel {channel} cannot be written",
                key,
                expected=f"writable = true in [links.{link}.channels.{name}]",
            )
        if channel in taken:
            raise channels.source.error("written twice", key, found=channel)
        if channel in read:
            raise channels.source.error(
                "a channel that is read as a source would be overwritten", key, found=channel
            )
        taken[channel] = key


def _check_apart(channels: Channels) -> None:
    """No place that is written is read, or written under another name, through any link."""
    read = [(c, key, place) for c, key in channels.read() for place in _places(channels, c)]
    written: list[tuple[str, Key, WirePlace]] = []
    for channel, key in channels.written():
        for place in _places(channels, channel):
            for other, _, there in read:
                if place.overlaps(there):
                    same = place.space == there.space
                    hint = "" if same or not place.apart else _SEPARATE
                    raise channels.source.error(
                        f"{channel} would overwrite what is read as {other}"
                        + ("" if same else ": many devices keep one memory for both"),
                        key,
                        found=_where(channels, channel),
                        expected=f"another place than {_where(channels, other)}{hint}",
                    )
            for other, _, there in written:
                if place.overlaps(there):
                    raise channels.source.error(
                        f"{channel} and {other} are written to the same place",
                        key,
                        found=_where(channels, channel),
                    )
        written += [(channel, key, place) for place in _places(channels, channel)]


_SEPARATE = (
    ', or, if the device keeps them apart, that it is said: separate = ["tables"] in the link\'s '
    'section, "units" for units'
)


def _places(channels: Channels, channel: str) -> tuple[WirePlace, ...]:
    link, name = split(channel)
    return channels.links[link].places(name)


def _where(channels: Channels, channel: str) -> str:
    link, name = split(channel)
    return f"{channel} ({channels.links[link].channels[name]})"


def _check_messages(channels: Channels) -> None:
    """Status and heartbeat go out also when no position does: not in one message with one."""
    output = channels.file.output
    targets = {section.target for section in output.axes.values()}
    for key in ("status", "heartbeat"):
        if (channel := getattr(output, key)) is None:
            continue
        link, name = split(channel)
        for other in sorted(channels.links[link].goes_with(name)):
            if f"{link}.{other}" in targets:
                raise channels.source.error(
                    f"{channel} goes out in one message with the corrected position "
                    f"{link}.{other}, and must go out also when that is not known",
                    ("output", key),
                    found=channel,
                    expected="a channel in a message of its own",
                )


def _check_reported(channels: Channels, machine: Machine) -> None:
    """Whether the channels for how sure the correction is can hold it, and go out by themselves."""
    output = channels.file.output
    most = dict(zip("XYZ", channels.file.guard.vector, strict=True))
    for name, channel in output.plus_minus.items():
        key: Key = ("output", "plus_minus", name)
        linear = [a for a in output.axes if a in machine.axes and not is_rotary(a)]
        if name not in linear:
            raise channels.source.error(
                "no linear axis of that name is corrected",
                key,
                found=name,
                expected="one of " + (", ".join(linear) or "none"),
            )
        info = channels.info(channel)
        if info.unit not in PER_MM:
            raise channels.source.error(
                f"channel {channel} is "
                + (f"in {info.unit}" if info.unit else "of no stated unit"),
                key,
                expected='unit = "um" or unit = "mm" of the channel',
            )
        for value in (0.0, most[own_component(name)] * PER_MM[info.unit]):
            _check_holds(channels, channel, key, info, value)
    if output.outside is not None:
        info = channels.info(output.outside)
        for value in (0.0, 1.0):
            _check_holds(channels, output.outside, ("output", "outside"), info, value)
        if info.step not in (0.0, 1.0) or info.unit:
            raise channels.source.error(
                f"{output.outside} has to hold whole numbers",
                ("output", "outside"),
                found=_where(channels, output.outside),
                expected="a channel without scale and unit",
            )
    reported = {channel for channel, _ in channels.reported()}
    for channel, key in channels.reported():
        link, name = split(channel)
        for other in sorted(channels.links[link].goes_with(name)):
            if f"{link}.{other}" not in reported:
                raise channels.source.error(
                    f"{channel} goes out in one message with {link}.{other}, and is written at "
                    "another pace",
                    key,
                    found=channel,
                    expected="a channel in a message of its own",
                )


def _check_ranges(channels: Channels, machine: Machine) -> None:
    """Every channel can hold all that may be written to it."""
    file = channels.file
    most = dict(zip("XYZ", file.guard.vector, strict=True))
    for name, section in file.output.axes.items():
        if name not in machine.axes:
            continue
        rotary = is_rotary(name)
        turn = math.radians(file.guard.turn(name) or 0.0)
        reach = turn if rotary else most[own_component(name)]
        info = channels.info(section.target)
        transducer = transducer_of(name, info.unit, section.transducer)
        for end, more in zip(machine.axes[name].travel, (-reach, reach), strict=True):
            value = end + more
            if transducer is not None:
                try:
                    value = transducer.inverse(value)
                except SensorFaultError as error:
                    shown = f"{math.degrees(end + more):g} deg" if rotary else f"{end + more:g} mm"
                    raise channels.source.error(
                        f"{name} = {shown} cannot be written: {error}",
                        ("output", "axes", name, "transducer"),
                    ) from None
            _check_holds(channels, section.target, ("output", "axes", name, "target"), info, value)
    if file.output.status is not None:
        info = channels.info(file.output.status)
        turned = any(is_rotary(name) for name in file.output.axes)
        for value in (0.0, float(LARGEST_WITH_TURNS if turned else LARGEST)):
            _check_holds(channels, file.output.status, ("output", "status"), info, value)
    if file.output.heartbeat is not None:
        info = channels.info(file.output.heartbeat)
        for value in (0.0, float(_FEWEST_BEATS)):
            _check_holds(channels, file.output.heartbeat, ("output", "heartbeat"), info, value)
    for i, echo in enumerate(file.output.echo):
        info = channels.info(echo.target)
        for value in _ends(channels.info(echo.source)):
            _check_holds(channels, echo.target, ("output", "echo", i, "target"), info, value)


def _check_holds(
    channels: Channels, channel: str, key: Key, info: ChannelInfo, value: float
) -> None:
    slack = 0.5 * info.step
    if not info.low - slack <= value <= info.high + slack:
        unit = f" {info.unit}" if info.unit else ""
        raise channels.source.error(
            f"{channel} cannot hold {value:.10g}{unit}, which may have to be written",
            key,
            found=_where(channels, channel),
            expected=f"a type for more than {info.low:.10g} to {info.high:.10g}{unit}",
        )


def _ends(info: ChannelInfo) -> Iterator[float]:
    yield from (end for end in (info.low, info.high) if math.isfinite(end))


def _check_one_sample(channels: Channels) -> None:
    """Positions and the number that says of which sample they are come in one answer."""
    file = channels.file
    axes: dict[str, list[str]] = {}
    for section in file.axes.values():
        link, name = split(section.source)
        axes.setdefault(link, []).append(name)
    for i, echo in enumerate(file.output.echo):
        link, name = split(echo.source)
        if link not in axes:
            continue
        try:
            channels.links[link].keep_together((*axes[link], name), one_sample=True)
        except LinkConfigError as error:
            raise channels.source.error(str(error), ("output", "echo", i, "source")) from None
