"""The routes of the campaigns: which there are, one that is sent, and which are laid beside."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Query, Request
from pydantic import Field

from abbe.daemon.workbench.campaigns.received import LARGEST, named, received, require_bounded
from abbe.daemon.workbench.entrance.asked import AskedByPerson, PersonName, who_asks
from abbe.daemon.workbench.session.workbench import Workbench

SENT = "/api/campaigns"
"""Where a campaign is sent to; the only path that takes more than a question."""
_MOST = 100
Words = Annotated[list[Annotated[str, Field(max_length=64)]], Field(max_length=_MOST)]


class ChosenCampaigns(AskedByPerson):
    """What stands for the campaigns that the model is to be laid beside."""

    fitted: Words
    held: Words = Field(default_factory=list)


def campaign_routes(bench: Workbench) -> APIRouter:
    """The routes of a session's campaigns."""
    router = APIRouter()
    # one at a time: two that do not end would fill the disk twice
    sending = asyncio.Lock()

    @router.get(SENT)
    def listed() -> dict[str, Any]:
        """Which there are."""
        return bench.campaigns.listed() | {"largest": LARGEST}

    @router.post(SENT)
    async def sent(
        request: Request,
        name: Annotated[str, Query(max_length=1000)],
        by: Annotated[PersonName, Query()] = "",
    ) -> dict[str, str]:
        """Keep one that is sent."""
        require_bounded(request.headers)
        known = named(name)
        if sending.locked():
            raise HTTPException(409, "another file is being sent: one after the other")
        async with sending:
            path = await received(request.stream(), bench.campaigns.shelf.folder, known)
        return {"id": bench.campaigns.took(path, who_asks(by, request)), "name": path.name}

    @router.post(f"{SENT}/use")
    def use(chosen: ChosenCampaigns, request: Request) -> dict[str, Any]:
        """Lay the model beside some."""
        bench.campaigns.use(chosen.fitted, chosen.held, who_asks(chosen.by, request))
        return bench.state()

    return router
