"""What all tests share: how Hypothesis searches, and what must not run side by side."""

from __future__ import annotations

import os
import signal
from collections import Counter
from pathlib import Path

# As many processes test as there are cores; with more threads than cores those of a BLAS wait for
# each other. Before NumPy is imported, and for the commands that tests start.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings

# The machine that runs the tests is shared: no deadlines; the same examples every time.
settings.register_profile("abbe", deadline=None, derandomize=True, print_blob=False)
settings.load_profile("abbe")

# Where the tests are started in the background of a shell, or under nohup, their processes would
# ignore Ctrl-C and a closed terminal too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

ALONE = {
    # one LinuxCNC on a computer: its shared memory has fixed keys
    "linuxcnc": ("test_linuxcnc_",),
    # python-can's multicast groups and ports
    "multicast": ("test_can_bus", "test_can_fd", "test_can_udp"),
}
"""Group → beginnings of the names of the files that share something there is only one of."""

LONG = {"integration", "torment", "soak", "linuxcnc", "diagnosis", "upload", "http", "opcua_server"}
"""Folders the files of which take minutes."""


def pytest_make_parametrize_id(val: object) -> str | None:
    """A long text in a test's name by its beginning: names go to every process that tests."""
    return f"{val[:60]!a} of {len(val)}" if isinstance(val, str) and len(val) > 100 else None


@pytest.hookimpl(tryfirst=True)  # before pytest-xdist looks at the groups
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give every file to one process, and the files of a group to the same one (pytest-xdist).

    The long ones first, so that no process waits for another's at the end; of many cases of one
    kind those that belong to `make test`.
    """
    cases: Counter[str] = Counter()
    items.sort(key=lambda item: LONG.isdisjoint(Path(item.path).parts))
    for item in items:
        if mark := item.get_closest_marker("one_in"):
            test = item.nodeid.partition("[")[0]
            if cases[test] % mark.args[0]:
                item.add_marker("thorough")
            cases[test] += 1
        name = Path(item.path).stem
        group = next((g for g, starts in ALONE.items() if name.startswith(starts)), name)
        item.add_marker(pytest.mark.xdist_group(group))


def pytest_collection_finish(session: pytest.Session) -> None:
    """Notice when pytest-xdist does not group: what there is only one of would be shared."""
    asked_for = getattr(session.config.option, "loadgroup", False)
    if asked_for and not all("@" in item.nodeid for item in session.items):
        raise pytest.UsageError("pytest-xdist ignores the groups of tests; see pyproject.toml")
