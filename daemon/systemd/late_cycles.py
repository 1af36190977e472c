"""Cycles that do not come: for want of a processor, or because something hangs; said in words.

The watchdog cannot tell the two apart, and ends either. What the journal says beforehand can: the
kernel counts for how long a thread was ready to run and had no processor
(https://docs.kernel.org/scheduler/sched-stats.html#proc-pid-schedstat).
"""

from __future__ import annotations

import contextlib
import faulthandler
import logging
import math
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from abbe.daemon.pipeline.record import CycleRecord

logger = logging.getLogger("abbe.systemd")

_LATE = 1.0
"""s without a cycle, and at least as many periods as below, of which something is said."""
_PERIODS = 5.0
_AGAIN = 60.0
"""s from one event of a late cycle to the next."""
_SHARE = 0.5
"""Part of the watchdog's time after which a cycle that has not come yet is one that is late."""
_LOOKS = 8.0
"""Looks within the watchdog's time."""
_NANO = 1e-9


class ProcessorWait:
    """How long one thread has been ready to run, and no processor was given to it.

    Parameters
    ----------
    thread
        As `threading.get_native_id` has it; default: the one that calls.
    """

    def __init__(self, thread: int | None = None) -> None:
        path = Path(f"/proc/self/task/{thread or threading.get_native_id()}/schedstat")
        self._file = -1
        with contextlib.suppress(OSError):
            self._file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)

    def __call__(self) -> float:
        """So far, s; 0 where the kernel does not count it."""
        if self._file < 0:
            return 0.0
        try:
            return int(os.pread(self._file, 100, 0).split()[1]) * _NANO
        except (OSError, ValueError, IndexError):
            return 0.0

    def close(self) -> None:
        """Count no more; safe to call twice."""
        if self._file >= 0:
            os.close(self._file)
        self._file = -1


class LateCycles:
    """A listener of the pipeline that says why no cycle came, once it is late by seconds.

    Parameters
    ----------
    period
        Of the cycle, s.
    watchdog
        s after which the manager ends a process whose cycle does not come round; 0: it does not.
        Then a thread says beforehand what it sees.
    clock
        Monotonic, s.
    wait
        How long the cycle's thread has waited for a processor so far, s; default: as the kernel
        counts it for the one that enters `running`.
    """

    def __init__(
        self,
        period: float,
        watchdog: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[], float] | None = None,
    ) -> None:
        self._late = max(_LATE, _PERIODS * period)
        self._watchdog = watchdog
        self._clock = clock
        self._wait = wait
        self._last: tuple[float, float] | None = None
        self._quiet_until = -math.inf
        self._ended = threading.Event()

    def __call__(self, _record: CycleRecord) -> None:
        """Take note of a cycle that came to its end."""
        if self._wait is None:
            return
        now, waited = self._clock(), self._wait()
        last, self._last = self._last, (now, waited)
        if last is None or now - last[0] <= self._late or now < self._quiet_until:
            return
        silence, missing = now - last[0], waited - last[1]
        if missing > silence / 2:
            self._quiet_until = now + _AGAIN
            logger.warning(
                "the computer gave Abbe no processor for %.1f s: no cycle came for %.1f s",
                missing,
                silence,
                extra={"event": "no processor"},
            )

    @contextmanager
    def running(self) -> Iterator[None]:
        """While the context lasts cycles are to come, in the thread that enters it."""
        counted = ProcessorWait() if self._wait is None else None
        self._wait = self._wait or counted
        thread = None
        if self._watchdog:
            # the manager ends what hangs by SIGABRT: then the journal has where each thread was
            if not faulthandler.is_enabled() and sys.__stderr__ is not None:
                with contextlib.suppress(OSError, ValueError):
                    faulthandler.enable(sys.__stderr__)
            thread = threading.Thread(target=self._watch, name="late cycles", daemon=True)
            thread.start()
        try:
            yield
        finally:
            self._ended.set()
            if thread is not None:
                thread.join()
            if counted is not None:
                self._wait = None
                counted.close()

    def _watch(self) -> None:
        said: tuple[float, float] | None = None
        while not self._ended.wait(self._watchdog / _LOOKS):
            last, wait = self._last, self._wait
            if last is None or wait is None or last is said:
                continue
            silence, missing = self._clock() - last[0], wait() - last[1]
            if silence > max(_SHARE * self._watchdog, self._late):
                said = last
                self._say_silence(silence, missing)

    def _say_silence(self, silence: float, missing: float) -> None:
        if missing > silence / 2:
            logger.warning(
                "the computer gives Abbe no processor: %.1f of the last %.1f s; without a cycle "
                "in %g s the service manager begins it anew",
                missing,
                silence,
                self._watchdog,
                extra={"event": "no processor"},
            )
        else:
            logger.error(
                "the cycle hangs since %.1f s, and not for want of a processor (%.1f s): a driver "
                "does not come back, or the process was stopped; without a cycle in %g s the "
                "service manager begins it anew",
                silence,
                missing,
                self._watchdog,
                extra={"event": "cycle hangs"},
            )
