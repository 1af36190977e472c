"""Threads of a process share what memory they let go of; after much of it, the others get it."""

from __future__ import annotations

import contextlib
import ctypes

_ARENA_MAX = -8
"""M_ARENA_MAX of glibc's malloc.h."""


def share_memory(arenas: int = 1) -> None:
    """Have glibc give all threads that begin from now on memory out of so few arenas.

    By itself it gives each of eight threads a core its own, and each keeps the most that one answer
    ever took: a server whose answers are made in changing threads grows for hours. Elsewhere than
    on glibc nothing happens. Source: mallopt(3).
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).mallopt(_ARENA_MAX, arenas)


def give_back() -> None:
    """Give the computer back what nothing stands in any more.

    By itself glibc keeps it for as long as something newer lies behind it. Source: malloc_trim(3).
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
