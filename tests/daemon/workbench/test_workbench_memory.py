"""Threads of the workbench share the memory that they let go of, and give it back."""

from __future__ import annotations

import subprocess
import sys

import pytest

_COUNTED = """
import ctypes, sys, threading
from abbe.daemon.workbench.few_arenas import share_memory
libc = ctypes.CDLL(None)
libc.malloc.restype, libc.fdopen.restype = ctypes.c_void_p, ctypes.c_void_p
if sys.argv[1] == "shared":
    share_memory()
together = threading.Barrier(4)
def ask():
    libc.malloc(1000)
    together.wait()
threads = [threading.Thread(target=ask) for _ in range(4)]
for thread in threads: thread.start()
for thread in threads: thread.join()
out = ctypes.c_void_p(libc.fdopen(1, b"w"))
libc.malloc_info(0, out)
libc.fflush(out)
"""


def arenas(how: str) -> int:
    """Out of how many arenas glibc gave four threads memory."""
    done = subprocess.run(
        [sys.executable, "-c", _COUNTED, how], capture_output=True, text=True, check=True
    )
    return done.stdout.count("<heap nr=")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc's own")
def test_threads_share_one_arena() -> None:
    assert arenas("each its own") > 1
    assert arenas("shared") == 1


_LEFT = """
import sys
from abbe.daemon.workbench.few_arenas import give_back
def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096
# every second one of many small ones: none lies at the end, where glibc looks by itself
pieces = [bytes(3000) for _ in range(40_000)]
kept = pieces[1::400]
del pieces
before = resident()
if sys.argv[1] == "back":
    give_back()
print(before - resident())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc's own")
@pytest.mark.parametrize(("how", "least"), [("kept", -1e6), ("back", 50e6)])
def test_what_nothing_stands_in_is_given_back(how: str, least: float) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _LEFT, how], capture_output=True, text=True, check=True
    )
    given = float(done.stdout)
    assert given > least
    assert how == "back" or given < 1e6
