"""A real LinuxCNC without a screen, for tests: started, homed, moved, ended, killed.

A computer can run only one LinuxCNC; a lock keeps test runs that happen at the same time apart.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
import uuid
from pathlib import Path
from types import TracebackType
from typing import Any, Self

EXAMPLE = Path(__file__).parents[4] / "examples" / "linuxcnc"
PYTHON = "/usr/bin/python3"
LOCK = Path("/tmp/abbe-linuxcnc-tests.lock")
PATIENCE = 60.0
"""s that starting and ending may take on a busy machine."""

# Run by the system's Python: one order a line, one answer a line.
OPERATOR = """
import json, os, sys, time
out = os.fdopen(os.dup(1), "w", buffering=1)
os.dup2(2, 1)
import linuxcnc
c, s, e = linuxcnc.command(), linuxcnc.stat(), linuxcnc.error_channel()
def done(): c.wait_complete(20)
def on(): c.state(linuxcnc.STATE_ESTOP_RESET); done(); c.state(linuxcnc.STATE_ON); done()
def off(): c.state(linuxcnc.STATE_OFF); done()
def home():
    c.mode(linuxcnc.MODE_MANUAL); done(); c.teleop_enable(0); done(); c.home(-1); done()
    end = time.time() + 20
    while time.time() < end:
        s.poll()
        if all(s.homed[:s.joints]): break
        time.sleep(0.02)
    c.mode(linuxcnc.MODE_MDI); done()
def rests():
    s.poll()
    over = s.exec_state in (linuxcnc.EXEC_DONE, linuxcnc.EXEC_ERROR) and s.queue == 0
    return s.interp_state == linuxcnc.INTERP_IDLE and over and s.inpos
def settle():
    # one look may fall between an order's being taken up and its move's beginning
    end, looks = time.time() + 60, 0
    while time.time() < end and looks < 4:
        looks = looks + 1 if rests() else 0
        time.sleep(0.01)
def mdi(text):
    # what is ordered while another order is being read can be lost
    c.mode(linuxcnc.MODE_MDI); done(); settle(); c.mdi(text); done(); settle()
def load(path): c.mode(linuxcnc.MODE_AUTO); done(); c.program_open(path); done()
def step(): c.auto(linuxcnc.AUTO_STEP)
def state():
    s.poll()
    rests = s.inpos and s.queue == 0 and s.exec_state != linuxcnc.EXEC_WAITING_FOR_DELAY
    return s.interp_state == linuxcnc.INTERP_IDLE, bool(rests), s.motion_line
def run(): c.auto(linuxcnc.AUTO_RUN, 0)
def resume(): c.auto(linuxcnc.AUTO_RESUME)
def abort(): c.abort(); done()
def feed(scale): c.feedrate(scale); done()
print(json.dumps({"ready": True}), file=out)
for line in sys.stdin:
    name, *words = json.loads(line)
    answer = globals()[name](*words)
    errors = []
    while (told := e.poll()): errors.append(told[1])
    print(json.dumps({"errors": errors, "answer": answer}), file=out)
