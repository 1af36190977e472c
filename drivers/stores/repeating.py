"""Repetition in a store: only of what does no harm twice, until it succeeds or is refused."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import NamedTuple, TypeVar

from abbe.drivers.link import LinkError
from abbe.drivers.stores.base import RefusedError

T = TypeVar("T")

LOOK = 0.02
"""s between two looks at something that is to change."""


class Refusal(NamedTuple):
    """What the controller means by an error.

    Attributes
    ----------
    text
        What it refuses, for people.
    for_good
        Whether it would refuse the same again; else it is busy, or did not get what was sent.
    """

    text: str
    for_good: bool


async def again(
    do: Callable[[], Awaitable[T]],
    attempts: int,
    refusal: Callable[[LinkError], Refusal | None],
    recover: Callable[[LinkError], Awaitable[None]],
) -> T:
    """Do what does no harm twice, until it succeeds or the attempts are used up.

    Parameters
    ----------
    do
        What is done.
    attempts
        How often, 1 or more.
    refusal
        Whether an error is the controller's refusal; None: it got lost on the way.
    recover
        Awaited after an error, before the next attempt.

    Raises
    ------
    RefusedError
        When the controller refuses it for good, or refuses the last attempt.
    LinkError
        When the last attempt fails.
    """
    for left in reversed(range(attempts)):
        try:
            return await do()
        except RefusedError:
            raise
        except LinkError as error:
            refused = refusal(error)
            if refused is not None and (refused.for_good or not left):
                raise RefusedError(refused.text) from error
            if not left:
                raise
            await recover(error)
    raise ValueError("no attempt")


async def until_up(is_up: Callable[[], bool], within: float, down: Callable[[], LinkError]) -> None:
    """Wait until a link is up again, for at most so long (s).

    Raises
    ------
    LinkError
        What `down` gives, when it stays down.
    """
    until = time.monotonic() + within
    await asyncio.sleep(LOOK)
    while not is_up():
        if time.monotonic() > until:
            raise down()
        await asyncio.sleep(LOOK)
