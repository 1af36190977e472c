"""Asking a running correction, over its control socket."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path
from typing import Any

from abbe.compcore.errors import AbbeError
from abbe.daemon.control.requests import LONGEST, LONGEST_ANSWER, Request

_WITHIN = 30.0
"""s for an answer: a model is folded anew."""


def ask(path: Path, request: Request) -> dict[str, Any]:
    """The answer of the correction that listens at a path.

    Raises
    ------
    AbbeError
        When nobody listens there, who asks may not, or what is asked cannot be.
    """
    return ask_at(os.fspath(path), request, str(path))


def ask_at(address: str, request: Request, place: str, within: float = _WITHIN) -> dict[str, Any]:
    """The answer of the correction that listens at an address of a Unix socket.

    Parameters
    ----------
    address
        A path, or a name in the abstract namespace, which begins with a zero byte.
    request
        What is asked.
    place
        The address for people.
    within
        s for the answer.

    Raises
    ------
    AbbeError
        As `ask`.
    """
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.settimeout(within)
            connection.connect(address)
            connection.sendall(request.model_dump_json().encode() + b"\n")
            line = _line(connection)
    except (FileNotFoundError, ConnectionRefusedError):
        raise AbbeError(f"no correction runs that listens at {place}") from None
    except TimeoutError:
        raise AbbeError(f"the correction at {place} does not answer") from None
    except OSError as error:
        raise AbbeError(f"{place}: {error.strerror}") from None
    try:
        answer = json.loads(line)
    except ValueError:
        raise AbbeError(f"{place}: what answers there is no correction of Abbe") from None
    if not isinstance(answer, dict) or not answer.get("ok"):
        reason = answer.get("error") if isinstance(answer, dict) else None
        raise AbbeError(str(reason or "refused"))
    return answer


def _line(connection: socket.socket) -> bytes:
    found = bytearray()
    while not found.endswith(b"\n") and len(found) <= LONGEST_ANSWER:
        more = connection.recv(LONGEST)
        if not more:
            break
        found += more
    return bytes(found)
