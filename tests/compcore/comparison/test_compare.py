"""The comparison: only placings are fitted; tables, lines and instrument effects are right."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.comparison.compare import compare
from abbe.compcore.comparison.lines import split
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.model_toml.fit_record import recorded
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Value
from abbe.daemon.answers.switches import not_applied
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import (
    BASES,
    DIRECTIONS,
    GEOMETRY,
    TOOLS,
    bridge,
    distance_rows,
    mill,
    model,
    plane_rows,
    random_theta,
    with_truth,
)


def measured(seed: int = 0, extra: tuple[str, ...] = ()):
    rng = np.random.default_rng(seed)
    rows = Rows(("X", "Y", "Z"))
    plane_rows(rows)
    wanted = model(bridge(), *GEOMETRY, *extra)
    campaign = rows.campaign("plane")
    theta = random_theta(wanted, campaign, rng)
    return wanted, with_truth(wanted, campaign, theta, rng)


def kept(result, wanted, name: str = "a.csv"):
    return recorded(result, wanted, date="2026-01-01", version="0", noise_floor=None)


def test_a_fitted_model_beside_its_own_campaign_leaves_what_the_fit_left() -> None:
    wanted, campaign = measured()
    campaign = replace(campaign, files={"a.csv": "11"})
    result = fit(wanted, campaign)
    comparison = compare(kept(result, wanted), campaign)
    assert comparison.residual == pytest.approx(result.residual, abs=1e-9)
    lengths, rotations = comparison.lengths, comparison.rotations
    assert lengths.rms == pytest.approx(result.rms(Kind.DISPLACEMENT))
    assert rotations.rms == pytest.approx(result.rms(Kind.ROTATION))
    assert lengths.n + rotations.n == campaign.n
    assert lengths.chi2_per_dof == pytest.approx(1.0, abs=0.3)
    assert lengths.max == pytest.approx(np.abs(result.residual[lengths.rows]).max())
    assert lengths.worst[0].row == np.argmax(np.abs(np.where(lengths.rows, result.residual, 0.0)))
    assert lengths.worst[0].line == campaign.line[lengths.worst[0].row]


def test_an_unfitted_model_predicts_nothing() -> None:
    wanted, campaign = measured()
    comparison = compare(wanted, campaign)
    assert comparison.residual == pytest.approx(comparison.measured, abs=1e-12)
    line = next(entry for entry in comparison.lines if entry.setup == "d0")
    assert line.linear_before == pytest.approx(line.linear_after)
    assert line.length == pytest.approx(np.hypot(700.0, 900.0))


def test_the_tables_divide_all_rows() -> None:
    wanted, campaign = measured()
    comparison = compare(wanted, campaign)
    tables = comparison.lengths.tables
    residual = comparison.residual[comparison.lengths.rows] * 1e3
    total = (residual**2).sum()
    for groups in (
        tables.setups,
        [g for g in tables.regions if g.of["axis"] == "X"],
        tables.tools,
    ):
        assert sum(g.n for g in groups) == comparison.lengths.n
        assert sum(g.n * g.rms**2 for g in groups) == pytest.approx(total)
        assert max(g.max for g in groups) == pytest.approx(np.abs(residual).max())
    assert {g.of["setup"] for g in tables.setups} == {
        s for s in campaign.setups if not s.startswith("r")
    }


def test_placings_are_fitted_effects_are_not() -> None:
    rng = np.random.default_rng(1)
    rows = Rows(("X", "Y", "Z"))
    distance_rows(rows, rng)
    wanted = model(mill(), "positioning axis=X shape=polynomial:3", "squareness axes=X,Y")
    campaign = rows.campaign("distances", bases=BASES, tools=TOOLS)
    theta = random_theta(wanted, campaign, rng)
    measured_ = with_truth(wanted, campaign, theta, rng)
    true = wanted.with_values(fit(wanted, measured_).problem.layout.values(theta, theta * 0.0))
    comparison = compare(true, measured_)
    assert comparison.lengths.chi2_per_dof == pytest.approx(1.0, abs=0.25)
    moved = {n: comparison.theta[w] for n, w in comparison.problem.layout.bases.items()}
    assert np.linalg.norm(moved["B1"] - np.array(BASES["B1"])) > 1e-2
    assert comparison.theta[: len(theta) - 14] == pytest.approx(theta[: len(theta) - 14])
    wrong = [{k: replace(v, value=v.value + 1e-4) for k, v in t.values.items()} for t in true.terms]
    assert compare(true.with_values(wrong), measured_).lengths.chi2_per_dof > 3.0


def test_effects_of_a_placing_count_only_where_they_were_fitted() -> None:
    extra = ("cosine setup=y1",)
    wanted, campaign = measured(extra=extra)
    campaign = replace(campaign, files={"a.csv": "11"})
    fitted = kept(fit(wanted, campaign), wanted)
    assert compare(fitted, campaign).left_out == ()
    other = replace(campaign, files={"b.csv": "22"})
    assert compare(fitted, other).left_out == ("cosine setup=y1",)
    assert compare(fitted, other).lengths.rms > compare(fitted, campaign).lengths.rms


def test_a_line_is_split_into_slope_and_rest() -> None:
    along = np.repeat(np.linspace(-300.0, 300.0, 21), 2)
    noise = np.tile([1e-4, -1e-4], 21)
    slope, rest = split(along, 2e-5 * along + 1e-3 * np.cos(np.pi * along / 100.0) + noise)
    assert slope == pytest.approx(2e-5, rel=1e-6)
    assert rest == pytest.approx(2e-3, rel=0.1)


def test_one_directional_rows_make_lines_and_points_do_not() -> None:
    rows = Rows(("X", "Y", "Z"))
    x = np.linspace(0.0, 700.0, 8)
    place = {"X": x, "Y": 100.0, "Z": -100.0}
    rows.add("line", Kind.DISPLACEMENT, place, 1e-5 * x, 1e-3, u=DIRECTIONS["X"])
    still = {"X": 1.0, "Y": 100.0, "Z": -100.0}
    rows.add("point", Kind.DISPLACEMENT, still, np.zeros(8), 1e-3, u=DIRECTIONS["X"])
    rng = np.random.default_rng(0)
    cloud = {a: rng.uniform(0.0, 500.0, 8) for a in "XY"} | {"Z": -100.0}
    rows.add("cloud", Kind.DISPLACEMENT, cloud, np.zeros(8), 1e-3, u=DIRECTIONS["X"])
    found = compare(model(bridge()), rows.campaign("lines")).lines
    assert [entry.setup for entry in found] == ["line"]
    assert found[0].linear_before == pytest.approx(7e-3)


def _a_day(date: str, path: Path, drift: float = 0.0) -> Campaign:
    head = f'# format = "abbe-campaign/1"\n# date = "{date}"\n' if date else ""
    rows = ["time,setup,kind,X,ux,uy,uz,value"]
    rows += [
        f"{36 * k},s,displacement,{x:g},1,0,0,{0.01 * x + drift * 0.01 * k + 0.1 * (-1) ** k:.3f}"
        for k, x in enumerate(20 * list(range(0, 500, 50)))
    ]
    path.write_text((head or '# format = "abbe-campaign/1"\n') + "\n".join(rows) + "\n")
    return read_campaign(path, CLOCKED.machine)


CLOCKED = parse_model(
    TomlSource(
        'format = "abbe-model/1"\n[machine]\nname = "slide"\nstructure = "w b X t"\n'
        "[machine.axes.X]\ntravel = [0.0, 500.0]\n"
        '[[effects]]\nkind = "scale"\naxis = "X"\n'
        '[[effects]]\nkind = "drift"\ndirection = "X"\n'
    )
)


@pytest.mark.parametrize(
    ("other", "applied"), [("2026-11-21", False), ("2026-11-20", True), ("", True)]
)
def test_a_drift_is_of_its_day(other: str, applied: bool, tmp_path: Path) -> None:
    """An independent simulator: a drift of the fitted day spoilt the next one, 0.42 → 2.15 µm."""
    fitted = fit(CLOCKED, _a_day("2026-11-20", tmp_path / "a.csv", drift=5.0))
    kept = recorded(fitted, CLOCKED, date="2026-11-22", version="0", noise_floor=None)
    beside = compare(kept, _a_day(other, tmp_path / "b.csv"))
    assert beside.other_day == (() if applied else ("drift direction=X",))
    assert beside.same_day == (("drift direction=X",) if not other else ())
    assert (beside.lengths.rms > 2e-3) == applied
    said = " ".join(beside.words())
    assert ("this is another one" in said) == (not applied)
    assert ("do not say their days" in said) == (not other)


def test_what_is_of_its_day_is_not_compensated() -> None:
    """It would run again from the start of every correction, by another clock."""
    model = CLOCKED.with_values([{"k": Value(1e-6)}, {"rate": Value(1e-6)}])
    assert [t.effect.kind for t in model.switched().terms] == ["scale"]
    assert model.of_their_day == ("drift direction=X",)
    assert "drift direction=X holds on the day only" in " ".join(not_applied(model))
