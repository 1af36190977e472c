"""One trial: a real ``abbe run``, a tormented machine, and the checker, from beginning to end."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from abbe.drivers.simulated.torment.configuration import write_configuration
from abbe.drivers.simulated.torment.judge.checker import Checker, between
from abbe.drivers.simulated.torment.judge.evidence import WireLog
from abbe.drivers.simulated.torment.judge.promises import Promises, Tally, Violation
from abbe.drivers.simulated.torment.judge.words import COMPENSATING
from abbe.drivers.simulated.torment.kinds import LAST
from abbe.drivers.simulated.torment.loop import Loop
from abbe.drivers.simulated.torment.machine import TormentMachine
from abbe.drivers.simulated.torment.motion import RandomMotion
from abbe.drivers.simulated.torment.reported import ReportedViolations
from abbe.drivers.simulated.torment.script import Script
from abbe.drivers.simulated.torment.waits import ProcessorWaits
from abbe.drivers.simulated.torment.wires import wire_class
from abbe.drivers.simulated.torment.wires.pty import PtyProbe

PATIENCE = 60.0
"""s for Abbe to come up, or to end, on a busy computer."""


@dataclass(frozen=True)
class TrialOutcome:
    """What a trial has shown.

    Attributes
    ----------
    violations
        Promises that were not kept.
    tally
        How much was judged.
    script
        What went wrong when.
    stalls
        How often this process stood still.
    lines
        The violations for people, one a second of each promise, with what went on.
    """

    violations: list[Violation]
    tally: Tally
    script: Script
    stalls: int
    lines: list[str]


class Trial:
    """One run.

    Parameters
    ----------
    protocol, variant, kinds, seed, seconds
        What is tormented, with what, and for how long (s).
    folder
        Where the configuration, the wire's log and Abbe's journal go.
    """

    def __init__(
        self,
        protocol: str,
        *,
        seed: int,
        seconds: float,
        folder: Path,
        variant: str = "plain",
        kinds: Sequence[str] = (),
    ) -> None:
        made = wire_class(protocol)
        name = f"{protocol} {variant} {seed}"
        self.script = Script(name, [k for k in made.KINDS if not kinds or k in kinds], seconds)
        self._seconds = seconds
        self._folder = folder
        self._loop = Loop()
        self._log = WireLog(folder / "wire.log", time.monotonic())
        self._waits = ProcessorWaits(self._loop)
        promises = Promises(blind=made.BLIND)
        self._checker = Checker(promises, self._stalled, self._waits.between)
        motion = RandomMotion(random.Random(name), time.monotonic())
        self._machine = TormentMachine(motion, self.script, self._checker)
        self._wire = made(self._loop, self._machine, self._log, folder, variant)
        self._promises = promises
        self._calm_since = 0.0
        self._findings = ReportedViolations(self._checker, [self.script], self._log)

    def run(self) -> TrialOutcome:
        """Start Abbe, torment it, end it, judge."""
        self._log.open()
        self._wire.start()
        probe = PtyProbe(self._loop)
        config = write_configuration(self._folder, self._wire, self._promises)
        with (self._folder / "abbe.log").open("wb") as said:
            abbe = subprocess.Popen(
                [sys.executable, "-m", "abbe.daemon", "run", str(config)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=said,
                cwd=self._folder,
            )
            self._waits.begin(abbe.pid)
            try:
                self._torment(abbe)
            finally:
                if abbe.poll() is None:
                    abbe.kill()
                    abbe.wait()
                probe.close()
                self._wire.close()
                self._loop.close()
                self._log.close()
        return TrialOutcome(
            self._checker.violations,
            self._checker.tally,
            self.script,
            len(self._loop.stalls),
            self._findings.lines,
        )

    def _torment(self, abbe: subprocess.Popen[bytes]) -> None:
        limit = time.monotonic() + PATIENCE
        while not self._checker.word & COMPENSATING:
            now = self._turn()
            if abbe.poll() is not None or now > limit:
                self._fail(now, f"Abbe did not come up in {PATIENCE:g} s; see abbe.log")
                return
        self.script.start(time.monotonic())
        self._log.say("!", "the script begins")
        halts = deque(t for t in self.script.torments if t.kind in LAST)
        began = self._calm_since = time.monotonic()
        while (now := self._turn()) < began + self._seconds and abbe.poll() is None:
            self._recover(now)
            if halts and halts[0].begin - 0.2 < now - began:
                self._machine.motion.halt(now, halts[0].end - halts[0].begin + 0.4)
                halts.popleft()
        if abbe.poll() is not None:
            self._fail(now, f"Abbe ended by itself with exit status {abbe.returncode}")
            return
        self._log.say("!", "SIGTERM")
        self._checker.ending = time.monotonic()
        abbe.send_signal(signal.SIGTERM)
        limit = time.monotonic() + PATIENCE
        while abbe.poll() is None:
            if self._turn() > limit:
                self._fail(limit, f"Abbe did not end within {PATIENCE:g} s of SIGTERM")
                return
        for _ in range(20):
            self._turn()
        self._checker.ended(abbe.returncode, time.monotonic())
        self._findings.tell()

    def _recover(self, now: float) -> None:
        """Note how long it takes in calm until all is corrected in full."""
        around = self.script.around(now, 0.0)
        if around or self._checker.word & COMPENSATING:
            self._calm_since = now
        tally = self._checker.tally
        tally.slowest_recovery = max(tally.slowest_recovery, now - self._calm_since)

    def _turn(self) -> float:
        now = self._loop.turn()
        self._waits.note(now)
        self._findings.tell()
        return now

    def _fail(self, now: float, text: str) -> None:
        self._checker.violations.append(Violation(now, "end", text))
        self._findings.tell()

    def _stalled(self, early: float, late: float) -> bool:
        return between(self._loop.stalls[-20:], early, late)
