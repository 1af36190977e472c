"""``abbe measure`` in its own process beside the simulated bridge with its laser in another."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.plan_file import PlannedWork, read_plan
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.planning.motion import TURN, ProgramStep, steps_of
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.daemon.demo.configuration import demo_configuration
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.live_run import MODEL

PATIENCE = 120.0
"""s that anything may take on a busy machine."""
TOOL = (0.0, 0.0, -150.0)
BAR_ASIDE = (0.04, -0.03, 0.02)
"""mm by which a ball bar's ball stands off the plan."""
SPEED = 3000.0
"""Of the simulated machine, mm/s."""

LASER = """
[links.laser]
driver = "serial"
port = "{port}"
timeout = 2.0

[links.laser.messages.reading]
query = "R"
pattern = '(?P<status>OK|BEAM)( (?P<a>[-+.\\d]+))?( (?P<b>[-+.\\d]+))?( (?P<c>[-+.\\d]+))?'

[links.laser.channels]
length = {{ message = "reading", field = "a", unit = "mm" }}
tilt = {{ message = "reading", field = "a", unit = "urad" }}
beam = {{ message = "reading", field = "status", values = {{ OK = 1, BEAM = 0 }} }}

[instrument.laser]
source = "laser.length"
beam = "laser.beam"
reads = "length"
stale_after = 2.0

[instrument.straightness]
source = "laser.length"
beam = "laser.beam"
reads = "error"
incremental = true

[instrument.angle]
measures = ["angle", "level"]
source = "laser.tilt"
beam = "laser.beam"
reads = "error"
incremental = true
"""

QUICK = """
[measure]
still_for = 0.15
settle = 0.05
average = 0.2
signals_held = 2.0
"""


def bent_scales(path: Path) -> Path:
    """The simulated machine's model with nothing but a bent scale for each axis, not fitted.

    What three short lines are enough for, and what a plan is soon made for.
    """
    text = MODEL.read_text("utf-8")
    scales = (
        f'\n[[effects]]\nkind = "positioning"\naxis = "{axis}"\nshape = "polynomial:2"\n'
        for axis in "XYZ"
    )
    path.write_text(text[: text.index("[[effects]]")] + "".join(scales), "utf-8")
    return path


def configuration(ready: Mapping[str, Any], folder: Path, measure: str = QUICK) -> Path:
    """The configuration of a bench, beside ``model.toml``."""
    text = demo_configuration(ready, "model.toml").replace("timeout = 0.3 ", "timeout = 2.0 ")
    text = text.replace("stale_after = 0.3 ", "stale_after = 2.0 ")
    text += LASER.format(port=ready["laser"]) + measure
    path = folder / "config.toml"
    path.write_text(text, encoding="utf-8")
    return path


def line_plan(
    name: str,
    axis: str,
    places: Sequence[float],
    *,
    at: tuple[float, float, float] = (350.0, 450.0, -180.0),
    both_ways: bool = True,
    instrument: str = "laser",
    reads: str = "displacement",
    u: tuple[float, float, float] | None = None,
    free: str = '["zero"]',
    sd: float = 0.3,
) -> str:
    """The section of a set-up along an axis of the bridge."""
    k = "XYZ".index(axis)
    rows = []
    for place in places:
        row = list(at)
        row[k] = place
        rows.append(f"  [{row[0]}, {row[1]}, {row[2]}],")
    direction = tuple(float(i == k) for i in range(3)) if u is None else u
    return "\n".join(
        [
            f'\n[[setups]]\nname = "{name}"\nwhat = "{reads} along {axis}"',
            f'instrument = "{instrument}"\nkind = "{reads}"\nfree = {free}\naxis = "{axis}"',
            f'tool = "P"\nruns = 1\nboth_ways = {"true" if both_ways else "false"}',
            'axes = ["X", "Y", "Z"]\ntargets = [',
            *rows,
            "]",
            f"read = [[[{direction[0]}, {direction[1]}, {direction[2]}]]]\nsd = [{sd}]",
        ]
    )


def write_plan(path: Path, *setups: str) -> Path:
    """A plan of the bridge."""
    head = (
        'format = "abbe-plan/1"\nmodel = "model.toml"\nstructure = "w b Y X Z t"\nwarm_up = 0\n'
        f"beyond = 2\n[tools]\nP = [{TOOL[0]}, {TOOL[1]}, {TOOL[2]}]\n"
    )
    path.write_text(head + "\n".join(setups) + "\n", encoding="utf-8")
    return path


