"""How often Python looks for objects that refer only to one another: commands, services."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator

_OF_A_COMMAND = 20_000
_OF_A_SERVICE = 700
"""New objects after which the youngest are looked through: Python's own figure.

asyncio leaves each connection that was closed to the collector, as its transport holds a method of
itself. With a command's figure thousands of them lie there, some megabytes, before it comes round.
"""


def seldom() -> None:
    """Look seldom: a command makes many small objects that stay until it ends."""
    gc.set_threshold(_OF_A_COMMAND)


@contextlib.contextmanager
def as_a_service() -> Iterator[None]:
    """Look often at what is new: for a process that stays.

    What is there by now is collected once, and then left alone: a cycle need not wait for the
    collector to walk through it.
    """
    before = gc.get_threshold()
    gc.set_threshold(_OF_A_SERVICE, *before[1:])
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        gc.set_threshold(*before)
