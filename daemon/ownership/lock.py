"""One owner of a machine: two Abbes on one controller would each undo what the other one writes.

A resource (`abbe.drivers.resources` spells them) is held in two ways at once, and both end with the
process, however it ends, because the kernel takes them back:

- a socket of its name in Linux's abstract namespace, which every user of this computer sees, in
  whatever folder or container he is, as long as he shares its network;
- a lock on a file in `/run/lock` or `/tmp`, which is seen from another network namespace too, and
  where there are no abstract sockets.

Somebody who shares neither (a container with a network and files of its own, another computer) is
not seen; ``docs/daemon.md`` says so.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import re
import socket
import stat
import struct
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Self

from abbe.compcore.errors import AbbeError

_FOLDERS = (Path("/run/lock"), Path("/tmp"))
"""Where lock files go: the first that is everybody's, the same one for all users."""
_ABOUT = 4096
"""Bytes of a lock file that are read."""


class InUseError(AbbeError):
    """Another process holds what this one would write to."""


@dataclass(frozen=True, slots=True)
class Holder:
    """The process that holds a resource, as far as it is known.

    Attributes
    ----------
    pid
        Process, 0: not known.
    since
        Local time, ISO 8601; empty: not known.
    what
        What it does with which configuration; empty: not known.
    """

    pid: int = 0
    since: str = ""
    what: str = ""

    @classmethod
    def me(cls, what: str) -> Self:
        """This process, from now on."""
        return cls(os.getpid(), datetime.now().astimezone().isoformat(" ", "seconds"), what)

    @classmethod
    def parsed(cls, text: bytes) -> Self:
        """What a lock file says; everything is optional, because anybody may write there."""
        with contextlib.suppress(ValueError, KeyError, TypeError, RecursionError):
            found = json.loads(text)
            since, what = _printable(found["since"]), _printable(found["what"])
            return cls(int(found["pid"]), since[:40], what[:1024])
        return cls()

    def as_bytes(self) -> bytes:
        """For the lock file."""
        reported = {"pid": self.pid, "since": self.since, "what": self.what}
        return json.dumps(reported).encode("ascii") + b"\n"

    def words(self) -> str:
        """For people, after 'is in use by'."""
        parts = [f"process {self.pid}" if self.pid else "another process"]
        if self.since:
            parts.append(f"since {self.since}")
        if self.what:
            parts.append(f"({self.what})")
        return " ".join(parts)


@contextmanager
def hold(resources: Iterable[str], what: str, folder: Path | None = None) -> Iterator[None]:
    """Hold resources while the context lasts, all of them or none; never waits.

    Parameters
    ----------
    resources
        Names.
    what
        What is done with which configuration, to be reported to those who come later.
    folder
        For the lock files; default one that all users share.

    Raises
    ------
    InUseError
        When somebody holds one of them: which, who, and since when.
    AbbeError
        When this computer offers no way to hold anything.
    """
    with ExitStack() as held:
        for resource in sorted(set(resources)):
            _take(resource, Holder.me(what), folder or _shared_folder(), held)
        yield


def _take(resource: str, me: Holder, folder: Path | None, held: ExitStack) -> None:
    file = None if folder is None else _open(folder / _file_name(resource))
    if file is not None:
        held.callback(os.close, file)
    named = _bind(resource, file, held)
    if file is None:
        if not named:
            raise AbbeError(
                f"{resource}: nobody can be kept from using it at the same time: no lock file can "
                f"be made in {' or '.join(map(str, _FOLDERS))}"
            )
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise _in_use(resource, Holder.parsed(os.pread(file, _ABOUT, 0))) from None
    # only what is known of the holder depends on it; the lock is held in any case
    with contextlib.suppress(OSError):
        os.ftruncate(file, 0)
        os.pwrite(file, me.as_bytes(), 0)
        held.callback(_forget, file)


def _bind(resource: str, file: int | None, held: ExitStack) -> bool:
    """Take the abstract name; False where the system has none.

    Raises
    ------
    InUseError
        When somebody has it.
    """
    if sys.platform != "linux":
        return False
    named = held.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
    name = f"\0abbe {resource}" if len(resource) < 90 else f"\0abbe {_digest(resource)}"
    try:
        named.bind(name)
        named.listen(64)
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            return False
        pid = _listener(name)
        reported = Holder() if file is None else Holder.parsed(os.pread(file, _ABOUT, 0))
        raise _in_use(
            resource, reported if not pid or reported.pid == pid else Holder(pid)
        ) from None
    return True


def _listener(name: str) -> int:
    """The process that listens under an abstract name, by the kernel's word; 0: not known."""
    with (
        contextlib.suppress(OSError),
        socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking,
    ):
        asking.setblocking(False)
        asking.connect(name)
        form = struct.Struct("3i")
        reported = asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, form.size)
        return int(form.unpack(reported)[0])
    return 0


def _in_use(resource: str, holder: Holder) -> InUseError:
    return InUseError(
        f"{resource} is in use by {holder.words()}: two must not work on one controller; "
        "nothing was opened or written"
    )


def _shared_folder() -> Path | None:
    for folder in _FOLDERS:
        with contextlib.suppress(OSError):
            mode = folder.stat().st_mode
            if mode & stat.S_IWOTH and mode & stat.S_ISVTX:
                return folder
    return None


def _open(path: Path) -> int | None:
    """A lock file that every user can lock; None where there can be none.

    In a folder that is everybody's nothing is followed or overwritten that is not a lock file.
    """
    flags = os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    for access in (os.O_RDWR, os.O_RDWR | os.O_CREAT | os.O_EXCL, os.O_RDWR, os.O_RDONLY):
        try:
            file = os.open(path, access | flags, 0o666)
        except OSError:
            continue
        found = os.fstat(file)
        if stat.S_ISREG(found.st_mode) and found.st_nlink == 1:
            if access & os.O_CREAT:
                os.fchmod(file, 0o666)  # whatever the umask: it is locked by all users
            return file
        os.close(file)
        return None
    return None


def _forget(file: int) -> None:
    with contextlib.suppress(OSError):
        os.ftruncate(file, 0)


def _printable(text: object) -> str:
    return "".join(c if c.isprintable() else "?" for c in str(text))


def _file_name(resource: str) -> str:
    readable = re.sub(r"[^A-Za-z0-9.]+", "-", resource).strip("-")[:60]
    return f"abbe-{readable}-{_digest(resource)[:8]}.lock"


def _digest(resource: str) -> str:
    return hashlib.sha256(resource.encode("utf-8", "surrogateescape")).hexdigest()
