"""Programs that touch a sphere: run by a machine that knows where it really is, then imported."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.plan_file import read_plan
from tests.support.daemon.command_line import abbe

DIAMETER, TIP = 25.0, 4.0
TOOL = np.array([0.0, 0.0, -150.0])
LINE = np.array([300.0, 250.0, -550.0])
BESIDE = {"A": np.array([0.0, 0.021, -0.034]), "C": np.array([0.030, -0.018, 0.0])}
"""By how much the lines really lie beside that, mm."""
ASIDE = np.array([0.8, -0.6, 0.7])
"""By how much the sphere stands off the plan, mm."""
MODEL = """format = "abbe-model/1"
[machine]
name = "Trunnion"
structure = "w C' A' b X Y Z t"
[machine.axes]
X = { travel = [0.0, 600.0] }
Y = { travel = [0.0, 500.0] }
Z = { travel = [-400.0, 0.0] }
A = { travel = [-95.0, 30.0], location = [300.0, 250.0, -550.0] }
C = { travel = [-180.0, 180.0], location = [300.0, 250.0, -550.0] }
[[effects]]
kind = "rotary_location"
axis = "A"
[[effects]]
kind = "rotary_location"
axis = "C"
"""
Move = tuple[str, dict[str, float]]


def really(start: np.ndarray, angles: dict[str, float], much: float = 1.0) -> np.ndarray:
    """Where a sphere is that the table takes along; it turns against its numbers. mm, degrees."""
    c, a = (-np.radians(angles[x]) for x in "CA")
    about_z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    for turn, line in ((about_z, LINE + much * BESIDE["C"]), (about_x, LINE + much * BESIDE["A"])):
        start = line + turn @ (start - line)
    return start


class TouchingMachine:
    """Goes where it is told, stops at the sphere, and notes every touch."""

    def __init__(self, start: np.ndarray) -> None:
        self._start = start
        self._at = {"X": 300.0, "Y": 250.0, "Z": -1.0, "A": 0.0, "C": 0.0}
        self.touched: list[dict[str, float]] = []
        self.nearest = np.inf

    def _tip(self, at: dict[str, float]) -> np.ndarray:
        return np.array([at[a] for a in "XYZ"]) + TOOL

    def go(self, kind: str, to: dict[str, float]) -> None:
        """A move, on which nothing may be met, or a touch."""
        then = self._at | to
        turns = any(abs(then[a] - self._at[a]) > 1e-9 for a in "AC")
        if turns:  # drawn back
            assert self._at["Z"] == then["Z"] == -1.0
        middle = really(self._start, then)
        steps = np.linspace(0.0, 1.0, 2001)[:, None]
        way = self._tip(self._at) + steps * (self._tip(then) - self._tip(self._at))
        away = np.linalg.norm(way - middle, axis=1) - 0.5 * (DIAMETER + TIP)
        # the stylus is thinner than its ball, and goes up
        up = np.clip(middle[2] - way[:, 2], 0.0, None)[:, None] * np.array([0.0, 0.0, 1.0])
        shaft = np.linalg.norm(way + up - middle, axis=1) - 0.5 * (DIAMETER + 0.5 * TIP)
        inside = np.flatnonzero(away <= 0.0)
        if kind == "move":
            leaves = len(inside) > 0 and inside[-1] < 100 and np.all(np.diff(away) > -1e-9)
            assert not len(inside) or leaves, (self._at, to)
            self._at = then
            return
        assert len(inside), "nothing is touched"
        low, high = steps[inside[0] - 1, 0], steps[inside[0], 0]
        line = self._tip(then) - self._tip(self._at)
        for _ in range(60):
            part = 0.5 * (low + high)
            at = self._tip(self._at) + part * line
            met = np.linalg.norm(at - middle) <= 0.5 * (DIAMETER + TIP)
            low, high = (low, part) if met else (part, high)
        assert shaft[: inside[0]].min() > 0.0
        x, y, z = at - TOOL
        self._at = then | {"X": x, "Y": y, "Z": z}
        self.touched.append(dict(self._at))


def fanuc(text: str) -> Iterator[Move]:
    lines = text.splitlines()
    for i, line in enumerate(lines):
        words = {a: float(v) for a, v in re.findall(r"\b([ACXYZ])(-?\d+\.\d+)", line)}
        if line.startswith("G1 "):
            yield "move", words
        elif line.startswith("G31 "):
            # an alarm where it stops on a way, or goes to the end of a touch
            touches = " LT 0.01] THEN #3000=2 " in lines[i + 1]
            assert touches or " GT 0.05] THEN #3000=3 " in lines[i + 1]
            for k, axis in enumerate("XYZ", start=5061):
                assert f"ABS[#{k}-[{words[axis]:.4f}]]" in lines[i + 1]
            yield "touch" if touches else "move", words
        elif line.startswith("DPRNT"):
            yield "print", {}


def siemens(text: str) -> Iterator[Move]:
    lines = text.splitlines()
    assert lines[0].startswith("DEF ")
    for i, line in enumerate(lines):
        words = {a: float(v) for a, v in re.findall(r"\b([ACXYZ])=(-?\d+\.\d+)", line)}
        if line.startswith("SUPA G1 "):
            yield "move", words
        elif line.startswith("MEAS=1 SUPA G1 "):
            assert lines[i + 1] == "STOPRE"
            touches = lines[i + 2] == "IF $AC_MEA[1]==0 GOTOF MISSED"
            assert touches or lines[i + 2] == "IF $AC_MEA[1]==1 GOTOF TOUCHED"
            yield "touch" if touches else "move", words
        elif line.startswith("WRITE") and "$AA_MM" in lines[i - 1]:
            yield "print", {}


def linuxcnc(text: str) -> Iterator[Move]:
    """By LinuxCNC's own interpreter."""
    folder = Path(subprocess.check_output(["mktemp", "-d"], text=True).strip())
    try:
        (folder / "p.ngc").write_text(text, encoding="ascii")
        (folder / "tool.tbl").touch()
        done = subprocess.run(
            ["rs274", "-t", "tool.tbl", "-g", "p.ngc"],
            cwd=folder, capture_output=True, text=True, timeout=120, check=True,
        )  # fmt: skip
    finally:
        shutil.rmtree(folder)
    assert "PROGRAM_END()" in done.stdout
    for line in done.stdout.splitlines():
        found = re.search(r"STRAIGHT_(FEED|PROBE|TRAVERSE)\(([^)]*)\)", line)
        if found:
            assert found[1] != "TRAVERSE"
            numbers = [float(v) for v in found[2].split(",")]
            at = {a: numbers[i] for a, i in zip("XYZAC", (0, 1, 2, 3, 5), strict=True)}
            yield ("move" if found[1] == "FEED" else "touch"), at
        elif re.search(r"\bLOG\(", line) and "X" not in line:
            yield "print", {}


