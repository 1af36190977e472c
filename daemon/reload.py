"""Reload of a running service: which changes go in at once, and which need a new beginning.

Another model of the same machine, and other limits of the guard, are led in while the correction
stands: read, checked and folded beside what runs, then taken over between two cycles; what
``abbe switch`` had changed is as the file says again. Whatever changes wires (links, sources,
targets, paces, the machine's axes and signals) needs the correction to be ramped out and the
service to begin anew. What cannot be read changes nothing.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from abbe.daemon.config import Configuration, load_config
from abbe.daemon.config.identity import RunIdentity
from abbe.daemon.pipeline.compensate import LiveCompensator
from abbe.daemon.pipeline.reading.expected import Expected, expected_of

_LED_IN = ("max_correction", "max_norm", "max_rate", "max_turn", "max_turn_rate", "hold", "ramp")
"""Keys of ``[guard]`` that can change while the correction stands."""


class Takeover(enum.Enum):
    """What a reload comes to."""

    NOTHING = "nothing has changed"
    LED_IN = "the correction is led over"
    ANEW = "the wiring has changed: the correction is ramped to zero, then Abbe begins anew"


@dataclass(frozen=True)
class Prepared:
    """A configuration that was read beside the running one.

    Attributes
    ----------
    change
        What has to be done.
    configuration, identity
        The new one.
    compensation, expected
        For `Pipeline.change_model`; None where nothing is led in.
    """

    change: Takeover
    configuration: Configuration
    identity: RunIdentity
    compensation: LiveCompensator | None = None
    expected: Expected | None = None


def prepare(path: Path, running: Configuration, identity: RunIdentity) -> Prepared:
    """Read, check and fold what stands in the files now; changes nothing that runs.

    Parameters
    ----------
    path
        The configuration.
    running, identity
        What runs.

    Raises
    ------
    InputError
        When the new files are not in order.
    """
    new = load_config(path)
    found = RunIdentity.of(new)
    if found == identity and new.model.switches == running.model.switches:
        return Prepared(Takeover.NOTHING, new, found)
    same = (
        _wiring(new) == _wiring(running)
        and new.model.machine == running.model.machine
        and new.limits.turning == running.limits.turning
    )
    compensation = LiveCompensator(new.model, new.limits.turning)
    if not same or compensation.uses_directions != _uses_directions(running):
        return Prepared(Takeover.ANEW, new, found)
    expected = expected_of(new, compensation.axes, new.make_links())
    return Prepared(Takeover.LED_IN, new, found, compensation, expected)


def _uses_directions(configuration: Configuration) -> bool:
    return any(t.fitted and t.effect.directions_used() for t in configuration.model.terms)


def _wiring(configuration: Configuration) -> dict[str, Any]:
    """All of a configuration but what can be led in."""
    data = configuration.file.model_dump()
    del data["model"]
    for key in _LED_IN:
        del data["guard"][key]
    if configuration.file.tool.sources is None:
        del data["tool"]["offset"]
    return data