def optics(setup: PlannedSetup) -> dict[str, Any]:
    """How the simulated instrument stands for a set-up; its slope is nobody's to know."""
    found: dict[str, Any] = {"tool": list(setup.offset)}
    if setup.kind == Kind.ROTATION:
        return found | {"reads": "rotation", "u": setup.u[0].tolist(), "noise": 0.1}
    if setup.kind == Kind.DISTANCE:
        return found | {"reads": "distance", "base": list(setup.base or ())}
    if setup.instrument.key == "ball-bar":
        # nobody puts its ball exactly where it is to stand
        middle = np.array(setup.optics["the ball stands"])
        radius = float(np.linalg.norm(setup.path()[0] - middle))
        base = (middle + BAR_ASIDE).tolist()
        return found | {"reads": "distance", "base": base, "length": radius, "noise": 3e-4}
    way = np.ptp(setup.path(), axis=0)
    along = float(np.abs(setup.u[0] @ way).max()) > 1.0
    found["u"] = setup.u[0].tolist()
    if along:
        return found | {"reads": "length"}
    line = [float(setup.targets[a][0]) for a in "XYZ"]
    return found | {"reads": "error", "slope": 3e-6, "at": line}


def program(
    work: PlannedWork, steps: Sequence[ProgramStep], stands: float, start: Mapping[str, float]
) -> list[dict[str, Any]]:
    """A plan's moves for the simulated machine's program runner."""
    by_name = {s.name: s for s in work.setups}
    at = dict(start)
    moves: list[dict[str, Any]] = []
    names = [s.text.removeprefix("set-up ").partition(":")[0] for s in steps
             if s.kind == "note" and s.text.startswith("set-up ")]  # fmt: skip
    waiting = iter(names)
    for step in steps:
        if step.kind == "stop":
            moves.append({"place": optics(by_name[next(waiting)])})
        elif step.kind in ("move", "target"):
            at |= dict(step.at)
            dwell = stands if step.kind == "target" else 0.0
            moves.append({"to": [at[a] for a in "XYZ"], "stands": dwell})
            if step.kind == "move" and step.seconds > TURN:
                moves[-1] |= {"stands": stands, "aside": True}
    return moves


def driven(plan: Path, model: Path, stands: float = 0.8) -> list[dict[str, Any]]:
    """The program of a plan, each target held for `stands` s."""
    machine = load_model(model).machine
    work = read_plan(plan, machine)
    start = {"X": 10.0, "Y": 10.0, "Z": -10.0}
    return program(work, steps_of(machine, work.setups, work.space), stands, start)