"""


class Machine:
    """LinuxCNC with the example's configuration, in a folder of its own.

    Parameters
    ----------
    changes
        Text → its replacement in the INI file.
    """

    def __init__(self, changes: dict[str, str] | None = None) -> None:
        self._changes = changes or {}
        self._mark = f"ABBE_LINUXCNC_TEST={uuid.uuid4().hex}".encode()
        self._process: subprocess.Popen[bytes] | None = None
        self._operator: subprocess.Popen[str] | None = None

    def __enter__(self) -> Self:
        assert shutil.which("linuxcnc"), "linuxcnc is missing: apt install linuxcnc-uspace"
        self._lock = LOCK.open("w")
        fcntl.flock(self._lock, fcntl.LOCK_EX)
        # LinuxCNC's real-time part runs as nobody when root starts it, and needs to get in here.
        self.folder = Path(tempfile.mkdtemp(prefix="abbe-lcnc-", dir="/tmp"))
        self.folder.chmod(0o777)
        for file in EXAMPLE.iterdir():
            if file.suffix in (".ini", ".hal", ".py"):
                shutil.copy(file, self.folder)
        ini = self.folder / "mill.ini"
        text = ini.read_text()
        for old, new in self._changes.items():
            assert old in text
            text = text.replace(old, new)
        ini.write_text(text)
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self.stop()
        finally:
            shutil.rmtree(self.folder, ignore_errors=True)
            self._lock.close()

    def start(self) -> None:
        """Start LinuxCNC and wait until its screen is up: the last thing that it starts."""
        name, value = self._mark.decode().split("=")
        environment = os.environ | {name: value}
        if os.getuid() == 0:
            environment |= {"RTAPI_UID": "65534", "RTAPI_FIFO_PATH": str(self.folder / "fifo")}
        with (self.folder / "output").open("w") as output:
            self._process = subprocess.Popen(
                ["linuxcnc", "-r", "mill.ini"],
                cwd=self.folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self._until(lambda: self._screen() is not None, "did not start")
        time.sleep(0.3)

    def stop(self) -> None:
        """End LinuxCNC as a user does: close its screen."""
        self._end_operator()
        screen = self._screen()
        if screen is not None:
            os.kill(screen, signal.SIGTERM)
        if self._process is not None:
            try:
                self._process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self.kill()
            self._process = None
        for pid in self._all():
            os.kill(pid, signal.SIGKILL)

    def kill(self) -> None:
        """Kill every process of it at once, as a power cut does."""
        self._end_operator()
        while pids := self._all():
            for pid in pids:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            if self._process is not None:
                self._process.wait(PATIENCE)

    def tell_real_time(self, number: signal.Signals) -> None:
        """Send its real-time process a signal: SIGSTOP has the servo thread stand still."""
        for pid in self._all():
            with contextlib.suppress(OSError):
                if b"rtapi_app" in Path(f"/proc/{pid}/cmdline").read_bytes():
                    os.kill(pid, number)

    def order(self, *words: Any) -> list[str]:
        """Have the operator do something; LinuxCNC's complaints since the last order."""
        errors: list[str] = self._told(words)["errors"]
        return errors

    def state(self) -> tuple[bool, bool, int]:
        """Whether no program runs, whether it rests, and the line for which it moved last."""
        idle, rests, moved = self._told(("state",))["answer"]
        return idle, rests, moved

    def _told(self, words: tuple[Any, ...]) -> dict[str, Any]:
        if self._operator is None:
            self._operator = subprocess.Popen(
                [PYTHON, "-c", OPERATOR],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
            self._answer()
        assert self._operator.stdin is not None
        self._operator.stdin.write(json.dumps(words) + "\n")
        self._operator.stdin.flush()
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        assert self._operator is not None and self._operator.stdout is not None  # noqa: PT018
        line = self._operator.stdout.readline()
        assert line, "the operator's process ended"
        answer: dict[str, Any] = json.loads(line)
        return answer

    def _end_operator(self) -> None:
        operator, self._operator = self._operator, None
        if operator is not None:
            operator.kill()
            operator.communicate()

    def _all(self) -> list[int]:
        found = []
        for environ in Path("/proc").glob("[0-9]*/environ"):
            with contextlib.suppress(OSError):
                if self._mark in environ.read_bytes():
                    found.append(int(environ.parent.name))
        return found

    def _screen(self) -> int | None:
        for pid in self._all():
            with contextlib.suppress(OSError):
                if b"no_screen.py" in Path(f"/proc/{pid}/cmdline").read_bytes():
                    return pid
        return None

    def _until(self, true: Any, why: str) -> None:
        deadline = time.monotonic() + PATIENCE
        while not true():
            output = (self.folder / "output").read_text(errors="replace")
            assert time.monotonic() < deadline, f"LinuxCNC {why}:\n{output}"
            ended = self._process is not None and self._process.poll() is not None
            assert not ended, f"LinuxCNC ended:\n{output}"
            time.sleep(0.05)
