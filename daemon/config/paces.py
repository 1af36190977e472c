"""Paces of a configuration: nothing may be older than what it guards."""

from __future__ import annotations

from collections.abc import Iterator

from abbe.daemon.config.channels import Channels, Key

_VALUE = 2.0
"""Looks that a value must be able to wait for."""
_CHANGE = 3.0
"""Looks that the change of a number must be able to wait for."""


def check_paces(channels: Channels) -> None:
    """Refuse what would count as stale before its next reading.

    Raises
    ------
    InputError
        The first channel that is read too rarely.
    """
    for channel, limit, name, cycle, looks in _limits(channels):
        pace = max(cycle, channels.info(channel).every)
        if limit < looks * pace:
            raise channels.source.error(
                f"values of {channel} come every {pace:g} s and would count as stale before the "
                "next",
                name,
                found=limit,
                expected=f"at least {looks * pace:g} s, or that it is read more often",
            )


def _limits(channels: Channels) -> Iterator[tuple[str, float, Key, float, float]]:
    """Each channel, what it may be old (s), where the file says so, the cycle's pace (s), looks.

    A value is as old as its last reading: two looks. A number that shows by its change that the
    device lives is as old as the look before the one that showed the change: three.
    """
    file = channels.file
    guard, controller, cycle = file.guard, file.controller, file.cycle
    stale: tuple[float, Key, float] = (
        guard.stale_after,
        ("guard", "stale_after"),
        cycle.period,
    )
    signals: tuple[float, Key, float] = (
        guard.signals_stale_after,
        ("guard", "signals_stale_after"),
        max(cycle.period, cycle.signals_every),
    )
    for axis in file.axes.values():
        yield axis.source, *stale, _VALUE
        if axis.direction is not None:
            yield axis.direction, *stale, _VALUE
    for key, looks in (("status", _VALUE), ("sample", _CHANGE), ("clock", _VALUE)):
        if (channel := getattr(controller, key)) is not None:
            yield channel, *stale, looks
    if controller.heartbeat is not None:
        within = controller.heartbeat_within
        where: Key = ("controller", "heartbeat_within")
        yield controller.heartbeat, within, where, cycle.period, _CHANGE
    for echo in file.output.echo:
        yield echo.source, *stale, _VALUE
    for signal in file.signals.values():
        if signal.source is not None:
            yield signal.source, *signals, _VALUE
    for channel in file.tool.sources or ():
        yield channel, *signals, _VALUE
