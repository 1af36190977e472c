"""The side of approach, component by component, and the verdict that stands first."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.comparison.compare import Comparison, compare
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.fitting.fit import fit

DATA = Path(__file__).parents[2] / "data"


def compared(name: str) -> Comparison:
    """A public campaign fitted, and beside the measurements that were not fitted."""
    folder = DATA / name
    model = load_model(folder / "model.toml")
    fitted = fit(model, read_campaign(folder / "fit.csv", model.machine)).model
    return compare(fitted, read_campaign(folder / "check.csv", model.machine))


@pytest.fixture(scope="module")
def backlash_of_z() -> Comparison:
    """Play of Z, which most of these rows do not measure: diagonals, lines along Y."""
    return compared("p03-bridge")


def test_play_is_found_where_rows_of_all_components_are_mixed(backlash_of_z: Comparison) -> None:
    (side,) = backlash_of_z.sides
    assert (side.axis, side.component) == ("Z", "Z")
    assert side.difference == pytest.approx(5.4e-3, abs=0.6e-3)
    assert side.share > 0.5
    mixed = [g.mean for g in backlash_of_z.lengths.tables.directions if g.of["axis"] == "Z"]
    assert max(map(abs, mixed)) < 0.3  # µm: what a table of all components shows


def test_the_verdict_names_it_and_the_next_command(backlash_of_z: Comparison) -> None:
    first, second, *_, last = backlash_of_z.verdict()
    assert not backlash_of_z.holds
    assert "DOES NOT HOLD" in first
    assert second.startswith("Z stands 5.")
    assert "towards minus, when it comes from above" in second
    assert last == "next: abbe.diagnose(model, campaign)"
    assert next(iter(backlash_of_z.words())) == first


def test_groups_by_side_are_of_one_component(backlash_of_z: Comparison) -> None:
    campaign = backlash_of_z.problem.campaign
    groups = backlash_of_z.by_side(backlash_of_z.lengths)
    for axis in "XYZ":
        mine = [g for g in groups if g.of["axis"] == axis]
        moved = campaign.conditions.direction(axis) != 0.0
        assert sum(g.n for g in mine) == int((moved & backlash_of_z.lengths.rows).sum())
        assert {g.of["measured"] for g in mine} >= {"Y", "oblique"}


@pytest.mark.parametrize("name", ["p01-mill", "p02-bridge"])
def test_where_nothing_depends_on_the_side_nothing_is_said(name: str) -> None:
    assert compared(name).sides == []


def test_a_model_that_explains_its_campaign_holds() -> None:
    model = load_model(DATA / "p03-bridge/model.toml")
    campaign = read_campaign(DATA / "p03-bridge/check.csv", model.machine)
    noise = np.random.default_rng(1).normal(0.0, campaign.sd)
    found = compare(model, replace(campaign, value=noise))
    assert found.holds
    assert next(found.verdict()).startswith("The model holds")
