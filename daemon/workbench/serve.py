"""Serving the workbench on 127.0.0.1 until Ctrl-C, or until a person ends it in the browser."""

from __future__ import annotations

import contextlib
import logging
import signal
import socket
from collections.abc import Callable, Iterator
from typing import Any

import uvicorn

from abbe.compcore.errors import InputError
from abbe.daemon.http.bounded import BoundedProtocol
from abbe.daemon.workbench.application import application
from abbe.daemon.workbench.door import WorkbenchDoor
from abbe.daemon.workbench.session import Workbench

_HOST = "127.0.0.1"
_HEAD = 16_384
"""Bytes of a request's head that are read."""


def serve(bench: Workbench, port: int, invite: Callable[[str], None]) -> None:
    """Serve until the end.

    Parameters
    ----------
    bench
        The session.
    port
        0: any that is free.
    invite
        Is told each address at which one browser may enter.

    Raises
    ------
    InputError
        For a port that cannot be had.
    """
    made = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((_HOST, port))
    except OSError as error:
        made.close()
        raise InputError(
            f"cannot listen there: {error.strerror}", field="--port", found=port,
            expected="another port, or none: one that is free is taken",
        ) from None  # fmt: skip
    with made:
        # from here on a browser waits instead of being refused
        made.listen(64)
        server: _LoopbackServer

        def end() -> None:
            server.should_exit = True

        door = WorkbenchDoor(application(bench, end), made.getsockname()[1], invite)
        config = uvicorn.Config(
            door,
            http=BoundedProtocol,
            ws="none",
            lifespan="off",
            loop="asyncio",
            log_config=None,
            log_level=logging.ERROR,
            access_log=False,
            proxy_headers=False,
            server_header=False,
            timeout_graceful_shutdown=1,
            h11_max_incomplete_event_size=_HEAD,
        )
        server = _LoopbackServer(config)
        try:
            server.run(sockets=[made])
        finally:
            bench.close()


class _LoopbackServer(uvicorn.Server):
    """A server for which Ctrl-C is the ordinary end."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """End at SIGINT and SIGTERM; a second one ends at once."""
        known: dict[int, Any] = {}
        for number in (signal.SIGINT, signal.SIGTERM):
            known[number] = signal.signal(number, self.handle_exit)
        try:
            yield
        finally:
            for signalled, handler in known.items():
                signal.signal(signalled, handler)
