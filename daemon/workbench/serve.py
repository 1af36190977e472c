"""Serving the workbench on 127.0.0.1 until Ctrl-C, or until a person ends it in the browser."""

from __future__ import annotations

import contextlib
import signal
import socket
from collections.abc import Callable, Iterator
from typing import Any

import uvicorn

from abbe.daemon.collector import as_a_service
from abbe.daemon.http.bounded import bounded_config
from abbe.daemon.workbench.application import application
from abbe.daemon.workbench.entrance.door import SESSION, WorkbenchDoor
from abbe.daemon.workbench.few_arenas import share_memory
from abbe.daemon.workbench.views import WorkbenchViews


def serve(
    views: WorkbenchViews,
    made: socket.socket,
    invite: Callable[[str], None],
    *,
    key: str = "",
    session: float = SESSION,
) -> None:
    """Serve until the end.

    Parameters
    ----------
    views
        What is shown.
    made
        From `abbe.daemon.workbench.entrance.address.listening`.
    invite, key, session
        As `WorkbenchDoor` has them.
    """
    share_memory()
    server: _LoopbackServer

    def end() -> None:
        server.should_exit = True

    app, port = application(views, end), made.getsockname()[1]
    door = WorkbenchDoor(app, port, invite, key=key, session=session)
    server = _LoopbackServer(bounded_config(door), views.end_streams)
    try:
        with as_a_service():
            server.run(sockets=[made])
    finally:
        views.close()


class _LoopbackServer(uvicorn.Server):
    """A server for which Ctrl-C is the ordinary end.

    Parameters
    ----------
    config
        Of uvicorn.
    ending
        Called when it ends, before it waits for what is under way.
    """

    def __init__(self, config: uvicorn.Config, ending: Callable[[], None]) -> None:
        super().__init__(config)
        self._ending = ending

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End in an orderly way."""
        self._ending()
        await super().shutdown(sockets)

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
