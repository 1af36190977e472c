"""How many threads linear algebra takes: one, unless the work is worth more."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController

WORTH_MORE = 20_000_000
"""Elements of a matrix from which several threads pay even on a machine that is busy."""


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


@contextmanager
def threads_for(elements: int) -> Iterator[None]:
    """Run with one thread for matrices of fewer than `WORTH_MORE` elements.

    Where other processes want the cores too (a daemon in its cycle, a CAM system), the threads of a
    BLAS wait for each other thousands of times a second: small factorisations then take ten times
    as long as with one.
    """
    if elements >= WORTH_MORE:
        yield
        return
    with _controller().limit(limits=1, user_api="blas"):
        yield
