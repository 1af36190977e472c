"""Doors to a running correction: where it listens, and who is let in to do what.

The control door is a file that the configuration names: whoever owns the correction may change it
there. The status door is there for every run, in Linux's abstract namespace, so that it leaves
nothing behind and `abbe status` finds every run of the computer: it shows, and changes nothing.
"""

from __future__ import annotations

import array
import contextlib
import os
import pwd
import secrets
import socket
import struct
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, Self

from abbe.compcore.errors import AbbeError
from abbe.daemon.control.requests import Request, changes
from abbe.daemon.socket_path import bound

STATUS_NAME = "abbe-run "
"""How the abstract names of status doors begin; process number and a random word follow."""
_CREDENTIALS = struct.Struct("3i")
_PEER_GROUPS = 59
"""SO_PEERGROUPS of socket(7), which Python does not name."""
_MOST_GROUPS = 256
"""Python's getsockopt gives no more than 1024 bytes, and refuses to be asked for more."""


@dataclass(frozen=True)
class Peer:
    """Who is at the other end of a Unix socket, by the kernel's word.

    Attributes
    ----------
    uid, pid
        User and process.
    groups
        All of the user's.
    """

    uid: int
    pid: int
    groups: frozenset[int]

    @classmethod
    def of(cls, connection: socket.socket) -> Self:
        """Ask the kernel; where it does not tell, this process's own user."""
        if not hasattr(socket, "SO_PEERCRED"):
            return cls(os.geteuid(), 0, frozenset((os.getegid(),)))
        found = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        pid, uid, gid = _CREDENTIALS.unpack(found)
        groups = array.array("I")
        with contextlib.suppress(OSError):
            size = groups.itemsize * _MOST_GROUPS
            groups.frombytes(connection.getsockopt(socket.SOL_SOCKET, _PEER_GROUPS, size))
        return cls(uid, pid, frozenset((gid, *groups)))

    @property
    def user(self) -> str:
        """The user's name, or number."""
        try:
            return pwd.getpwuid(self.uid).pw_name
        except KeyError:
            return str(self.uid)

    def __str__(self) -> str:
        return f"{self.user} (process {self.pid})"


class Door(Protocol):
    """Where a correction listens."""

    def listen(self) -> socket.socket:
        """A socket that listens; raises `AbbeError` when it cannot be had."""

    def leave(self) -> None:
        """Take away what the door has left in the file system."""

    def refuses(self, peer: Peer) -> str:
        """Why somebody is not let in; empty when he is."""

    def lets(self, request: Request) -> bool:
        """Whether this may be asked here."""


class ControlDoor:
    """The socket that the configuration names, for the user who runs the correction, and root.

    Parameters
    ----------
    path
        The socket.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._inode = 0

    def listen(self) -> socket.socket:
        """A socket that listens; raises `AbbeError` when it cannot be had."""
        try:
            listening = bound(self._path)
        except OSError as error:
            raise AbbeError(f"control.socket {self._path}: {error.strerror}") from None
        self._inode = self._path.lstat().st_ino
        return listening

    def leave(self) -> None:
        """The socket's file goes, if it is still this one's."""
        with contextlib.suppress(OSError):
            if self._path.lstat().st_ino == self._inode:
                self._path.unlink()

    def refuses(self, peer: Peer) -> str:
        """Why somebody is not let in; empty when he is."""
        if peer.uid in (os.geteuid(), 0):
            return ""
        return "only the user who runs the correction may change it"

    def lets(self, request: Request) -> bool:
        """Everything may be asked here."""
        return True


class StatusDoor:
    """A name in Linux's abstract namespace, for the user, the members of the group, and root."""

    @staticmethod
    def can_be() -> bool:
        """Whether the system has such names."""
        return sys.platform == "linux"

    def listen(self) -> socket.socket:
        """A socket that listens; raises `AbbeError` when it cannot be had."""
        made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            made.bind(f"\0{STATUS_NAME}{os.getpid()} {secrets.token_hex(4)}")
            made.listen(16)
        except OSError as error:
            made.close()
            raise AbbeError(f"a socket for the status: {error.strerror}") from None
        made.setblocking(False)
        return made

    def leave(self) -> None:
        """There is nothing to take away."""

    def refuses(self, peer: Peer) -> str:
        """Why somebody is not let in; empty when he is."""
        if peer.uid in (os.geteuid(), 0) or os.getegid() in peer.groups:
            return ""
        return "only the user who runs the correction, and members of its group, may ask it"

    def lets(self, request: Request) -> bool:
        """Only what changes nothing."""
        return not changes(request)
