"""The line to systemd: ready, alive, reloading, stopping (sd_notify(3)).

A datagram to the socket that ``NOTIFY_SOCKET`` names; without it, as in a terminal, nothing is
sent. It never waits and never fails: a manager that does not listen must not stop a machine.
"""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections.abc import Mapping
from typing import Self

_MICRO = 1e-6


class Notifier:
    """The socket of the service manager.

    Parameters
    ----------
    address
        A path, or ``@NAME`` in Linux's abstract namespace; empty: nothing is sent.
    watchdog
        s within which the manager wants to hear that the service is alive; 0: it does not.

    Attributes
    ----------
    watchdog
        As given.
    """

    def __init__(self, address: str = "", watchdog: float = 0.0) -> None:
        self.watchdog = watchdog
        self._socket: socket.socket | None = None
        if not address:
            return
        made = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        made.setblocking(False)
        try:
            made.connect("\0" + address[1:] if address.startswith("@") else address)
        except (OSError, ValueError):
            made.close()
        else:
            self._socket = made

    @classmethod
    def of_environment(cls, environment: Mapping[str, str] = os.environ) -> Self:
        """The manager that started this process, by ``NOTIFY_SOCKET`` and ``WATCHDOG_USEC``.

        A watchdog that is meant for another process (``WATCHDOG_PID``) is none.
        """
        watchdog = 0.0
        if environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid()):
            with contextlib.suppress(ValueError):
                watchdog = max(0.0, int(environment.get("WATCHDOG_USEC", "0")) * _MICRO)
        return cls(environment.get("NOTIFY_SOCKET", ""), watchdog)

    @property
    def there(self) -> bool:
        """Whether somebody listens."""
        return self._socket is not None

    def ready(self) -> None:
        """The service does its work (also after a reload)."""
        self._send("READY=1")

    def reloading(self) -> None:
        """The service reads its configuration anew; `ready` ends it."""
        self._send(f"RELOADING=1\nMONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def stopping(self) -> None:
        """The service ends, with its ramp."""
        self._send("STOPPING=1")

    def alive(self) -> None:
        """The cycle goes round."""
        self._send("WATCHDOG=1")

    def status(self, words: str) -> None:
        """What ``systemctl status`` shows; one line."""
        self._send(f"STATUS={' '.join(words.split())}")

    def close(self) -> None:
        """Say no more."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, message: str) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.send(message.encode("utf-8", "replace"))
