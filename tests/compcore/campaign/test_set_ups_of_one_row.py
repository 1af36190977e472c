"""Campaigns of whose every row a set-up's zero takes all: refused at once, never said to hold."""

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign, Setup
from abbe.compcore.comparison.compare import compare
from abbe.compcore.errors import FitError, InputError
from abbe.compcore.fitting.fit import fit
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import GEOMETRY, bridge, model, plane_rows

MODEL = model(bridge(), *GEOMETRY)


def named(names: list[str], free: tuple[str, ...] = ("zero",)) -> Campaign:
    rows = Rows(("X", "Y", "Z"))
    plane_rows(rows)
    campaign = rows.campaign("plane").rows(np.arange(len(names)))
    conditions = replace(campaign.conditions, setup=np.array(names))
    setups = {name: Setup(name, free) for name in dict.fromkeys(names)}
    return replace(campaign, conditions=conditions, setups=setups)


@pytest.mark.parametrize("use", [compare, fit])
def test_each_row_a_set_up_of_its_own_is_refused(use) -> None:
    with pytest.raises(InputError, match="each row is a set-up of its own") as said:
        use(MODEL, named([f"s{i}" for i in range(40)]))
    assert "40 set-ups in 40 rows" in str(said.value)


def test_where_zeros_are_known_it_is_compared() -> None:
    assert compare(MODEL, named([f"s{i}" for i in range(40)], free=())).lengths.n == 40


def test_where_placings_take_all_nothing_is_said_to_hold() -> None:
    pairs = named([f"s{i // 2}" for i in range(40)], free=("zero", "slope"))
    with pytest.raises(FitError, match="nothing is left over"):
        compare(MODEL, pairs)
