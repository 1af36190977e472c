"""Notes on a configuration: allowed, but somebody should have decided it."""

from __future__ import annotations

from collections.abc import Iterator

from abbe.daemon.config.channels import WATCHED, split
from abbe.daemon.config.configuration import Configuration


def notes(configuration: Configuration) -> list[str]:
    """Remarks on a configuration that is in order, one sentence or two each."""
    return [
        *_on_the_controller(configuration),
        *_on_times(configuration),
        *_on_events(configuration),
    ]


def _on_the_controller(configuration: Configuration) -> Iterator[str]:
    controller, output = configuration.file.controller, configuration.file.output
    if not configuration.model.machine.structure.carrying:
        yield (
            "the machine has no axis X, Y or Z that could carry a correction: abbe run does not "
            "begin; abbe correct --command says where to send its axes"
        )
    if controller.heartbeat is None:
        yield (
            "controller.heartbeat is not set: a controller that stands still behind a gateway that "
            "lives is not noticed"
        )
    if controller.status is None or not controller.require:
        yield (
            "controller.status with require is not set: positions are believed before the machine "
            "is referenced"
        )
    if not output.axes:
        yield "there is no [output.axes]: no corrected position is written"
        return
    if (output.plus_minus or output.outside) and configuration.model.covariance is None:
        yield (
            "output.plus_minus and output.outside will always say that nothing is known: the model "
            "has no covariance (it was imported, typed in, or changed since it was fitted)"
        )
    if output.status is None:
        yield (
            "output.status is not set: the controller does not learn whether to use the corrected "
            "positions, nor that Abbe has ended"
        )
    if output.heartbeat is None:
        yield (
            "output.heartbeat is not set: the controller cannot tell that Abbe was killed, or that "
            "its cable was pulled"
        )


def _on_times(configuration: Configuration) -> Iterator[str]:
    file = configuration.file
    guard = file.guard
    positions = {split(axis.source)[0] for axis in file.axes.values()}
    watched = (getattr(file.controller, key) for key in WATCHED)
    positions |= {split(channel)[0] for channel in watched if channel is not None}
    signals = {split(s.source)[0] for s in file.signals.values() if s.source is not None}
    signals |= {split(channel)[0] for channel in file.tool.sources or ()}
    for name, setup in configuration.links.items():
        timeout = getattr(setup.config, "timeout", None)
        if not isinstance(timeout, int | float):
            continue
        if name in positions and timeout > guard.stale_after:
            yield _slow(name, timeout, "positions", "stale_after", guard.stale_after)
        elif name in signals and timeout > guard.signals_stale_after:
            yield _slow(name, timeout, "signals", "signals_stale_after", guard.signals_stale_after)


def _slow(link: str, timeout: float, what: str, key: str, limit: float) -> str:
    return (
        f"links.{link}.timeout = {timeout:g} s is longer than guard.{key} = {limit:g} s: {what} "
        "that come so late are stale and not used; a shorter one finds a dead device sooner"
    )


def _on_events(configuration: Configuration) -> Iterator[str]:
    if configuration.file.journal.file is None:
        yield "journal.file is not set: nobody can read afterwards what happened"
