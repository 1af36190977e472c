"""ISO 230-4: circles of which G, H, F and D are known in closed form, or found by trying."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize

from abbe.compcore.iso230.circular import MeasuredCircle as Way
from abbe.compcore.iso230.circular import evaluate_circle
from tests.support.daemon.command_line import abbe

THETA = np.radians(np.arange(0.0, 360.0, 2.0))


def evaluated(ccw, cw=None, theta=THETA):
    paths = {"ccw": Way(theta, ccw(theta))}
    if cw is not None:
        paths["cw"] = Way(theta, cw(theta))
    return evaluate_circle("c", ("X", "Y"), (0.0, 0.0), 100.0, paths)


def test_an_oval_with_play_off_centre():
    """Oval of ±3 µm (squareness), 2 µm between the ways, 1.5 µm too large, bar 20/−7 µm off."""

    def path(sense):
        return lambda t: (
            1.5e-3 + 3e-3 * np.sin(2 * t) + sense * 1e-3 + 20e-3 * np.cos(t) - 7e-3 * np.sin(t)
        )

    found = evaluated(path(1.0), path(-1.0))
    peak = 3e-3 * np.sin(2.0 * np.radians(44.0))  # a reading stands at 44° and 46°
    assert found.eccentricity == pytest.approx((20e-3, -7e-3), abs=1e-12)
    assert pytest.approx({"ccw": 2 * peak, "cw": 2 * peak}, abs=1e-10) == found.G
    assert found.G_both == pytest.approx(2 * peak + 2e-3, abs=1e-10)
    assert pytest.approx(2e-3, abs=1e-12) == found.H
    assert pytest.approx(1.5e-3, abs=1e-12) == found.D
    assert found.F_max == pytest.approx({"ccw": 2.5e-3 + peak, "cw": 0.5e-3 + peak}, abs=1e-12)
    assert found.F_min == pytest.approx({"ccw": 2.5e-3 - peak, "cw": 0.5e-3 - peak}, abs=1e-12)
    assert found.notes == ()


def test_g_is_the_least_zone_not_that_of_least_squares():
    """A reversal spike: centres are tried by Nelder and Mead."""
    rng = np.random.default_rng(3)
    deviation = 2e-3 * np.exp(-(((THETA - 1.6) / 0.15) ** 2)) + 1e-3 * np.cos(3 * THETA)
    deviation += 2e-4 * rng.normal(size=len(THETA))
    found = evaluated(lambda t: deviation)

    def zone(centre):
        return 1e3 * np.ptp(deviation - centre[0] * np.cos(THETA) - centre[1] * np.sin(THETA))

    tried = min(
        minimize(zone, start, method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-10}).fun
        for start in rng.normal(scale=1e-3, size=(20, 2))
    )
    assert found.G["ccw"] * 1e3 == pytest.approx(tried, abs=1e-5)
    assert found.G["ccw"] < np.ptp(found.centred("ccw")) - 1e-5
    assert found.H is None
    assert found.D is None
    assert "only ccw" in found.notes[0]


def test_an_arc_counts_from_the_instruments_centre():
    theta = np.radians(np.arange(0.0, 221.0, 2.0))
    found = evaluated(lambda t: 5e-3 * np.cos(t), lambda t: 5e-3 * np.cos(t) - 1e-3, theta)
    assert not found.full
    assert found.G["ccw"] == pytest.approx(10e-3, abs=1e-12)
    assert pytest.approx(1e-3, abs=1e-12) == found.H
    assert found.F_max["ccw"] == pytest.approx(5e-3)
    assert found.D is None
    assert "not a full circle" in found.notes[0]


def test_from_a_ball_bar_file_to_numbers_and_a_page(tmp_path: Path):
    """Backlash of 4 µm in X: the actual path steps where X turns round, at 0° and 180°."""
    rows = ["# plane = XY", "# centre = 200, 300", "# radius = 150", "angle,ccw,cw"]
    for degrees in range(1, 360, 2):
        t = np.radians(degrees)
        # X lags by 2 µm behind its own motion: −sin θ on the way ccw
        lag = -2.0 * np.sign(-np.sin(t)) * np.cos(t)
        rows.append(f"{degrees},{lag:.6f},{-lag:.6f}")
    source, campaign, page = (tmp_path / n for n in ("b.csv", "c.csv", "p.html"))
    source.write_text("\n".join(rows) + "\n", encoding="utf-8")
    done = abbe(
        "import-campaign", source, "--as", "ballbar", "-o", campaign, "--structure", "w b X Y Z t"
    )
    assert done.status == 0, done.err
    done = abbe("iso230", campaign, "--json", "--report", page)
    assert done.status == 0, done.err
    (circle,) = json.loads(done.out)["circles"]
    near = 2.0 * np.cos(np.radians(1.0))
    assert (circle["plane"], circle["full_circle"]) == ("XY", True)
    assert circle["radius"] == pytest.approx(150.0, abs=1e-3)
    assert circle["H"] == pytest.approx(2.0 * near, abs=1e-3)
    assert circle["D"] == pytest.approx(0.0, abs=1e-3)
    assert circle["F_max"]["ccw"] == pytest.approx(near, abs=1e-3)
    assert circle["F_min"]["cw"] == pytest.approx(-near, abs=1e-3)
    assert circle["G"]["both"] == pytest.approx(2.0 * near, abs=1e-3)
    assert "Circles, ISO 230-4" in abbe("iso230", campaign).out
    assert "Circle XY" in page.read_text(encoding="utf-8")
