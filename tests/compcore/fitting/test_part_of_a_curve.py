"""Of a curve that was read over some of the travel only the rest is not determined."""

from __future__ import annotations

import re

import numpy as np

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.fitting.fit import fit
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import bridge, model


def said_of(last: float) -> list[str]:
    """What is not determined of E_BX, read from 0 to `last` mm of 700 by an autocollimator."""
    x = np.linspace(0.0, last, 30)
    rows = Rows(("X", "Y", "Z"))
    place = {"X": x, "Y": np.full(30, 300.0), "Z": np.full(30, -100.0)}
    rows.add("tilt", Kind.ROTATION, place, np.zeros(30), 1e-6, u=(0.0, 1.0, 0.0), free=())
    found = fit(model(bridge(), "angular axis=X about=Y shape=spline:12"), rows.campaign("tilt"))
    return [u.text for u in found.undetermined if not u.convention]


def test_the_part_that_was_not_read_is_said_as_a_part() -> None:
    assert said_of(700.0) == []
    (one,) = said_of(350.0)
    assert re.match(r"a part of E_BX: this campaign does not show it", one)
