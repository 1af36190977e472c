"""Holding a controller: between real processes, users and network namespaces, however one ends."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from abbe.daemon.ownership import lock as ownership
from abbe.daemon.ownership.lock import InUseError, hold

HOLDER = """
import subprocess, sys
from abbe.daemon.ownership.lock import InUseError, hold
try:
    with hold(sys.argv[2:], sys.argv[1]):
        child = subprocess.Popen(["sleep", "60"], stdout=subprocess.DEVNULL)
        print("held", child.pid, flush=True)
        sys.stdin.read()
        child.kill()
except InUseError as error:
    print(error, flush=True)
"""
ROOT = Path(__file__).parents[2]
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="needs to be another user for a while")
with_namespaces = pytest.mark.skipif(
    not shutil.which("unshare")
    or subprocess.run(["unshare", "-n", "true"], capture_output=True, check=False).returncode != 0,
    reason="network namespaces need rights",
)


class Holding:
    """A process that holds, or tells why it cannot."""

    def __init__(self, resources: Sequence[str], what: str, prefix: Sequence[str]) -> None:
        self.process = subprocess.Popen(
            [*prefix, sys.executable, "-c", HOLDER, what, *resources],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        assert self.process.stdout is not None
        self.said = self.process.stdout.readline()
        self.held = self.said.startswith("held ")
        self._child = int(self.said.split()[1]) if self.held else 0

    def end(self, number: int) -> None:
        """Send a signal and wait until it is gone; its child lives on."""
        self.process.send_signal(number)
        self.process.wait(30.0)

    def close(self) -> None:
        if self._child and self.process.poll() is not None:
            os.kill(self._child, signal.SIGKILL)
        self.process.communicate(timeout=30.0)


@contextmanager
def holding(*resources: str, what: str = "a test", prefix: Sequence[str] = ()) -> Iterator[Holding]:
    """A process of its own that tries to hold resources."""
    other = Holding(resources, what, prefix)
    try:
        yield other
    finally:
        other.close()


@pytest.fixture
def name() -> Iterator[str]:
    """A resource that nobody else in this computer has."""
    resource = f"tcp test-{os.getpid()}.invalid:502"
    yield resource
    for folder in ownership._FOLDERS:
        for left in folder.glob(f"abbe-tcp-test-{os.getpid()}*.lock"):
            with contextlib.suppress(OSError):
                left.unlink()


def test_a_second_one_learns_by_whom_since_when_and_with_what(name: str) -> None:
    with holding(name, what="live correction with /machines/Prüfstand 3.toml") as first:
        assert first.held
        with pytest.raises(InUseError) as caught, hold([name], "me"):
            pass
        message = str(caught.value)
        assert "\n" not in message
        assert name in message
        assert f"process {first.process.pid} since 20" in message
        assert "(live correction with /machines/Prüfstand 3.toml)" in message
        # asking again and again takes nothing away from the holder, nor from what is told
        for _ in range(100):
            with pytest.raises(InUseError, match=f"process {first.process.pid} "), hold([name], ""):
                pass
    with hold([name], "me"):
        pass


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGABRT])
def test_it_is_free_when_the_holder_is_dead_even_if_its_children_live(
    name: str, number: int
) -> None:
    with holding(name) as first:
        assert first.held
        first.end(number)
        with hold([name], "me"), holding(name) as third:
            assert f"process {os.getpid()} since" in third.said


def test_all_or_none(name: str) -> None:
    free = f"{name}1"
    with holding(name):
        with pytest.raises(InUseError), hold([free, name], "me"):
            pass
        with hold([free, free], "me"), holding(free) as other:
            assert not other.held


@with_namespaces
@pytest.mark.parametrize("inside", ["holder", "asker"])
def test_another_network_namespace_is_seen_by_the_lock_file(name: str, inside: str) -> None:
    prefix = ("unshare", "-n")
    first_in, second_in = (prefix, ()) if inside == "holder" else ((), prefix)
    with holding(name, prefix=first_in) as first:
        assert first.held
        with holding(name, prefix=second_in) as second:
            assert not second.held
            assert f"process {first.process.pid} since" in second.said


@as_root
@pytest.mark.parametrize("first_is_root", [True, False])
def test_users_see_each_other(name: str, first_is_root: bool) -> None:
    nobody = ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups")
    users = [(), nobody] if first_is_root else [nobody, ()]
    for _ in range(2):  # the second time the lock file is there already, the other user's
        with holding(name, prefix=users[0]) as first:
            assert first.held
            with holding(name, prefix=users[1]) as second:
                assert f"process {first.process.pid} since" in second.said
        users.reverse()


def test_without_a_place_for_files_the_name_alone_holds(name: str, tmp_path: Path) -> None:
    nowhere = tmp_path / "none"
    with hold([name], "me", nowhere), pytest.raises(InUseError), hold([name], "me", nowhere):
        pass


def test_what_lies_in_everybodys_folder_is_neither_followed_nor_believed(
    name: str, tmp_path: Path
) -> None:
    path = tmp_path / ownership._file_name(name)
    precious = tmp_path / "precious"
    precious.write_text("a day's measurement")
    for make in (path.symlink_to, path.hardlink_to):
        make(precious)
        with hold([name], "me", tmp_path):
            assert precious.read_text() == "a day's measurement"
        path.unlink()
    os.mkfifo(path)
    with hold([name], "me", tmp_path):
        pass
    path.unlink()
    for rubbish in (b"\0" * 9000, b"[1]", b"{}", b'{"pid": "x"}', b"\xff", b"[" * 4000):
        path.write_bytes(rubbish)
        with hold([name], "me", tmp_path):
            assert b'"me"' in path.read_bytes()
        assert path.read_bytes() == b""


def test_what_a_file_tells_is_one_line() -> None:
    holder = ownership.Holder.parsed(
        b'{"pid": 1, "since": "now", "what": "a\\nb\\u001b[31m\\ud800"}'
    )
    assert holder.words() == "process 1 since now (a?b?[31m?)"
