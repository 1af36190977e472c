"""The tables that act in a controller, asked of it, against what is stated of them."""

from __future__ import annotations

import asyncio
import hashlib
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.errors import AbbeError, InputError
from abbe.daemon.answers.typed import uploading
from abbe.daemon.config import Configuration
from abbe.daemon.measure.compensation import NONE
from abbe.daemon.upload.checks.preflight import present_tables
from abbe.daemon.upload.history.content import Content, short
from abbe.daemon.upload.operator import TerminalOperator
from abbe.daemon.upload.operator_port import OperatorPort
from abbe.daemon.upload.session import opened, working
from abbe.daemon.upload.status import origin
from abbe.drivers.link import LinkError


@dataclass(frozen=True)
class ActingTables:
    """What a controller compensates with.

    Attributes
    ----------
    sha256
        Of its tables; empty: none.
    effect
        Whether any of them holds anything but zeros.
    restart_needed
        Whether something else acts until the controller was restarted.
    model
        SHA-256 of the model that they were made from; empty where the journal knows none.
    """

    sha256: str
    effect: bool
    restart_needed: bool
    model: str


def require_acting(configuration: Configuration, uploaded: Path | None) -> None:
    """Refuse to measure a machine that compensates with something else than is stated.

    Parameters
    ----------
    uploaded
        The model whose tables were uploaded and have to act; None: what ``[measure] active`` says
        has to be true.

    Raises
    ------
    InputError
        When the controller compensates with something else.
    AbbeError
        When nobody answers, or the controller has to be restarted first.
    """
    with TerminalOperator(quiet=False, yes=True) as operator:
        found = asyncio.run(_ask(configuration, operator.port()))
    if found.restart_needed:
        raise AbbeError(
            "the controller has not taken up the tables that are to act: restart it (and home it); "
            "then the same command goes on here"
        )
    stated = configuration.file.measure.active
    if uploaded is None and stated is None:
        return  # `abbe measure` says that it has to be stated
    bare = uploaded is None and stated == NONE
    if bare and found.effect:
        raise InputError(
            f"tables act in the controller ({short(found.sha256)}), and it is stated that none do",
            file=configuration.path,
            field="measure.active",
            found=NONE,
            expected="the model that they were made from, or none of them: "
            f"{uploading(configuration.path)} --rollback",
        )
    if bare:
        return
    model = uploaded or configuration.path.parent / str(stated)
    if not found.effect:
        raise InputError(
            "no tables act in the controller",
            file=configuration.path,
            field="measure.active",
            found=str(model),
            expected=f'"{NONE}", or its tables uploaded',
        )
    unknown = uploaded is not None and not found.model
    if unknown or (found.model and found.model != _digest(model)):
        raise InputError(
            f"the tables that act in the controller ({short(found.sha256)}) were made from another "
            "model",
            file=configuration.path,
            field="measure.active",
            found=str(model),
            expected=f"the model of {found.model[:12]}" if found.model else "its tables uploaded",
        )


async def _ask(configuration: Configuration, port: OperatorPort) -> ActingTables:
    with working(configuration, port, "", writes=False) as work:
        async with opened(work):
            try:
                await work.store.readiness()
                active = Content.of(await work.store.active())
            except LinkError as error:
                raise AbbeError(f"what acts in the controller is not known: {error}") from None
            tables = present_tables(work.controller, active)
            came = origin(active, work.journal.found.entries)
            return ActingTables(
                active.sha256,
                any(t.forward.any() or t.downward.any() for t in tables),
                work.store.restart_needed,
                "" if came is None else str(came["model"].get("sha256", "")),
            )


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from None
