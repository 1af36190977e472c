"""The sequence of an upload, every step in the journal before and behind, and where it breaks.

backup → stage → compare → ready → activate → verify → restart → effect → end

Nothing is decided by an acknowledgement: whatever breaks, and wherever, `abbe.daemon.upload.settle`
reads what is active and goes by that.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from abbe.compcore.errors import AbbeError, InputError
from abbe.daemon.upload.history.content import Content, short
from abbe.daemon.upload.history.upload_log import END, Journal
from abbe.daemon.upload.outcome import UploadOutcome
from abbe.daemon.upload.settle import check_identity, check_ready, settle
from abbe.daemon.upload.shown_correction import Expectation, Seen, WrongEffectError, check_effect
from abbe.drivers.controllers import Controller
from abbe.drivers.link import LinkError, LinkProtocolError
from abbe.drivers.stores.base import Identity, RefusedError, Store

AFTER_ACTIVATION = ("verify", "restart", "effect")
"""Steps that only look; they can be done again."""


@dataclass(frozen=True)
class Allowed:
    """Times and tolerances of a sequence; s, µm."""

    step_timeout: float
    patience: float
    effect_tolerance_um: float
    effect_looks: int
    effect_every: float


class Ledger:
    """The lines of one upload in the journal.

    Parameters
    ----------
    journal
        Where they go.
    context
        What every line carries: which upload, who, controller, model, the two SHA-256.
    """

    def __init__(self, journal: Journal, context: Mapping[str, Any]) -> None:
        self._journal = journal
        self._context = dict(context)
        self.broken = ""

    @property
    def upload(self) -> str:
        """The upload's name."""
        return str(self._context["upload"])

    @property
    def puts_back(self) -> bool:
        """Whether a backup is put back."""
        return bool(self._context.get("puts_back"))

    def note(self, step: str, outcome: str, **more: Any) -> None:
        """Write a line; raises `InputError` when it cannot be written."""
        self._journal.append({**self._context, "step": step, "outcome": outcome, **more})

    def note_anyway(self, step: str, outcome: str, **more: Any) -> None:
        """Write a line, and go on without where that fails: the machine comes first."""
        try:
            self.note(step, outcome, **more)
        except InputError as error:
            self.broken = str(error)


