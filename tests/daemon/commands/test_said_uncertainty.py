"""± beside corrections and tables: closed forms of a model with one parameter."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.files.campaign_csv.lines import CHUNK
from tests.support.daemon.command_line import abbe

MODEL = """format = "abbe-model/1"
[machine]
name = "small"
structure = "w b Y X Z t"
[machine.axes.X]
travel = [0.0, 500.0]
[machine.axes.Y]
travel = [0.0, 400.0]
[machine.axes.Z]
travel = [-300.0, 0.0]
[machine.signals.T_x]
unit = "degC"
role = "scale"
axis = "X"
[[effects]]
kind = "scale_expansion"
axis = "X"
signals = ["T_x"]
"""
ALPHA, SD = 1.1e-5, 0.4  # 1/K; µm
POSITIONS = np.repeat(np.linspace(50.0, 450.0, 41), 5)
WARM = np.tile(np.linspace(20.0, 27.0, 5), 41)
LEVER = (WARM - 20.0) * POSITIONS
SD_ALPHA = SD * 1e-3 / math.sqrt(float(LEVER @ LEVER))
"""Of a line through the origin, from the stated uncertainty."""


def run(*words: object) -> str:
    done = abbe(*words)
    assert done.status == 0, done.err
    return done.out


@pytest.fixture(scope="module")
def fitted(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sure")
    start, campaign, out = (folder / n for n in ("m.toml", "c.csv", "fitted.toml"))
    start.write_text(MODEL, encoding="utf-8")
    noise = np.random.default_rng(2).normal(size=len(LEVER))
    noise *= 0.99 / math.sqrt(float(np.mean(noise**2)))  # χ² just below its expectation
    rows = [
        f"{i},a,displacement,{x!r},0,0,1,0,0,{1e3 * ALPHA * k + SD * e!r},{SD},{t!r}"
        for i, (x, k, e, t) in enumerate(
            zip(POSITIONS.tolist(), LEVER.tolist(), noise.tolist(), WARM.tolist(), strict=True)
        )
    ]
    head = ['# format = "abbe-campaign/1"', "# [setups.a]", "# free = []",
            "time,setup,kind,X,Y,Z,ux,uy,uz,value,sd,T_x"]  # fmt: skip
    campaign.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    run("fit", start, campaign, "-o", out)
    return out


def corrected(model: Path, *where: str) -> dict:
    return json.loads(run("correct", model, *where, "--json"))


def test_inside_it_is_that_of_the_parameter(fitted):
    sure = corrected(fitted, "X=300", "Y=0", "Z=0", "T_x=25")["uncertainty"]
    assert sure["X"] == pytest.approx(2.0 * SD_ALPHA * 5.0 * 300.0 * 1e3, rel=1e-3)
    assert (sure["Y"], sure["Z"], sure["unit"], sure["k"]) == (0.0, 0.0, "um", 2.0)
    assert sure["beyond"] == []


@pytest.mark.parametrize(
    ("where", "now", "edge", "named"),
    [
        (("X=300", "T_x=68"), (48.0, 300.0), (7.0, 300.0), ["T_x"]),
        (("X=500", "T_x=25"), (5.0, 500.0), (5.0, 450.0), ["X"]),
        (("X=500", "T_x=68"), (48.0, 500.0), (7.0, 450.0), ["X", "T_x"]),
    ],
)
def test_outside_what_nobody_saw_counts_as_a_rectangle(fitted, where, now, edge, named):
    found = corrected(fitted, *where, "Y=0", "Z=0")
    sure = found["uncertainty"]
    own = SD_ALPHA * now[0] * now[1]
    change = ALPHA * (now[0] * now[1] - edge[0] * edge[1]) / math.sqrt(3.0)
    assert sure["X"] == pytest.approx(2e3 * math.hypot(own, change), rel=2e-2)
    assert [b["name"] for b in sure["beyond"]] == named
    for name in named:
        assert any(w.startswith(f"{name} = ") and "not measured" in w for w in found["warnings"])


def test_a_tool_that_was_not_measured_is_said(fitted):
    sure = corrected(fitted, "X=300", "Y=0", "Z=0", "T_x=25", "tool=0,0,-80")["uncertainty"]
    assert [(b["name"], b["value"], b["measured"]) for b in sure["beyond"]] == [
        ("tool z", -80.0, [0.0, 0.0])
    ]


def test_for_people(fitted):
    text = run("correct", fitted, "X=300", "Y=0", "Z=0", "T_x=25")
    wide = 2.0 * SD_ALPHA * 5.0 * 300.0 * 1e3
    assert f"µm ± {wide:.2f}" in text
    assert "± with k = 2" in text


def test_points_that_nobody_measured_are_said(fitted, tmp_path):
    points = tmp_path / "in.csv"
    for x, said in (("50", 0), ("449", 0), ("451", 1), ("30", 1)):
        points.write_text(f"X,Y,Z,T_x\n100,0,0,21\n{x},0,0,21\n", encoding="utf-8")
        done = abbe("correct", fitted, "--points", points, "-o", tmp_path / f"{x}.csv")
        assert done.status == 0, done.err
        assert done.err.count("was not measured (50 … 450 mm)") == said, x
        assert (f"X = {x} mm was not measured" in done.err) == bool(said)


def rows_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text("utf-8").splitlines()))


def test_every_row_of_a_file_has_its_plus_minus_where_it_is_asked_for(fitted, tmp_path):
    points, out = tmp_path / "in.csv", tmp_path / "out.csv"
    points.write_text(
        "X,Y,Z,T_x,tool_z\n300,0,0,25,0\n300,0,0,68,0\n500,0,0,25,-80\n", encoding="utf-8"
    )
    text = run("correct", fitted, "--points", points, "-o", out, "--uncertainty")
    inside, warm, far = rows_of(out)
    own = 2e3 * SD_ALPHA
    assert float(inside["plus_minus_X_um"]) == pytest.approx(own * 5.0 * 300.0, abs=1e-3)
    assert (inside["plus_minus_Y_um"], inside["not_measured"]) == ("0.000", "")
    change = 2e3 * ALPHA * (48.0 - 7.0) * 300.0 / math.sqrt(3.0)
    wide = math.hypot(own * 48.0 * 300.0, change)
    assert float(warm["plus_minus_X_um"]) == pytest.approx(wide, rel=2e-2)
    assert (warm["not_measured"], far["not_measured"]) == ("T_x", "X tool_z")
    assert f"(± {float(warm['plus_minus_X_um']):.2f} at most)" in text
    # without the option the columns are those of always
    run("correct", fitted, "--points", points, "-o", out)
    assert list(rows_of(out)[0])[-1] == "Z_corrected"


def test_a_file_with_a_temperature_or_tool_that_was_not_measured_says_so(fitted, tmp_path):
    points = tmp_path / "in.csv"
    points.write_text("X,Y,Z,T_x,tool_z\n300,0,0,25,0\n300,0,0,68,-80\n", encoding="utf-8")
    done = abbe("correct", fitted, "--points", points, "-o", tmp_path / "out.csv")
    assert done.status == 0, done.err
    assert "T_x = 68 degC was not measured (20 … 27 degC)" in done.err
    assert "tool z = -80 mm was not measured (at 0 mm)" in done.err


def test_rows_that_a_lag_joins_are_as_sure_as_one_by_one_and_corrected_alike(tmp_path):
    """A file in the order of time: ± must leave no trace in the lags, nor the lags in ±."""
    model = tmp_path / "lag.toml"
    model.write_text(MODEL.replace('signals = ["T_x"]', 'signals = ["T_x"]\ntau = 600.0'), "utf-8")
    along = [300 + i % 7 * 20 for i in range(120)]
    warm = [21 + math.sin(i / 9) for i in range(120)]
    rows = [
        f"{60 * i},a,displacement,{x},0,0,1,0,0,{1e3 * ALPHA * x * (t - 20)!r},{SD},{t!r}"
        for i, (x, t) in enumerate(zip(along, warm, strict=True))
    ]
    head = ['# format = "abbe-campaign/1"', "# [setups.a]", "# free = []",
            "time,setup,kind,X,Y,Z,ux,uy,uz,value,sd,T_x"]  # fmt: skip
    campaign, fitted = tmp_path / "c.csv", tmp_path / "f.toml"
    campaign.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    run("fit", model, campaign, "-o", fitted)
    points, plain, sure = (tmp_path / n for n in ("in.csv", "plain.csv", "sure.csv"))
    lines = [f"{60 * i},300,0,0,{20.2 + i % 50 / 30:.6f},{'-' * 40}" for i in range(25_000)]
    points.write_text("\n".join(["time,X,Y,Z,T_x,remark", *lines]) + "\n", encoding="utf-8")
    assert points.stat().st_size > CHUNK
    run("correct", fitted, "--points", points, "-o", plain)
    run("correct", fitted, "--points", points, "-o", sure, "--uncertainty")
    corrected = [r["X_corrected"] for r in rows_of(plain)]
    assert [r["X_corrected"] for r in rows_of(sure)] == corrected
    # ± of one coefficient goes with what it does, over the borders of pieces too
    printed = np.array(
        [[float(r["X_corrected"]) - 300.0, float(r["plus_minus_X_um"])] for r in rows_of(sure)]
    )
    assert {r["not_measured"] for r in rows_of(sure)} == {""}
    large = printed[np.abs(printed[:, 0]) > 2e-3]
    assert len(large) > 10_000
    share = large[:, 1] / np.abs(large[:, 0])
    assert share.max() / share.min() < 1.05


def test_what_has_no_uncertainty_cannot_be_asked_for_it(fitted, tmp_path):
    points = tmp_path / "in.csv"
    points.write_text("X,Y,Z,T_x\n300,0,0,25\n", encoding="utf-8")
    typed = tmp_path / "typed.toml"
    values = '[effects.parameters.alpha]\nvalue = 1.1e-5\nunit = "1/K"\n'
    typed.write_text(MODEL + values, encoding="utf-8")
    out = tmp_path / "out.csv"
    done = abbe("correct", typed, "--points", points, "-o", out, "--uncertainty")
    assert done.status == 1
    assert "± is not known" in done.err
    assert not out.exists()
    assert abbe("correct", fitted, "X=1", "Y=0", "Z=0", "T_x=21", "--uncertainty").status == 2


def test_tables_say_how_sure_the_model_is_over_the_volume(fitted, tmp_path):
    words = ("--controller", "csv", "--at", "T_x=25", "--volume", "X=50,450")
    made = json.loads(run("table", fitted, *words, "-o", tmp_path / "t", "--json"))
    # largest at the far end, 450 mm; even over X: rms is that of X from 50 to 450
    most = 2e3 * SD_ALPHA * 5.0 * 450.0
    mean_square = (450.0**3 - 50.0**3) / (3.0 * 400.0)
    sure = made["uncertainty"]
    # trial points stand half a step inside the ends
    assert sure["largest"] == pytest.approx(most, rel=1e-2)
    assert sure["rms"] == pytest.approx(2e3 * SD_ALPHA * 5.0 * math.sqrt(mean_square), rel=1e-2)
    assert sorted(sure["beyond"]) == ["Y", "Z"]
    text = run("table", fitted, *words, "-o", tmp_path / "u")
    assert f"How sure the model is there: ± {sure['largest']:.1f} µm at most" in text
    assert "was not measured" in text


def test_a_model_that_was_typed_in_does_not_pretend(fitted, tmp_path):
    typed = tmp_path / "typed.toml"
    values = '[effects.parameters.alpha]\nvalue = 1.1e-5\nunit = "1/K"\n'
    typed.write_text(MODEL + values, encoding="utf-8")
    assert corrected(typed, "X=300", "Y=0", "Z=0", "T_x=25")["uncertainty"] is None
    text = run("correct", typed, "X=300", "Y=0", "Z=0", "T_x=25")
    assert "± is not known" in text
