"""Knots that are found, by the command line: fit, add, tables."""

from __future__ import annotations

import json

import numpy as np
import pytest

from abbe.compcore.files.campaign_file import write_campaign
from abbe.compcore.files.model_file import load_model, save_model
from tests.compcore.fitting.test_knots import LENGTH, measured, model, truth
from tests.support.daemon.command_line import abbe


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("knots")
    save_model(model(), folder / "m.toml")
    write_campaign(measured(0), folder / "line.csv")
    done = abbe("fit", folder / "m.toml", folder / "line.csv", "-o", folder / "f.toml", "--json")
    assert done.status == 0, done.err
    return folder, json.loads(done.out)


def test_fit_says_where_the_knots_are_and_how_sure(fitted):
    folder, answer = fitted
    (knots,) = answer["knots"]
    assert knots["unit"] == "mm"
    assert len(knots["places"]) == len(knots["sd"])
    assert sum(knots["probability"].values()) == pytest.approx(1.0)
    assert knots["curve_unit"] == "µm"
    assert load_model(folder / "f.toml").effects[0].positions == tuple(knots["places"])


def test_add_finds_knots_too(fitted):
    folder, _ = fitted
    save_model(model("spline:4"), folder / "plain.toml")
    done = abbe("add", folder / "plain.toml", "positioning", "axis=X", "shape=spline:auto",
                "--campaign", folder / "line.csv", "-o", folder / "more.toml")  # fmt: skip
    assert done.status == 0, done.err
    assert load_model(folder / "more.toml").effects[0].positions


def test_tables_are_those_of_the_curve(fitted):
    folder, _ = fitted
    done = abbe("table", folder / "f.toml", "--controller", "linuxcnc", "-o", folder / "t")
    assert done.status == 0, done.err
    rows = np.loadtxt(folder / "t" / "x.comp")
    inside = (rows[:, 0] >= 0.0) & (rows[:, 0] <= LENGTH)
    off = rows[inside, 1] - rows[inside, 0] - truth(rows[inside, 0])
    assert np.abs(off - off.mean()).max() < 1.2e-3