class MeasureRun:
    """``abbe measure --json``; its events are read as they come."""

    def __init__(self, plan: Path, config: Path, out: Path, *more: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "abbe.daemon", "measure", str(plan), str(config),
             "-o", str(out), "--yes", "--json", *more],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
        )  # fmt: skip
        self.events: list[dict[str, Any]] = []
        self._errors: list[str] = []
        self._readers = [
            threading.Thread(target=self._read, daemon=True),
            threading.Thread(target=self._read_errors, daemon=True),
        ]
        for reader in self._readers:
            reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.events.append(json.loads(line))

    def _read_errors(self) -> None:
        assert self.process.stderr is not None
        self._errors.extend(self.process.stderr)

    @property
    def said(self) -> str:
        """What was said on standard error."""
        return "".join(self._errors)

    def kinds(self, kind: str) -> list[dict[str, Any]]:
        """All events of a kind so far."""
        return [e for e in list(self.events) if e["event"] == kind]

    def until(
        self, what: Callable[[dict[str, Any]], bool], since: int = 0, patience: float = PATIENCE
    ) -> dict[str, Any]:
        """The first event from index `since` on of which `what` holds."""
        at, deadline = since, time.monotonic() + patience
        while time.monotonic() < deadline:
            while at < len(self.events):
                if what(self.events[at]):
                    return self.events[at]
                at += 1
            assert self.process.poll() is None, f"ended: {self.said} {self.texts()[-5:]}"
            time.sleep(0.02)
        raise AssertionError(f"not seen in {patience:g} s; last: {self.texts()[-8:]}; {self.said}")

    def texts(self) -> list[str]:
        """All events' lines."""
        return [f"{e['event']}: {e['text']}" for e in list(self.events)]

    def rows(self, count: int, patience: float = PATIENCE) -> None:
        """Wait until so many targets are on the disk."""
        self.until(lambda _: len(self.kinds("row")) >= count, patience=patience)

    def wait(self, patience: float = PATIENCE) -> int:
        """Wait for its end; the exit status."""
        status = self.process.wait(patience)
        for reader in self._readers:
            reader.join(5.0)
        return status

    def end(self, number: int = signal.SIGINT) -> int:
        """Ask it to end; its exit status."""
        self.process.send_signal(number)
        return self.wait()

    def close(self) -> None:
        """End whatever is left."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        for reader in self._readers:
            reader.join(5.0)
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()


@contextmanager
def measuring(plan: Path, config: Path, out: Path, *more: str) -> Iterator[MeasureRun]:
    """A measurement that ends with the context."""
    run = MeasureRun(plan, config, out, *more)
    try:
        yield run
    finally:
        run.close()


class Driver:
    """Drives the simulated machine along a plan's program, and goes on when a target was read.

    Parameters
    ----------
    process
        The machine.
    run
        The measurement.
    plan, model
        What is driven through.

    Attributes
    ----------
    speed
        Of the next moves, mm/s.
    """

    speed = SPEED

    def __init__(self, process: SimulatedProcess, run: MeasureRun, plan: Path, model: Path) -> None:
        self._process = process
        self._run = run
        self._moves = driven(plan, model)
        self.targets = [
            k for k, m in enumerate(self._moves) if m.get("stands") and not m.get("aside")
        ]
        self._next = 0

    def place(self, number: int) -> list[float]:
        """Where a target (from 0) is."""
        found: list[float] = self._moves[self.targets[number]]["to"]
        return found

    def beyond_the_first(self) -> None:
        """Drive to where the program stands beyond its first target."""
        moves = [{k: v for k, v in m.items() if k != "stands"} for m in self._moves]
        self._process.order("drive", moves=moves[: self.targets[0] - 1], speed=self.speed)
        self._next = self.targets[0] - 1

    def to(self, number: int) -> None:
        """Drive to a target without a stop, and stand there; backwards by the way it came first."""
        at = self.targets[number]
        first = self._next if at >= self._next else at - 1
        for k in range(first, at + 1):
            if self._moves[k].get("aside"):
                since = len(self._run.events)
                self._drive(first, k)
                self._run.until(lambda e: "stood aside" in e["text"], since=since)
                first = k + 1
        self._drive(first, at)
        self._next = at + 1

    def _drive(self, first: int, last: int) -> None:
        moves = [
            {k: v for k, v in m.items() if k != "stands"} for m in self._moves[first : last + 1]
        ]
        self._process.order("drive", moves=moves, speed=self.speed)

    def read(self, *numbers: int) -> None:
        """Drive to some targets, each until its rows are on the disk."""
        for number in numbers:
            done = len(self._run.kinds("row"))
            self.to(number)
            self._run.rows(done + 1)

    def all(self) -> None:
        """Drive to every target."""
        self.read(*range(len(self.targets)))


@contextmanager
def bench(*more: str) -> Iterator[SimulatedProcess]:
    """The simulated bridge with its laser."""
    with SimulatedProcess("bench", "--seed", "1", *more) as process:
        yield process


def true_errors(
    process: SimulatedProcess, points: Sequence[Sequence[float]], tool: Sequence[float] = TOOL
) -> Any:
    """Exact errors of the machine at indicated positions, µm, shape (n, 3)."""
    found = process.order("truth", points=[list(p) for p in points], tool=list(tool))
    return 1e3 * np.array(found["errors"])


def rms(values: Any) -> float:
    """Root of the mean square."""
    return math.sqrt(float(np.mean(np.square(values))))


def unseen_lines(
    process: SimulatedProcess, fitted: Path, signals: Mapping[str, float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Errors along 40 lines anywhere, each less its mean, before and after the correction, µm.

    `signals` are what the machine's thermometers read meanwhile, for models that need them.
    """
    model = load_model(fitted)
    rng = np.random.default_rng(7)
    before, after = [], []
    low, high = np.array([20.0, 20.0, -340.0]), np.array([680.0, 880.0, -20.0])
    for _ in range(40):
        first, last = rng.uniform(low, high), rng.uniform(low, high)
        points = first + np.linspace(0.0, 1.0, 15)[:, None] * (last - first)
        u = (last - first) / np.linalg.norm(last - first)
        true = true_errors(process, points.tolist()) @ u
        conditions = [
            Conditions.at(dict(zip("XYZ", p, strict=True)), tool=TOOL, signals=signals)
            for p in points
        ]
        predicted = [1e3 * float(model.predict(c).translation[0] @ u) for c in conditions]
        left = true - np.array(predicted)
        before.append(true - true.mean())
        after.append(left - left.mean())
    return np.concatenate(before), np.concatenate(after)
