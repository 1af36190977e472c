"""abbe error-map: closed forms of a plane, its worst pair, its ±; what is refused."""

from __future__ import annotations

import csv
import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest

from tests.support.daemon.command_line import Done, abbe
from tests.support.daemon.pages import packed
from tests.support.daemon.small_line import ALPHA, MODEL, SD, write_campaign, write_model

SQUARE = 30e-6
"""rad, X–Y: all behind Y's move turned about Z."""
TOOL = (5.0, -40.0, -80.0)
TYPED = f"""{MODEL}[effects.parameters.alpha]
value = {ALPHA}
unit = "1/K"
[[effects]]
kind = "squareness"
axes = ["Y", "X"]
[effects.parameters.angle]
value = {SQUARE}
unit = "rad"
"""
WORDS = ("Z=-80", "tool=5,-40,-80", "--temperature", "20,19", "--range", "X=0,420", "--points", 8)
X, Y = np.linspace(0.0, 420.0, 8), np.linspace(0.0, 400.0, 8)


def mapped(*words: object) -> dict:
    done = abbe("error-map", *words, "--json")
    assert done.status == 0, done.err
    return json.loads(done.out)


def truth(warmth: float) -> np.ndarray:
    """By hand: ω × lever for the squareness, α·x·ΔT along X; (8, 8, 3), µm."""
    lever = np.array([[[x + TOOL[0], TOOL[1], -80.0 + TOOL[2]] for _ in Y] for x in X])
    turned = np.cross([0.0, 0.0, SQUARE], lever)
    grown = np.array([[[ALPHA * (warmth - 20.0) * x, 0.0, 0.0] for _ in Y] for x in X])
    return 1e3 * (turned + grown)


def worst(error: np.ndarray) -> float:
    """The error of length, pair by pair, µm."""
    places = [np.array([x, y, 0.0]) for x in X for y in Y]
    errors = error.reshape(-1, 3)
    found = 0.0
    for i, j in itertools.combinations(range(len(places)), 2):
        d = places[j] - places[i]
        change = float((errors[j] - errors[i]) @ d) / math.sqrt(float(d @ d))
        found = max(found, change, key=abs)
    return found


@pytest.fixture
def typed(tmp_path: Path) -> Path:
    path = tmp_path / "typed.toml"
    path.write_text(TYPED, encoding="utf-8")
    return path


def test_errors_and_the_worst_pair_at_two_temperatures(typed):
    found = mapped(typed, *WORDS)
    assert found["plane"] == "XY"
    assert found["grid"] == {"X": pytest.approx(X.tolist()), "Y": pytest.approx(Y.tolist())}
    for one, warmth in zip(found["maps"], (20.0, 19.0), strict=True):
        assert one["at"]["Z"] == -80.0
        assert one["at"]["T_x"] == warmth
        assert np.abs(np.array(one["error"]) - truth(warmth)).max() < 1e-6
        assert abs(one["worst_pair"]["length_error"]) == pytest.approx(abs(worst(truth(warmth))))
        assert one["uncertainty"] is None
    assert abs(worst(truth(19.0))) > 1.2 * abs(worst(truth(20.0)))


def test_the_csv_holds_every_point_of_every_map(typed, tmp_path):
    out = tmp_path / "map.csv"
    assert abbe("error-map", typed, *WORDS, "-o", out).status == 0
    rows = list(csv.DictReader(out.read_text("utf-8").splitlines()))
    assert len(rows) == 2 * 64
    for row in rows:
        i = int(np.argmin(np.abs(X - float(row["X"]))))
        wanted = truth(float(row["T_x"]))[i, 0]
        assert [float(row[f"error_{k}_um"]) for k in "XYZ"] == pytest.approx(wanted, abs=1e-4)
        assert (row["Z"], row["tool_y"]) == ("-80", "-40")
    assert "plus_minus_X_um" not in rows[0]
    # a second map may take its place, a model may not
    assert abbe("error-map", typed, *WORDS, "-o", out).status == 0
    assert abbe("error-map", typed, *WORDS, "-o", typed).status == 1


def test_another_plane_and_one_temperature_given_by_name(typed):
    found = mapped(typed, "--plane", "Z,X", "Y=10", "T_x=22", "--points", 3)
    (one,) = found["maps"]
    assert found["plane"] == "ZX"
    assert one["at"]["Y"] == 10.0
    error = np.array(one["error"])
    assert error[:, :, 0] == pytest.approx(1e3 * ALPHA * 2.0 * np.array([[0.0, 250.0, 500.0]] * 3))
    assert error[:, :, 1] == pytest.approx(1e3 * SQUARE * np.array([[0.0, 250.0, 500.0]] * 3))


@pytest.fixture(scope="module")
def fitted(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("map")
    out = folder / "fitted.toml"
    campaign = write_campaign(folder / "c.csv", seed=5)
    done = abbe("fit", write_model(folder), campaign, "-o", out)
    assert done.status == 0, done.err
    return out


def test_how_sure_is_that_of_the_parameter_and_wider_where_nobody_measured(fitted, tmp_path):
    lever = np.outer(np.linspace(20.0, 27.0, 5) - 20.0, np.linspace(50.0, 450.0, 17))
    sd = SD * 1e-3 / math.sqrt(3.0 * float((lever**2).sum()))
    out, page = tmp_path / "map.csv", tmp_path / "map.html"
    words = ("Z=-80", "--range", "X=50,450", "--range", "Y=119.9,120.1", "--points", 3)
    done = abbe("error-map", fitted, *words, "--temperature", "25,32", "-o", out, "--report", page)
    assert done.status == 0, done.err
    rows = list(csv.DictReader(out.read_text("utf-8").splitlines()))
    inside = [r for r in rows if r["T_x"] == "25" and r["X"] == "450"]
    assert float(inside[0]["plus_minus_X_um"]) == pytest.approx(2e3 * sd * 5.0 * 450.0, rel=5e-3)
    beyond = [r for r in rows if r["T_x"] == "32" and r["X"] == "450"]
    own, change = sd * 12.0 * 450.0, ALPHA * 5.0 * 450.0 / math.sqrt(3.0)
    wide = 2e3 * math.hypot(own, change)
    assert float(beyond[0]["plus_minus_X_um"]) == pytest.approx(wide, rel=5e-3)
    assert "T_x = 32 degC was not measured (20 … 27 degC): the ± is wider for it" in done.err
    text = page.read_text("utf-8")
    assert "SHA-256" in text
    assert "T_x = 32 degC was not measured" in text
    assert "T_x = 32 °C" in text
    assert packed(text, "figures").count('"type":"heatmap"') == 8


def one_line(done: Done, *words: str) -> None:
    assert done.status == 1
    assert len(done.err.strip().splitlines()) == 1, done.err
    for word in words:
        assert word in done.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--plane", "XX"), ("not a plane", "Y, X, Z")),
        (("--plane", "XQ"), ("Q",)),
        (("X=5", "--temperature", "20"), ("spans the plane", "--range X=")),
        (("--range", "Z=0,1", "--temperature", "20"), ("not an axis of the plane",)),
        (("--temperature", "warm"), ("temperature", "°C")),
        ((), ("T_x", "scale_expansion")),
        (("Z=30000", "--temperature", "20"), ("Z",)),
    ],
)
def test_what_is_refused(typed, words, said):
    one_line(abbe("error-map", typed, *words), *said)