class Changeover:
    """One changeover from the active tables to others.

    Parameters
    ----------
    store
        The controller's memory, open.
    identity
        Which controller it is.
    controller
        The dialect.
    ledger
        Its lines in the journal; the first is written already.
    old, new
        What is active and what shall be; `new` may be without files when only the steps after
        activation are left.
    expected
        What the new set makes the controller add.
    allowed
        Times and tolerances.
    back_up
        Keeps the old set; hands back where.
    tell
        Is told what is done, for people.
    progress
        Is told how much of a transfer is done.
    restarted
        Asks somebody to restart the controller; True once it was done.
    """

    def __init__(
        self,
        store: Store,
        identity: Identity,
        controller: Controller,
        ledger: Ledger,
        old: Content,
        new: Content,
        expected: Expectation,
        allowed: Allowed,
        back_up: Callable[[], Path],
        tell: Callable[[str], None],
        progress: Callable[[float], None],
        restarted: Callable[[], Awaitable[bool]],
    ) -> None:
        self.store, self.identity, self.controller = store, identity, controller
        self.ledger, self.old, self.new = ledger, old, new
        self.expected, self.allowed = expected, allowed
        self._back_up, self._tell, self._progress = back_up, tell, progress
        self._restarted = restarted
        self.backup: Path | None = None
        self._seen = Seen()
        self._acts = True
        self._notes: list[str] = []

    def _steps(self) -> dict[str, Callable[[], Awaitable[dict[str, Any]]]]:
        staging = () if self.new.none else ("stage", "compare")
        names = ("backup", *staging, "ready", "activate", *AFTER_ACTIVATION)
        return {name: getattr(self, f"_{name}") for name in names}

    async def run(self) -> UploadOutcome:
        """All of it; whatever breaks is put right, and said."""
        return await self._from(self._steps(), again=True)

    async def finish(self) -> UploadOutcome:
        """What is left when the new set was found active after an interruption."""
        steps = self._steps()
        return await self._from({name: steps[name] for name in AFTER_ACTIVATION}, again=False)

    async def _from(
        self, steps: Mapping[str, Callable[[], Awaitable[dict[str, Any]]]], *, again: bool
    ) -> UploadOutcome:
        step = ""
        try:
            for step, do in steps.items():
                self.ledger.note(step, "begun")
                async with asyncio.timeout(self.allowed.step_timeout):
                    more = await do()
                self.ledger.note(step, "done", **more)
        except asyncio.CancelledError:
            _go_on()
            return await self._put_right(step, "stopped by the operator", want_old=True)
        except WrongEffectError as error:
            return await self._put_right(step, str(error), want_old=True)
        except (AbbeError, LinkError, OSError, TimeoutError) as error:
            why = str(error) or f"not finished within {self.allowed.step_timeout:g} s"
            return await self._put_right(step, why, want_old=not again)
        except Exception as error:  # noqa: BLE001 - a store's fault must not leave a machine halfway
            why = f"{type(error).__name__}: {error}"
            return await self._put_right(step, why, want_old=True)
        return self._end(UploadOutcome(True, "new", self.old, self.new))

    # the steps

    async def _backup(self) -> dict[str, Any]:
        self._tell(f"backing up what is active ({short(self.old.sha256)})")
        self.backup = self._back_up()
        if not self.old.same(await self.store.active()):
            raise LinkProtocolError("what is active has changed since it was first read")
        return {"backup": str(self.backup)}

    async def _stage(self) -> dict[str, Any]:
        what = "table of the backup" if self.ledger.puts_back else "new table"
        self._tell(f"writing the {what} ({short(self.new.sha256)}) into the staging area")
        await self.store.stage(self.new.files or {}, self._progress)
        return {}

    async def _compare(self) -> dict[str, Any]:
        self._tell("reading the staging area back and comparing")
        files = await self.store.staged(self._progress)
        if not self.new.same(files):
            raise LinkProtocolError("what is staged is not what was written")
        self.controller.check(self.expected.tables, files)
        return {"sha256": self.new.sha256}

    async def _ready(self) -> dict[str, Any]:
        await check_ready(self.store)
        return {}

    async def _activate(self) -> dict[str, Any]:
        self._tell("activating" if not self.new.none else "taking the table out of action")
        if self.new.none:
            await self.store.deactivate()
        else:
            await self.store.activate(self.new.files or {})
        return {}

    async def _verify(self) -> dict[str, Any]:
        self._tell("reading back what is active and comparing")
        files = await self.store.active(self._progress)
        if not self.new.same(files):
            raise LinkProtocolError("what is active is not the new table")
        if files:
            self.controller.check(self.expected.tables, files)
        return {"sha256": self.new.sha256}

    async def _restart(self) -> dict[str, Any]:
        if not self.store.restart_needed:
            return {"needed": False}
        self._acts = False
        try:
            await self.store.restart()
        except RefusedError as error:
            self._tell(f"the controller has to be restarted for the table to act ({error})")
            if not await self._restarted():
                self._notes.append(
                    "it acts after the controller was restarted; its effect is not checked: run "
                    "abbe upload CONFIG.toml --check afterwards"
                )
                return {"needed": True, "restarted": False}
            await self.store.close()
            await self.store.open()
        check_identity(await self.store.identity(), self.identity.name, self.identity.serial)
        if not self.new.same(await self.store.active()):
            raise LinkProtocolError("after the restart the new table is not active")
        self._acts = True
        return {"needed": True, "restarted": True}

    async def _effect(self) -> dict[str, Any]:
        if not self._acts:
            return {"looks": 0}
        self._tell("checking what the controller adds")
        allowed = self.allowed
        self._seen = await check_effect(
            self.store,
            self.expected,
            tolerance=allowed.effect_tolerance_um,
            looks=allowed.effect_looks,
            every=allowed.effect_every,
        )
        return {"looks": self._seen.looks, "worst_um": self._seen.worst}

    # where it breaks, and the end

    async def _put_right(self, step: str, why: str, *, want_old: bool) -> UploadOutcome:
        self._tell(f"the step '{step}' failed: {why}")
        self.ledger.note_anyway(step, "failed", why=why)
        found = await settle(
            self.store, self.old, self.new, self.identity,
            want_old=want_old, patience=self.allowed.patience,
            step_timeout=self.allowed.step_timeout, tell=self._tell,
        )  # fmt: skip
        if found.note:
            self._notes.append(found.note)
        if found.active == "new" and not want_old:
            # it was done, only its confirmation was lost
            self.ledger.note_anyway("settle", "new active", why=why)
            steps = self._steps()
            return await self._from({n: steps[n] for n in AFTER_ACTIVATION}, again=False)
        return self._end(
            UploadOutcome(
                False, found.active, self.old, self.new, step=step, why=why, last=found.why
            )
        )

    def _end(self, outcome: UploadOutcome) -> UploadOutcome:
        seen = self._seen.words() if outcome.done and self._acts else ""
        if outcome.active == "new" and not outcome.done:
            self._notes.append(
                f"the old table could not be put back: {outcome.last}. Mend that, and run "
                "abbe upload CONFIG.toml --recover"
            )
        reported = {"active": outcome.active, "why": outcome.why, "step_failed": outcome.step}
        if outcome.open:
            self.ledger.note_anyway("settle", "left open", **reported, last=outcome.last)
        else:
            self.ledger.note_anyway(END, "done" if outcome.done else "failed", **reported)
        if self.ledger.broken:
            self._notes.append(f"the journal is not complete: {self.ledger.broken}")
        return replace(
            outcome,
            upload=self.ledger.upload,
            backup=self.backup,
            seen=seen,
            puts_back=self.ledger.puts_back,
            notes=tuple(dict.fromkeys(self._notes)),
        )


def _go_on() -> None:
    """Take back a cancellation: what is half done has to be put right first."""
    task = asyncio.current_task()
    if task is not None:
        while task.uncancel():
            pass
