"""The routes of the tables: looking for whoever has entered, writing for the role ``operate``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

from fastapi import APIRouter, Request
from pydantic import Field

from abbe.daemon.workbench.entrance.asked import AskedOfWorkbench, Nothing
from abbe.daemon.workbench.entrance.role import operating
from abbe.daemon.workbench.tables.desk import Change, TableDesk

Text = Annotated[str, Field(max_length=200)]


class LookedAt(AskedOfWorkbench):
    """A change that is looked at."""

    change: Change


class WrittenNow(AskedOfWorkbench):
    """A change that is to be made; `cleared` is the pre-flight that was looked at."""

    cleared: int
    machine: Text
    by: Text = ""
    note: Text = ""


class Recovered(AskedOfWorkbench):
    """An upload that is to be brought to its end."""

    machine: Text
    by: Text = ""


def table_routes(of: Callable[[], TableDesk], prefix: str) -> APIRouter:
    """The routes of a desk.

    Parameters
    ----------
    of
        Gives it; may refuse where there is none yet.
    prefix
        Before their paths.
    """
    router = APIRouter(prefix=prefix)

    @router.get("")
    def shown() -> dict[str, Any]:
        """What the controller will hold, and what was uploaded before."""
        return of().shown()

    @router.get("/state")
    def state() -> dict[str, Any]:
        """What is under way."""
        return of().state()

    @router.post("/status")
    def ask(_: Nothing) -> dict[str, Any]:
        """Ask the controller what is active."""
        desk = of()
        desk.ask()
        return desk.state()

    @router.post("/preflight")
    def preflight(looked: LookedAt) -> dict[str, Any]:
        """What would change."""
        desk = of()
        desk.preflight(looked.change)
        return desk.state()

    @router.post("/write")
    def write(wanted: WrittenNow, request: Request) -> dict[str, Any]:
        """Upload or roll back; takes the role ``operate``."""
        desk = of()
        who = operating(desk.config, request, wanted.by)
        desk.write(wanted.cleared, wanted.machine, who, wanted.note)
        return desk.state()

    @router.post("/recover")
    def recover(wanted: Recovered, request: Request) -> dict[str, Any]:
        """Bring an upload that was cut off to its end; takes the role ``operate``."""
        desk = of()
        desk.recover(wanted.machine, operating(desk.config, request, wanted.by))
        return desk.state()

    return router