def fanuc_rows(touched: list[dict[str, float]]) -> str:
    """As DPRNT prints: blanks for leading zeros and for asterisks."""
    rows = (" ".join(f"{a}{v:9.4f}" for a, v in at.items()) for at in touched)
    return "%\n" + "\n".join(rows) + "\n%\n"


def rows(touched: list[dict[str, float]]) -> str:
    lines = [",".join(touched[0])] + [",".join(f"{v:.6f}" for v in at.values()) for at in touched]
    return "%_N_PROBED_MPF\n;$PATH=/_N_MPF_DIR\n" + "\n".join(lines) + "\n"


CONTROLS: dict[str, tuple[Callable[[str], Iterator[Move]], Callable[..., str]]] = {
    "fanuc": (fanuc, fanuc_rows),
    "siemens": (siemens, rows),
    "linuxcnc": (linuxcnc, rows),
}


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("touching")
    (folder / "m.toml").write_text(MODEL, encoding="utf-8")
    done = abbe("plan", folder / "m.toml", "--instruments", "sphere", "--tool", "P=0,0,-150",
                "--time", "1h", "--table-radius", "150", "--tool-radius", "40",
                "-o", folder / "plan.toml")  # fmt: skip
    assert done.status == 0, done.err
    return folder / "plan.toml"


