"""A supervisor as systemd is one: starts Abbe, hears READY and the watchdog, starts it again."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from abbe.drivers.simulated.torment.judge.evidence import WireLog
from abbe.drivers.simulated.torment.loop import Loop, Moment

WATCHDOG = 4.0
"""s without a sign of life until the process is killed."""
START = 60.0
"""s for it to be ready, on a busy computer."""
_OWN = ("Anonymous:", "Swap:")
_FAKETIME = "*/faketime/libfaketime.so.1"


def clock_library() -> Path | None:
    """Debian's libfaketime, which has a process see another date; None where it is not there."""
    return next(iter(sorted(Path("/usr/lib").glob(_FAKETIME))), None)


class Supervisor:
    """Keeps one ``abbe run`` alive.

    Parameters
    ----------
    loop, log
        Of the soak.
    folder, config
        Where it runs, and with which configuration.

    Attributes
    ----------
    lives
        How often it was started.
    restarts
        Why it was started again: reason → how often.
    status
        What it last said of itself.
    ready
        Whether it has said that it runs.
    """

    def __init__(self, loop: Loop, log: WireLog, folder: Path, config: Path) -> None:
        self._loop = loop
        self._log = log
        self._folder = folder
        self._config = config
        self._process: subprocess.Popen[bytes] | None = None
        self._said: int | None = None
        self._notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._notify.bind(str(folder / "notify"))
        self._loop.watch(self._notify.fileno(), self._notified)
        self._clock = folder / "clock"
        self._clock.write_text("+0", encoding="ascii")
        self._journal = (folder / "abbe.log").open("ab")
        self._due = float("inf")
        self._began = 0.0
        self.lives = 0
        self.restarts: dict[str, int] = {}
        self.status = ""
        self.ready = False

    @property
    def pid(self) -> int:
        """Of the present life."""
        return self._abbe.pid

    @property
    def _abbe(self) -> subprocess.Popen[bytes]:
        if self._process is None:
            raise RuntimeError("not started")
        return self._process

    @property
    def age(self) -> float:
        """Of the present life, s."""
        return time.monotonic() - self._began

    def start(self) -> None:
        """A new life."""
        library = clock_library()
        clock = (
            {}
            if library is None
            else {
                "LD_PRELOAD": str(library),
                "FAKETIME_TIMESTAMP_FILE": str(self._clock),
                "FAKETIME_CACHE_DURATION": "1",
                "FAKETIME_DONT_FAKE_MONOTONIC": "1",
            }
        )
        self._process = subprocess.Popen(
            [sys.executable, "-m", "abbe.daemon", "run", str(self._config)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            cwd=self._folder,
            env={
                **os.environ,
                **clock,
                "NOTIFY_SOCKET": str(self._folder / "notify"),
                "WATCHDOG_USEC": str(round(1e6 * WATCHDOG)),
            },
        )
        pipe = self._process.stderr
        if pipe is not None:
            os.set_blocking(pipe.fileno(), False)
            self._said = pipe.fileno()
            self._loop.watch(self._said, self._log_readable)
        self.lives += 1
        self.ready = False
        self._began = time.monotonic()
        self._due = self._began + START

    def look(self, now: float) -> str:
        """Why the present life is over, at a monotonic time (s); empty: it goes on.

        A process that gave no sign of life for `WATCHDOG` is killed.
        """
        if (code := self._abbe.poll()) is not None:
            return f"it ended by itself with exit status {code}"
        if now > self._due:
            self.kill()
            return "watchdog" if self.ready else f"not ready within {START:g} s"
        return ""

    def again(self, why: str) -> None:
        """Bury it and count why."""
        self._bury()
        self.restarts[why] = self.restarts.get(why, 0) + 1

    def kill(self) -> None:
        """SIGKILL."""
        self._abbe.kill()
        self._abbe.wait()

    def freeze(self) -> None:
        """SIGSTOP."""
        self._abbe.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """SIGCONT."""
        self._abbe.send_signal(signal.SIGCONT)

    def reload(self) -> None:
        """SIGHUP, as ``systemctl reload`` sends it."""
        self._abbe.send_signal(signal.SIGHUP)

    def end(self) -> None:
        """SIGTERM."""
        self._due = float("inf")
        self._abbe.send_signal(signal.SIGTERM)

    @property
    def exit_status(self) -> int | None:
        """Of the present life; None while it lives."""
        return self._abbe.poll()

    def fill_disk(self, full: bool) -> None:
        """No file of it can grow any more, or all can again."""
        _, hard = resource.prlimit(self.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(self.pid, resource.RLIMIT_FSIZE, (0 if full else hard, hard))

    def set_clock(self, seconds: float) -> None:
        """The date that it sees is so many s off."""
        made = self._clock.with_suffix(".new")
        made.write_text(f"{seconds:+.0f}", encoding="ascii")
        made.replace(self._clock)

    def memory(self) -> float:
        """Its own memory, MB."""
        return _own_memory(self.pid)

    def http_memory(self) -> float:
        """That of its HTTP process, MB; NaN while there is none."""
        try:
            said = Path(f"/proc/{self.pid}/task/{self.pid}/children").read_text(encoding="ascii")
        except OSError:
            return float("nan")
        return _own_memory(int(said.split()[0])) if said.split() else float("nan")

    def close(self) -> None:
        """End everything."""
        if self._process is not None and self._process.poll() is None:
            self.kill()
        self._bury()
        self._loop.forget(self._notify.fileno())
        self._notify.close()
        self._journal.close()

    def _bury(self) -> None:
        if self._said is not None:
            self._log_readable(Moment(0.0, 0.0))
            self._loop.forget(self._said)
            self._said = None
        if self._process is not None and self._process.stderr is not None:
            self._process.stderr.close()

    def _log_readable(self, moment: Moment) -> None:
        if self._said is None:
            return
        with contextlib.suppress(BlockingIOError):
            while data := os.read(self._said, 65536):
                self._journal.write(data)
                self._journal.flush()
            # an end of file that is not taken away would be ready for ever
            self._loop.forget(self._said)

    def _notified(self, moment: Moment) -> None:
        with contextlib.suppress(BlockingIOError):
            while True:
                for line in self._notify.recv(8192).decode().splitlines():
                    name, _, value = line.partition("=")
                    if name == "READY":
                        self.ready = True
                        self._log.say("!", "READY")
                    elif name == "STATUS":
                        self.status = value
                    if name == "WATCHDOG" or (name == "READY" and self._due > moment.late):
                        self._due = time.monotonic() + WATCHDOG


def _own_memory(pid: int) -> float:
    """What a process has taken for itself, in memory or swapped out, MB; NaN where it is gone.

    Not the pages of files that it reads: how many of its libraries lie in memory is the kernel's
    doing, and those of its database belong to the computer.
    """
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
    except OSError:
        return float("nan")
    kilobytes = [int(line.split()[1]) for line in text.splitlines() if line.startswith(_OWN)]
    return sum(kilobytes) * 1024e-6 if kilobytes else float("nan")
