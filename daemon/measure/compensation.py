"""The compensation that acts while a machine is measured: stated, recorded, and watched for."""

from __future__ import annotations

import asyncio
import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.files.model_file import load_model
from abbe.daemon.answers.measured_under import TURNS
from abbe.daemon.config import Configuration
from abbe.daemon.control.runs import found_runs, same_file
from abbe.daemon.ownership.claims import held_by_run

NONE = "none"
_LOOK_FOR_RUNS = 10.0
"""s between two looks at whether a correction runs."""
_HOW = (
    f'active = "{NONE}" in [measure] where it does not move the machine or change the positions '
    "that it indicates, else the model that it was made from"
)


def stated_compensation(
    configuration: Configuration, out: Path, given: Path | None = None
) -> dict[str, str]:
    """What a campaign's head says of the compensation that acts: its model and its SHA-256.

    Parameters
    ----------
    out
        The campaign, beside which the model is looked for later.
    given
        The model, in place of what the configuration says.

    Raises
    ------
    InputError
        When nobody has said it and there may be one; when the model is not of this machine.
    """
    stated = configuration.file.measure.active
    if given is not None:
        return _acting(configuration, given, out)
    if stated is None:
        if configuration.upload is not None:
            raise InputError(
                "whether tables are active in the controller is not stated",
                file=configuration.path,
                field="measure.active",
                expected=_HOW,
            )
        return {"active": NONE}
    if stated == NONE:
        return {"active": NONE}
    return _acting(configuration, configuration.path.parent / stated, out)


def _acting(configuration: Configuration, path: Path, out: Path) -> dict[str, str]:
    """What is said of a compensation that acts, made from a model."""
    model = load_model(path)
    structure = configuration.model.machine.structure
    if str(model.machine.structure) != str(structure):
        raise InputError(
            "the compensation of another machine",
            file=configuration.path,
            field="measure.active",
            found=str(model.machine.structure),
            expected=str(structure),
        )
    named = os.path.relpath(path.resolve(), out.resolve().parent)
    said = {"active": named, "active_sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
    turned = _turned(configuration)
    return said | ({TURNS: ", ".join(turned)} if turned else {})


def _turned(configuration: Configuration) -> Sequence[str]:
    """Rotary axes whose own angle the compensation corrects.

    Raises
    ------
    InputError
        For an axis that is none.
    """
    machine = configuration.model.machine
    stated = configuration.file.measure.active_turns
    if stated is not None:
        for axis in stated:
            if axis not in machine.structure.rotary:
                raise InputError(
                    "no such rotary axis",
                    file=configuration.path,
                    field="measure.active_turns",
                    found=axis,
                    expected="one of " + (", ".join(machine.structure.rotary) or "none"),
                )
        return stated
    if configuration.upload is None:
        return configuration.limits.turning
    holds = configuration.upload.make_controller(machine).capability.holds
    return [
        axis
        for axis in machine.structure.rotary
        if any(h.form == "axis" and h.serves(axis, axis) for h in holds)
    ]


def live_correction(configuration: Configuration) -> str:
    """The correction that `abbe run` makes of the same machine meanwhile, in words; else empty."""
    links = configuration.make_links()
    writes = set(held_by_run(configuration, links))
    for run in found_runs():
        if run.status is None:
            continue
        same = any(
            f.role == "configuration" and same_file(f.path, configuration.path)
            for f in run.status.files
        )
        if same or writes & set(run.status.owner.holds):
            return f"abbe run corrects this machine (process {run.status.owner.pid})"
    return ""


def require_stated(configuration: Configuration, live: str, given: Path | None = None) -> None:
    """Refuse to measure under a correction of which nobody has said what it does.

    Raises
    ------
    InputError
        Saying how to state it.
    """
    if live and given is None and configuration.file.measure.active is None:
        raise InputError(
            f"{live}, and what that does to the measurement is not stated",
            file=configuration.path,
            field="measure.active",
            expected=_HOW,
        )


class RunsBeside:
    """Whether a correction of the same machine runs meanwhile, looked at now and then.

    Attributes
    ----------
    live
        As `live_correction`, when it was last looked at.
    """

    def __init__(self, configuration: Configuration) -> None:
        self._configuration = configuration
        self.live = ""

    async def watch(self) -> None:
        """Look over and over, until cancelled."""
        while True:
            await asyncio.sleep(_LOOK_FOR_RUNS)
            self.live = await asyncio.to_thread(live_correction, self._configuration)
