"""Uploads a machine's records to the plant's store, for ever: each thing once, whatever is cut off.

What is uploaded and how far it came are committed together, and every row has a key: what is sent
a second time changes nothing.
"""

from __future__ import annotations

import logging
import random
import sqlite3
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

import psycopg

from abbe.compcore.errors import AbbeError
from abbe.daemon.fleet.store.connecting import Store, connect, one_line
from abbe.daemon.fleet.store.migrating import require_current
from abbe.daemon.fleet.uploading.machine_upload import MachineUpload

_REASONS = 5
"""Reasons why nothing is uploaded that are said, until it is again."""


class Uploader:
    """One machine and its store.

    Parameters
    ----------
    task
        As `FleetSetup.task` makes it, with what `StoreProcess` adds to it.
    say
        Takes a level and a sentence for the journal.
    clock
        s since 1970.

    Attributes
    ----------
    connections
        Attempts to connect.
    """

    def __init__(
        self,
        task: Mapping[str, Any],
        say: Callable[[int, str], None],
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._task, self._say, self._clock = task, say, clock
        self._said: set[str] = set()
        self._lock = threading.Lock()
        self._status: tuple[dict[str, Any], float] | None = None
        self.connections = 0

    def take(self, status: dict[str, Any]) -> None:
        """Take what the run says of itself now; the last one is uploaded."""
        with self._lock:
            self._status = status, time.monotonic()

    def run(self, ending: threading.Event) -> None:
        """Upload until it is ended; whatever the store does, nothing but that ends it."""
        delay = 0.0
        while not ending.is_set():
            began = time.monotonic()
            try:
                self._connected(ending)
            except (psycopg.Error, AbbeError, sqlite3.Error, OSError, ValueError) as error:
                self._lost(error)
            if time.monotonic() - began > self._task["reconnect_max"]:
                delay = 0.0
            delay = min(2.0 * delay or self._task["reconnect_min"], self._task["reconnect_max"])
            ending.wait(delay * random.uniform(0.5, 1.0))

    def once(self) -> None:
        """Connect, upload all that there is, and end.

        Raises
        ------
        AbbeError
            Where the store does not know the machine, or is not of this Abbe.
        psycopg.Error, sqlite3.Error, OSError, ValueError
            When something cannot be reached or used.
        """
        self.connections += 1
        with connect(self._task) as store:
            self._machine(store).everything()

    def _connected(self, ending: threading.Event) -> None:
        self.connections += 1
        with connect(self._task) as store:
            upload = self._machine(store)
            reached = False
            while not ending.is_set():
                upload.everything(ending.is_set)
                if not reached:
                    where = f"{self._task['host']}:{self._task['port']}"
                    self._say(logging.INFO, f"uploading to the store at {where}")
                    reached = True
                self._said.clear()
                ending.wait(self._task["every"])

    def _machine(self, store: Store) -> MachineUpload:
        require_current(store)
        return MachineUpload(store, self._task, self._latest, self._say, self._clock)

    def _latest(self) -> tuple[dict[str, Any], float] | None:
        with self._lock:
            return self._status

    def _lost(self, error: Exception) -> None:
        """Say what is wrong, once until it is right: two reasons may come in turn for days."""
        why = one_line(error)
        if why not in self._said and len(self._said) < _REASONS:
            self._said.add(why)
            self._say(logging.WARNING, f"{why}; the machine's records wait for the store")