@pytest.mark.one_in(3)
@pytest.mark.parametrize("control", CONTROLS)
def test_a_program_touches_all_round_and_what_it_writes_is_the_machines_errors(
    control: str, plan: Path, tmp_path: Path
) -> None:
    """No way meets the sphere, every touch does; rows by hand; the lines by `abbe fit`."""
    read, written = CONTROLS[control]
    if control == "linuxcnc" and shutil.which("rs274") is None:
        pytest.skip("needs LinuxCNC's interpreter")
    machine = load_model(plan.parent / "m.toml").machine
    setups = read_plan(plan, machine).setups
    assert {s.axis for s in setups} == {"A", "C"}
    assert max(np.abs(s.targets["A"]).max() for s in setups) > np.radians(75.0)
    campaigns = []
    for setup in (next(s for s in setups if s.axis == a) for a in "AC"):
        program = tmp_path / f"{setup.name}.nc"
        done = abbe("program", plan, "--controller", control, "--sphere", str(DIAMETER), "--tip",
                    str(TIP), "--setup", setup.name, "-o", program)  # fmt: skip
        assert done.status == 0, done.err
        start = np.array(setup.optics["the sphere stands"]) + ASIDE
        mill, printed = TouchingMachine(start), 0
        for kind, words in read(program.read_text("utf-8")):
            if kind == "print":
                printed += 1
            else:
                mill.go(kind, words)
        visits = len(setup.visits()[0])
        assert len(mill.touched) == 5 * visits
        assert control == "linuxcnc" or printed == 5 * visits
        file = tmp_path / f"{setup.name}.probed"
        file.write_text(written(mill.touched), encoding="ascii")
        campaigns.append(tmp_path / f"{setup.name}.csv")
        done = abbe("import-campaign", file, "--as", "probed", "--model", plan.parent / "m.toml",
                    "--tool", "0,0,-150", "--sd", "0.5", "-o", campaigns[-1])  # fmt: skip
        assert done.status == 0, done.err
        c = read_campaign(campaigns[-1], machine)
        angles = [
            {x: float(np.degrees(c.conditions.positions[x][i])) for x in "AC"}
            for i in range(c.n // 3)
        ]
        left = c.value.reshape(3, -1).T - [
            really(start, at, 0.0) - really(start, at) for at in angles
        ]
        frame = np.concatenate([
            np.stack([really(start + e, at, 0.0) - really(start, at, 0.0) for e in np.eye(3)], 1)
            for at in angles
        ])  # fmt: skip
        aside, *_ = np.linalg.lstsq(frame, left.ravel(), rcond=None)
        assert np.abs(c.value).max() > 0.010
        assert np.abs(left.ravel() - frame @ aside).max() < 2e-4
    fitted = tmp_path / "fitted.toml"
    done = abbe("fit", plan.parent / "m.toml", *campaigns, "-o", fitted)
    assert done.status == 0, done.err
    assert "the line of C lies" in done.out


def test_where_the_sphere_stands_may_be_told(plan: Path, tmp_path: Path) -> None:
    """Found by hand at its top, 14 mm from the plan: every touch is there."""
    machine = load_model(plan.parent / "m.toml").machine
    setup = next(s for s in read_plan(plan, machine).setups if s.axis == "C")
    start = np.array(setup.optics["the sphere stands"])
    inwards = (LINE - start) * (1.0, 1.0, 0.0)
    start = start + 14.0 * inwards / np.linalg.norm(inwards)
    first = int(setup.visits()[0][0])
    middle = really(start, {a: float(np.degrees(setup.targets[a][first])) for a in "AC"})
    x, y, z = middle - TOOL + (0.0, 0.0, 0.5 * (DIAMETER + TIP))
    program = tmp_path / "p.nc"
    done = abbe("program", plan, "--controller", "fanuc", "--sphere", "25", "--tip", "4",
                "--setup", setup.name, "--sphere-at", f"{x + 0.4},{y - 0.5},{z - 0.1}",
                "-o", program)  # fmt: skip
    assert done.status == 0, done.err
    mill = TouchingMachine(start)
    for kind, words in fanuc(program.read_text("utf-8")):
        if kind != "print":
            mill.go(kind, words)
    assert len(mill.touched) == 5 * len(setup.visits()[0])


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--controller", "fanuc"), "--sphere and --tip"),
        (("--controller", "heidenhain", "--sphere", "25", "--tip", "4", "--setup", "01_sphere"),
         "KinematicsOpt"),
        (("--controller", "fanuc", "--sphere", "25", "--tip", "4", "--sphere-at", "1,2"), "x,y,z"),
        (("--controller", "fanuc", "--sphere", "25", "--tip", "4"), "--setup NAME"),
    ],
)  # fmt: skip
def test_what_cannot_be_touched_is_refused_before_a_file_is_written(
    words: tuple[str, ...], says: str, plan: Path, tmp_path: Path
) -> None:
    done = abbe("program", plan, *words, "-o", tmp_path / "p.nc")
    assert done.status == 1
    assert says in done.err
    assert not (tmp_path / "p.nc").exists()
