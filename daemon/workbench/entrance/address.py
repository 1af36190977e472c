"""Where the workbench listens, and the address that lets one browser in."""

from __future__ import annotations

import secrets
import socket

from abbe.compcore.errors import InputError

_HOST = "127.0.0.1"
ENTRANCE = "/enter"
"""Path of the address that is printed."""


def listening(port: int) -> socket.socket:
    """A socket on 127.0.0.1; from now on a browser waits instead of being refused.

    Parameters
    ----------
    port
        0: any that is free.

    Raises
    ------
    InputError
        For a port that cannot be had.
    """
    made = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((_HOST, port))
        made.listen(64)
    except OSError as error:
        made.close()
        raise InputError(
            f"cannot listen there: {error.strerror}", field="--port", found=port,
            expected="another port, or none: one that is free is taken",
        ) from None  # fmt: skip
    return made


def new_key() -> str:
    """What makes an address good for one browser."""
    return secrets.token_urlsafe(24)


def address_of(port: int, key: str) -> str:
    """Where one browser may enter."""
    return f"http://{_HOST}:{port}{ENTRANCE}?key={key}"
