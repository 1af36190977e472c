"""After a failure: find out what is active by reading it, and put it right where it is neither.

The order matters. First the staging area is emptied, and seen to be empty: from then on a command
that is still on its way somewhere finds nothing that it could activate. Then what is active is
read.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from abbe.compcore.errors import AbbeError
from abbe.daemon.upload.history.content import Content, short
from abbe.drivers.link import LinkError, LinkProtocolError
from abbe.drivers.stores.base import Identity, RefusedError, Store

Tell = Callable[[str], None]
_PAUSE = 0.2
"""s before the next attempt; doubles up to two seconds."""


class WrongControllerError(AbbeError):
    """Another controller answers than the one that was meant."""


class NotReadyError(LinkError):
    """The machine is not idle, not referenced, or something else speaks against a change."""


@dataclass(frozen=True)
class Settled:
    """The active content, once it is known.

    Attributes
    ----------
    active
        The old or the new set, read and verified; ``unknown``.
    why
        For ``unknown``, and for the new one where the old was wanted: what stood in the way.
    note
        What a person still has to do.
    """

    active: Literal["new", "old", "unknown"]
    why: str = ""
    note: str = ""


def check_identity(found: Identity, name: str, serial: str) -> None:
    """Refuse another controller.

    Raises
    ------
    WrongControllerError
        With what was found and expected.
    """
    if found.name != name:
        raise WrongControllerError(
            f"another controller answers: it calls itself {found.name!r}, upload.identity expects "
            f"{name!r}"
        )
    if serial and found.serial != serial:
        raise WrongControllerError(
            f"another controller answers: its serial number is {found.serial!r}, upload.serial "
            f"expects {serial!r}"
        )


async def check_ready(store: Store) -> None:
    """Refuse a machine that is not ready for other tables.

    Raises
    ------
    NotReadyError
        With everything that speaks against it.
    """
    found = await store.readiness()
    if not found.ready:
        why = [*found.hindrances]
        if not found.referenced:
            why.insert(0, "the machine is not referenced: reference all axes")
        if not found.idle:
            why.insert(0, "the machine is not idle: end the programme and let the axes stand")
        raise NotReadyError("; ".join(why))


async def settle(
    store: Store,
    old: Content,
    new: Content,
    identity: Identity,
    *,
    want_old: bool,
    wait_limit: float,
    step_timeout: float,
    tell: Tell,
) -> Settled:
    """Find out which of two sets is active; put the old one back where it is neither.

    Parameters
    ----------
    old, new
        The two; the old one with its files.
    identity
        Of the controller that it was.
    want_old
        Put the old one back also where the new one is active.
    wait_limit
        s for which a controller that does not answer is sought.
    step_timeout
        s that one attempt may take.
    tell
        Called with what is being done.
    """
    until, pause = time.monotonic() + wait_limit, _PAUSE
    new_seen, strange = False, ""
    while True:
        try:
            async with asyncio.timeout(step_timeout):
                await store.close()
                await store.open()
                check_identity(await store.identity(), identity.name, identity.serial)
                await empty_staging(store)
                files = await store.active()
                new_seen = new.same(files)
                if old.same(files):
                    return Settled("old", note=await _acting(store))
                if new_seen and not want_old:
                    return Settled("new")
                strange = (
                    "" if new_seen else "what is active is neither the old nor the new table; "
                )
                tell(f"{strange}putting the old table ({short(old.sha256)}) back")
                await check_ready(store)
                new_seen = False
                await put_back(store, old)
                return Settled("old", note=await _acting(store))
        except WrongControllerError as error:
            return Settled("unknown", str(error))
        except NotReadyError as error:
            why = str(error)
        except (LinkError, AbbeError, OSError, TimeoutError) as error:
            why, new_seen = str(error) or "no answer in time", False
        if time.monotonic() >= until:
            return Settled("new" if new_seen else "unknown", strange + why)
        tell(f"{why}; trying again")
        await asyncio.sleep(pause)
        pause = min(2.0 * pause, 2.0)


async def empty_staging(store: Store) -> None:
    """Empty the staging area and see that it is."""
    await store.discard()
    if await store.staged():
        raise LinkProtocolError("the staging area is not empty after it was discarded")


async def _acting(store: Store) -> str:
    """Have what is active act where that takes a restart; what a person has to do otherwise."""
    if not store.restart_needed:
        return ""
    try:
        await store.restart()
    except RefusedError as error:
        return f"it acts only after the controller was restarted: {error}"
    return ""


async def put_back(store: Store, old: Content) -> None:
    """Make the old set active again by the same path as the new one: stage, compare, activate.

    Raises
    ------
    LinkError
        When the controller then holds anything else.
    """
    if old.none:
        await store.deactivate()
    else:
        if old.files is None:
            raise AbbeError("the files of the old table are not at hand")
        await store.stage(old.files)
        if not old.same(await store.staged()):
            raise LinkProtocolError("what is staged is not the old table")
        await check_ready(store)
        await store.activate(old.files)
    if not old.same(await store.active()):
        raise LinkProtocolError("what is active is not the old table")
