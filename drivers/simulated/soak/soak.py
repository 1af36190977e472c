"""One soak: a tormented machine, a supervised Abbe, faults of its computer, and the checker."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from abbe.drivers.simulated.soak.clients import Clients
from abbe.drivers.simulated.soak.computer import ComputerFaults
from abbe.drivers.simulated.soak.configuration import write_configurations
from abbe.drivers.simulated.soak.faults import CALM, COMPUTER_FAULTS, DEADLY
from abbe.drivers.simulated.soak.http_clients import ClientCounts
from abbe.drivers.simulated.soak.memory import MemoryCurve
from abbe.drivers.simulated.soak.supervisor import WATCHDOG, Supervisor
from abbe.drivers.simulated.torment.judge.checker import Checker, between
from abbe.drivers.simulated.torment.judge.evidence import WireLog
from abbe.drivers.simulated.torment.judge.promises import Promises, Tally, Violation
from abbe.drivers.simulated.torment.judge.words import COMPENSATING
from abbe.drivers.simulated.torment.kinds import LAST
from abbe.drivers.simulated.torment.loop import Loop
from abbe.drivers.simulated.torment.machine import TormentMachine
from abbe.drivers.simulated.torment.motion import RandomMotion
from abbe.drivers.simulated.torment.reported import ReportedViolations
from abbe.drivers.simulated.torment.script import Script, Torment
from abbe.drivers.simulated.torment.waits import ProcessorWaits
from abbe.drivers.simulated.torment.wires.modbus_tcp import ModbusTcp

_COMES_UP = 60.0
"""s in calm within which all must be corrected in full, on a busy computer."""
_SETTLING = 4.0
"""s after any fault in which no cycle is missed: links come back, the correction ramps."""
_IN_TIME = 1.5
"""s with a processor in which a sign of life is promised; it comes each second."""
_EDGES = 0.15
"""Part of the time at the beginning, and at the end, in which Abbe is killed; between, it lives."""


@dataclass(frozen=True)
class SoakOutcome:
    """What a soak has shown.

    Attributes
    ----------
    violations
        Promises that were not kept.
    lines
        They, for people.
    tally
        How much was judged.
    faults
        Kind → how often, wire's and computer's.
    restarts
        Why Abbe was started again → how often.
    memory, http_memory
        Over the lives, of Abbe and of its HTTP process.
    cycles, missed
        In calm: those that came, and those that should have come besides.
    answers
        How many answers clients got at the control socket.
    http
        What clients met at the HTTP interface.
    """

    violations: list[Violation]
    lines: list[str]
    tally: Tally
    faults: dict[str, int]
    restarts: dict[str, int]
    memory: MemoryCurve
    http_memory: MemoryCurve
    cycles: int
    missed: int
    answers: int
    http: ClientCounts


class Soak:
    """One run.

    Parameters
    ----------
    seed, seconds
        The same seed makes the same scripts; for how long.
    folder
        Where configuration, records, the wire's log and Abbe's journal go.
    without
        Kinds of fault that are left out.
    """

    def __init__(
        self, *, seed: int, seconds: float, folder: Path, without: Sequence[str] = ()
    ) -> None:
        self._seconds = seconds
        self._folder = folder
        kinds = [k for k in ModbusTcp.KINDS if k not in LAST and k not in without]
        self._wire_script = Script(f"soak wire {seed}", kinds, seconds, calm=CALM)
        self._computer = self._computer_script(seed, [*without])
        self._loop = Loop()
        self._log = WireLog(folder / "wire.log", time.monotonic())
        self._waits = ProcessorWaits(self._loop)
        self._promises = Promises()
        self._checker = Checker(self._promises, self._stalled, self._waits.between)
        motion = RandomMotion(random.Random(f"soak {seed}"), time.monotonic())
        machine = TormentMachine(motion, self._wire_script, self._checker)
        self._wire = ModbusTcp(self._loop, machine, self._log, folder, "plain")
        self._findings = ReportedViolations(
            self._checker, [self._wire_script, *self._computer], self._log
        )
        self._config = folder / "config.toml"
        self._abbe = Supervisor(self._loop, self._log, folder, self._config)
        self._faults = ComputerFaults(self._abbe, self._config)
        self._clients = Clients(self._loop, folder)
        self._memory, self._http_memory = MemoryCurve(), MemoryCurve()
        self._active: dict[str, Torment] = {}
        self._reborn_at = float("inf")
        self._hung_until = 0.0
        self._looked = self._calm_since = 0.0
        self._cycles = self._missed = 0
        self._period_of = (0.0, 0)

    def _computer_script(self, seed: int, without: Sequence[str]) -> list[Script]:
        """Faults that Abbe survives go on all the time, those that end it at both ends."""
        mild = [k for k in COMPUTER_FAULTS if k not in DEADLY and k not in without]
        deadly = [k for k in COMPUTER_FAULTS if k in DEADLY and k not in without]
        edge = _EDGES * self._seconds
        made = [Script(f"soak computer {seed}", mild, self._seconds, COMPUTER_FAULTS, CALM)]
        self._deadly = [
            (begin, Script(f"soak deadly {seed} {begin}", deadly, edge, COMPUTER_FAULTS, CALM))
            for begin in (0.0, self._seconds - edge)
        ]
        return [*made, *(script for _, script in self._deadly)]

    def run(self) -> SoakOutcome:
        """Start Abbe, soak it, end it, judge."""
        self._log.open()
        self._wire.start()
        port, token = self._configure()
        self._start()
        try:
            if self._comes_up():
                self._clients.start(port, token)
                self._soak()
                self._end()
        finally:
            self._faults.calm_disk()
            self._clients.close()
            self._abbe.close()
            self._wire.close()
            self._loop.close()
            self._log.close()
        faults: dict[str, int] = {}
        for script in (self._wire_script, *self._computer):
            for torment in script.torments:
                faults[torment.kind] = faults.get(torment.kind, 0) + 1
        return SoakOutcome(
            self._checker.violations,
            self._findings.lines,
            self._checker.tally,
            faults,
            self._abbe.restarts,
            self._memory,
            self._http_memory,
            self._cycles,
            self._missed,
            self._clients.answers,
            self._clients.http,
        )

    def _configure(self) -> tuple[int, str]:
        """Write what Abbe is given; where it listens on this computer, and a token for that."""
        port, variants = write_configurations(self._config, self._wire, self._promises)
        self._faults.variants = variants
        made = subprocess.run(
            [sys.executable, "-m", "abbe.daemon", "token", "add", str(self._config), "soak"],
            stdout=subprocess.PIPE,
            check=True,
        )
        return port, made.stdout.decode().strip()

    def _start(self) -> None:
        # what the last life had sent may have been read from the wire after its end was seen
        self._checker.reborn()
        self._abbe.start()
        self._waits.begin(self._abbe.pid)
        self._memory.begin()
        self._http_memory.begin()
        self._reborn_at = float("inf")

    def _comes_up(self) -> bool:
        limit = time.monotonic() + _COMES_UP
        while not self._checker.word & COMPENSATING:
            now = self._turn()
            why = self._abbe.look(now)
            if why or now > limit:
                why = why or "it is not corrected in full"
                self._fail(now, f"Abbe did not come up: {why}; see abbe.log")
                return False
        return True

    def _soak(self) -> None:
        began = self._calm_since = time.monotonic()
        self._wire_script.start(began)
        self._computer[0].start(began)
        for begin, script in self._deadly:
            script.start(began + begin)
        while (now := self._turn()) < began + self._seconds:
            self._computer_faults(now)
            self._keep_alive(now)
            self._count(now)
            if now - self._calm_since > _COMES_UP:
                self._fail(now, f"not corrected in full after {_COMES_UP:g} s of calm")
                return

    def _end(self) -> None:
        for kind in [*self._active]:
            self._over(kind)
        limit = time.monotonic() + _COMES_UP
        while not self._abbe.ready:
            now = self._turn()
            self._keep_alive(now)
            if now > limit:
                self._fail(now, "Abbe did not come back in the end")
                return
        self._log.say("!", "SIGTERM")
        self._checker.ending = time.monotonic()
        self._abbe.end()
        limit = time.monotonic() + _COMES_UP
        while self._abbe.exit_status is None:
            if self._turn() > limit:
                self._fail(limit, f"Abbe did not end within {_COMES_UP:g} s of SIGTERM")
                return
        for _ in range(20):
            self._turn()
        self._checker.ended(self._abbe.exit_status, time.monotonic())
        self._findings.tell()

    def _keep_alive(self, now: float) -> None:
        """What a supervisor does: bury, and start again."""
        if now >= self._reborn_at:
            self._start()
            return
        if self._reborn_at < float("inf"):
            return
        why = self._abbe.look(now)
        if not why:
            return
        killed = self._active.get("killed")
        if killed is None and not (why == "watchdog" and now < self._hung_until):
            waited = self._waits.between(now - WATCHDOG, now)
            said = f"it waited {waited:.1f} s of the last {WATCHDOG:g} s for a processor"
            if why == "watchdog" and WATCHDOG - waited < _IN_TIME:
                why = "no processor"
                self._findings.lines.append(f"started again, its computer too busy: {said}")
            else:
                self._fail(now, f"Abbe had to be started again: {why}; {said}")
        self._log.say("!", f"over: {why}")
        self._abbe.again("killed" if killed else why)
        self._reborn_at = now + 0.3 if killed is None else max(now + 0.3, self._until(killed, now))

    def _until(self, torment: Torment, now: float) -> float:
        return now + min(2.0, torment.end - torment.begin)

    def _computer_faults(self, now: float) -> None:
        """Begin what has begun and end what is over."""
        going = {
            kind: torment
            for script in self._computer
            for kind in COMPUTER_FAULTS
            if (torment := script.active(kind, now))
        }
        alive = self._reborn_at == float("inf") and self._abbe.exit_status is None
        for kind in [*self._active]:
            if kind not in going:
                self._over(kind)
        for kind, torment in going.items():
            # what begins while nobody is there, or before it is ready, is left out
            if kind not in self._active and alive and self._abbe.ready:
                self._active[kind] = torment
                self._log.say("!", f"{kind} {torment.amount:g}")
                if kind == "hung":
                    self._hung_until = time.monotonic() + torment.end - torment.begin + WATCHDOG
                self._faults.begin(kind, torment)

    def _over(self, kind: str) -> None:
        self._faults.over(kind, self._active.pop(kind))

    def _calm(self, now: float) -> bool:
        """Whether nothing goes on, nor has for a while."""
        scripts = (self._wire_script, *self._computer)
        return not self._active and not any(s.around(now, _SETTLING) for s in scripts)

    def _count(self, now: float) -> None:
        """Memory once a second; cycles in calm; how long it takes until all is corrected again."""
        calm = self._calm(now) and self._abbe.ready and self._abbe.age > WATCHDOG
        if not calm or self._checker.word & COMPENSATING:
            self._calm_since = now
        tally = self._checker.tally
        tally.slowest_recovery = max(tally.slowest_recovery, now - self._calm_since)
        if now - self._looked < 1.0:
            return
        self._looked = now
        if self._abbe.ready:
            self._memory.note(self._abbe.age, self._abbe.memory())
            self._http_memory.note(self._abbe.age, self._abbe.http_memory())
        at, messages = self._period_of
        if calm and at:
            self._cycles += tally.messages - messages
            self._missed += max(0, round((now - at) / 0.02) - (tally.messages - messages))
        self._period_of = (now, tally.messages) if calm else (0.0, 0)

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
