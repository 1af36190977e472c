"""The steps of an upload, each with what it does at the controller.

None decides by an acknowledgement: what was written is read back and compared.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from abbe.compcore.sentences import said
from abbe.daemon.upload.checks.shown_correction import EffectCheck, Expectation, check_effect
from abbe.daemon.upload.history.content import Content, short
from abbe.daemon.upload.operator_port import OperatorPort
from abbe.daemon.upload.settle import check_identity, check_ready
from abbe.drivers.controllers import Controller
from abbe.drivers.link import LinkProtocolError
from abbe.drivers.stores.base import Identity, RefusedError, Store

Step = Callable[[], Awaitable[dict[str, Any]]]
"""One step; hands back what the journal says of it when it is done."""


@dataclass(frozen=True)
class Allowed:
    """Times and tolerances of a sequence; s, µm."""

    step_timeout: float
    wait_limit: float
    effect_tolerance_um: float
    effect_looks: int
    effect_every: float


@dataclass(frozen=True, eq=False)
class ContentChange:
    """A change of what is active in one controller.

    Attributes
    ----------
    identity
        Which controller it is.
    old, new
        What is active and what shall be; `new` may be without files when only the steps after
        activation are left.
    expected
        What the new set makes the controller add.
    puts_back
        Whether the new set is a backup.
    """

    identity: Identity
    old: Content
    new: Content
    expected: Expectation
    puts_back: bool = False


class Steps:
    """The steps of one change, and what they found.

    Parameters
    ----------
    store
        The controller's memory, open.
    controller
        The dialect.
    change
        From what to what.
    allowed
        Times and tolerances.
    operator
        Is kept informed, and asked to restart the controller.
    back_up
        Keeps the old set; returns where.
    backup
        Where it is kept already.

    Attributes
    ----------
    kept
        Where the old set is kept; None before.
    seen
        What the controller was seen to add.
    acts
        Whether what is active acts, so that its effect can be seen.
    notes
        What a person still has to do.
    """

    def __init__(
        self,
        store: Store,
        controller: Controller,
        change: ContentChange,
        allowed: Allowed,
        operator: OperatorPort,
        back_up: Callable[[], Path],
        backup: Path | None = None,
    ) -> None:
        self.store, self.change, self.allowed = store, change, allowed
        self._old, self._new = change.old, change.new
        self._controller, self._operator, self._back_up = controller, operator, back_up
        self.tell = operator.tell
        self.kept = backup
        self.seen = EffectCheck()
        self.acts = True
        self.notes: list[str] = []

    def all(self) -> dict[str, Step]:
        """Every step of the change by its name in the journal, in order."""
        first: dict[str, Step] = {"backup": self.backup}
        if not self.change.new.none:
            first |= {"stage": self.stage, "compare": self.compare}
        return {**first, "ready": self.ready, "activate": self.activate, **self.only_looking()}

    def only_looking(self) -> dict[str, Step]:
        """The steps after activation; they only look, and can be done again."""
        return {"verify": self.verify, "restart": self.restart, "effect": self.effect}

    async def backup(self) -> dict[str, Any]:
        """Keep what is active; it must still be what was read first."""
        self.tell(said("backing up what is active ({table})", table=short(self._old.sha256)))
        self.kept = self._back_up()
        if not self._old.same(await self.store.active()):
            raise LinkProtocolError("what is active has changed since it was first read")
        return {"backup": str(self.kept)}

    async def stage(self) -> dict[str, Any]:
        """Write the new set into the staging area."""
        new = short(self._new.sha256)
        if self.change.puts_back:
            self.tell(
                said("writing the table of the backup ({table}) into the staging area", table=new)
            )
        else:
            self.tell(said("writing the new table ({table}) into the staging area", table=new))
        await self.store.stage(self._new.files or {}, self._operator.progress)
        return {}

    async def compare(self) -> dict[str, Any]:
        """Read the staging area back: byte for byte, and as tables."""
        self.tell(said("reading the staging area back and comparing"))
        files = await self.store.staged(self._operator.progress)
        if not self._new.same(files):
            raise LinkProtocolError("what is staged is not what was written")
        self._controller.check(self.change.expected.tables, files)
        return {"sha256": self._new.sha256}

    async def ready(self) -> dict[str, Any]:
        """Ask whether the machine is idle and referenced."""
        await check_ready(self.store)
        return {}

    async def activate(self) -> dict[str, Any]:
        """Make what is staged active, or take the tables out of action."""
        if self._new.none:
            self.tell(said("taking the table out of action"))
            await self.store.deactivate()
        else:
            self.tell(said("activating"))
            await self.store.activate(self._new.files or {})
        return {}

    async def verify(self) -> dict[str, Any]:
        """Read back what is active."""
        self.tell(said("reading back what is active and comparing"))
        files = await self.store.active(self._operator.progress)
        if not self._new.same(files):
            raise LinkProtocolError("what is active is not the new table")
        if files:
            self._controller.check(self.change.expected.tables, files)
        return {"sha256": self._new.sha256}

    async def restart(self) -> dict[str, Any]:
        """Restart the controller where its tables act only then, or have it restarted."""
        if not self.store.restart_needed:
            return {"needed": False}
        self.acts = False
        try:
            await self.store.restart()
        except RefusedError as error:
            self.tell(
                said("the controller has to be restarted for the table to act ({why})", why=error)
            )
            if not await self._operator.restarted():
                self.notes.append(
                    said(
                        "it acts after the controller was restarted; its effect is not checked: "
                        "afterwards run abbe upload CONFIG.toml --check"
                    )
                )
                return {"needed": True, "restarted": False}
            await self.store.close()
            await self.store.open()
        meant = self.change.identity
        check_identity(await self.store.identity(), meant.name, meant.serial)
        if not self._new.same(await self.store.active()):
            raise LinkProtocolError("after the restart the new table is not active")
        self.acts = True
        return {"needed": True, "restarted": True}

    async def effect(self) -> dict[str, Any]:
        """Compare what the controller adds with what the new tables say."""
        if not self.acts:
            return {"looks": 0}
        self.tell(said("checking what the controller adds"))
        allowed = self.allowed
        self.seen = await check_effect(
            self.store,
            self.change.expected,
            tolerance=allowed.effect_tolerance_um,
            looks=allowed.effect_looks,
            every=allowed.effect_every,
        )
        return {"looks": self.seen.looks, "worst_um": self.seen.worst}
