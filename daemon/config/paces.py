"""Checks of how often things are read: nothing may be older than what it guards."""

from __future__ import annotations

from collections.abc import Iterator

from daemon.config.channels import Channels, Key


def check_paces(channels: Channels) -> None:
    """Refuse what would count as stale before its next reading.

    Raises
    ------
    InputError
        The first channel that is read too rarely.
    """
    for channel, limit, name, cycle in _limits(channels):
        pace = max(cycle, channels.info(channel).every)
        if limit < 2.0 * pace:
            raise channels.source.error(
                f"values of {channel} come every {pace:g} s and would count as stale before the "
                "next",
                name,
                found=limit,
                expected=f"at least {2.0 * pace:g} s, or that it is read more often",
            )


def _limits(channels: Channels) -> Iterator[tuple[str, float, Key, float]]:
    """Each channel, what it may be old (s), where the file says so, and the cycle's pace (s)."""
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
        yield axis.source, *stale
        if axis.direction is not None:
            yield axis.direction, *stale
    for key in ("status", "sample", "clock"):
        if (channel := getattr(controller, key)) is not None:
            yield channel, *stale
    if controller.heartbeat is not None:
        within = controller.heartbeat_within
        yield controller.heartbeat, within, ("controller", "heartbeat_within"), cycle.period
    for echo in file.output.echo:
        yield echo.source, *stale
    for signal in file.signals.values():
        yield signal.source, *signals
    for channel in file.tool.sources or ():
        yield channel, *signals
