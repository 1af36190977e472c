"""The second simulator of thermal days, and a few of its days; all of them: docs/validation.md."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

from benchmarks.thermal import bodies, machine, table
from benchmarks.thermal.bodies import Weather, warmth
from benchmarks.thermal.scenario import AIR, BEARING, BED, EMPTY, Run, Scenario
from benchmarks.thermal.trial import run
from benchmarks.thermal.weather import Shop

HERE = Path(bodies.__file__).parent
COARSE = 900.0
TRUTH = ("bodies", "weather", "machine", "scenario", "days")


@pytest.mark.parametrize("module", TRUTH)
def test_the_truth_is_made_without_abbe(module: str) -> None:
    tree = ast.parse((HERE / f"{module}.py").read_text(encoding="utf-8"))
    named = [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
    named += [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
    assert named
    assert not [name for name in named if name.startswith(("abbe", "compcore"))]


def still(hours: float, air: float = 20.0, spindle: float = 0.0) -> Weather:
    n = int(hours * 120)
    none = np.zeros(n)
    return Weather(30.0, none + air, none + air, none > 0, none + spindle, none.copy(), none.copy())


def test_in_the_end_all_heat_goes_to_the_air() -> None:
    """After four weeks of 100 W at the spindle, 100 W leave: Σ H·ΔT over the bodies."""
    warm = warmth(still(24 * 28, spindle=100.0))
    leaving = sum(bodies._TO_AIR[b] * warm[b][-1].sum() for b in bodies.BODIES)
    assert leaving == pytest.approx(100.0, rel=1e-3)
    # and the nearer to the spindle, the warmer
    at = {b: float(w[-1].sum()) for b, w in warm.items()}
    assert at["bearing"] > at["head"] > at["front"] > at["rear"] > at["bed"] > at["scale_y"] > 0.0


def test_a_cold_machine_in_20_degrees_stands_where_it_shows() -> None:
    at = np.array([[100.0, 50.0, 20.0], [700.0, -200.0, 400.0]])
    cold = {b: np.zeros(2) for b in bodies.BODIES}
    assert np.abs(machine.error(cold, at)).max() == 0.0


def test_evenly_warm_it_grows_in_proportion() -> None:
    """One kelvin all over: lengths by 11 ppm; the straight loop bed to column, head, and table."""
    at = np.array([[300.0, 0.0, 0.0]])
    even = {b: np.ones(1) for b in bodies.BODIES}
    x, y, z = machine.error(even, at)[0]
    assert x == pytest.approx(10e-6 * 300.0)
    assert y == pytest.approx(11e-6 * (machine.TO_COLUMN - machine.REACH))
    assert z == pytest.approx(11e-6 * (machine.UP - machine.SPINDLE - machine.TABLE), abs=1e-9)


def test_warmer_in_front_the_column_leans_back_and_lifts_the_head() -> None:
    at = np.array([[0.0, 0.0, 0.0]])
    bent = {b: np.zeros(1) for b in bodies.BODIES} | {"front": np.array([2.0])}
    x, y, z = machine.error(bent, at)[0]
    angle = 11e-6 * 2.0 / machine.DEPTH * machine.UP
    # half of the angle times the height backwards, less what the hanging spindle swings
    assert y == pytest.approx(angle * (0.5 * machine.UP - machine.SPINDLE), rel=1e-3)
    assert z == pytest.approx(11e-6 * machine.UP + angle * machine.REACH, rel=1e-3)
    assert x == 0.0


@pytest.mark.one_in(2)
@pytest.mark.parametrize("number", range(len(EMPTY)))
def test_on_empty_days_nothing_is_named(number: int) -> None:
    found = run(Run(EMPTY[number], 100 + number), others=False)
    assert found.named == ()
    assert found.rms["abbe"] == pytest.approx(found.rms["before"])
    assert found.rms["abbe"] == pytest.approx(found.rms["floor"], rel=0.05)


def test_days_with_a_working_spindle() -> None:
    days = Scenario("spindle", Shop(0.4, spindle=True), (AIR, BEARING, BED), every=COARSE)
    found = run(Run(days, 1), others=False)
    assert found.first
    assert any(w.startswith("Z: ") and "spindle" in w for w in found.wanted)
    assert found.rms["abbe"] < 0.6 * found.rms["spreadsheet"] < found.rms["before"]
    assert found.rms["floor"] < found.rms["abbe"]
    assert "spindle" in table.line(found)
    text = table.section([found])
    assert "1 of 1: the first cause named is plausible" in text
