"""The runs of this computer, found by their status doors."""

from __future__ import annotations

import contextlib
import socket
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import ValidationError

from abbe.compcore.errors import AbbeError
from abbe.daemon.control.client import ask, ask_at
from abbe.daemon.control.doors import STATUS_NAME, Peer
from abbe.daemon.control.requests import StatusRequest
from abbe.daemon.status.run_status import RunStatus

_SOCKETS = Path("/proc/net/unix")
_WITHIN = 5.0
"""s that a run is given to answer: others are asked after it."""
_LISTENS = "00010000"
"""Flag of a socket that listens (__SO_ACCEPTCON)."""


@dataclass(frozen=True)
class Found:
    """A run that was found.

    Attributes
    ----------
    peer
        Its process, by the kernel's word.
    status
        What it says; None where it does not.
    reason
        Why it says nothing.
    address
        Where it can be asked again.
    """

    peer: Peer
    status: RunStatus | None
    reason: str = ""
    address: str = ""

    def ask_again(self) -> RunStatus:
        """Its status now.

        Raises
        ------
        AbbeError
            When it has ended, or does not answer.
        """
        status = _read(ask_at(self.address, StatusRequest(), str(self.peer), _WITHIN))
        # who it is, is the kernel's word, not its own
        owner = status.owner.model_copy(update={"user": self.peer.user, "pid": self.peer.pid})
        return status.model_copy(update={"owner": owner})


def found_runs() -> list[Found]:
    """Every run of this computer, the oldest process first; of those in other containers none."""
    found = []
    for name in _names():
        address = f"\0{name}"
        with contextlib.suppress(OSError):
            run = Found(_peer(address), None, address=address)
            try:
                found.append(replace(run, status=run.ask_again()))
            except AbbeError as error:
                found.append(replace(run, reason=str(error)))
    return sorted(found, key=lambda run: run.peer.pid)


def status_at(path: Path) -> RunStatus:
    """The status of the run that listens at a control socket.

    Raises
    ------
    AbbeError
        When nobody does, or who asks may not.
    """
    return _read(ask(path, StatusRequest()))


def _read(answer: dict[str, object]) -> RunStatus:
    try:
        return RunStatus.model_validate(answer["status"])
    except (KeyError, ValidationError):
        raise AbbeError(
            "another version of Abbe runs there: its status is not understood"
        ) from None


def _names() -> list[str]:
    """Abstract names of status doors."""
    try:
        lines = _SOCKETS.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    names = []
    for line in lines[1:]:
        fields = line.split(None, 7)
        if len(fields) == 8 and fields[3] == _LISTENS and fields[7].startswith(f"@{STATUS_NAME}"):
            names.append(fields[7][1:])
    return names


def _peer(address: str) -> Peer:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.settimeout(1.0)
        connection.connect(address)
        return Peer.of(connection)


def same_file(path: str, other: Path) -> bool:
    """Whether two paths are one file, also where this user may not look at it."""
    with contextlib.suppress(OSError):
        return Path(path).samefile(other)
    return Path(path) == other.absolute()
