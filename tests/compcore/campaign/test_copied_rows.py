"""Rows that stand twice are said with their lines; repeats of a coarse resolution are none."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.suspicions import of_campaign
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from benchmarks.hidden.judging.trial import as_campaign

MODEL = parse_model(
    TomlSource("""
format = "abbe-model/1"
[machine]
name = "mill"
structure = "w b X Y Z C t"
axes.X.travel = [0.0, 800.0]
axes.Y.travel = [0.0, 600.0]
axes.Z.travel = [-500.0, 0.0]
axes.C.travel = [-180.0, 180.0]
""")
)
HEAD = '# format = "abbe-campaign/1"\n'


def rows(runs=2, step=1e-3, noise=0.4, clock=True, inch=1.0, degree=1.0, name="x"):
    """A laser line along X, forward and back: 20 ppm, play 3 µm, read in steps."""
    rng = np.random.default_rng(2)
    found, time = [], 0
    for _ in range(runs):
        for way in (1, -1):
            for q in np.linspace(0.0, 800.0, 11)[::way]:
                time += 10
                value = 0.02 * q + 1.5 * way + rng.normal(0.0, noise)
                value = np.round(value / step) * step
                start = f"{time}," if clock else ""
                angle = 0.45 * (q - 400.0)
                found.append(
                    f"{start}{name},displacement,{q / inch:.6f},0,0,{angle / degree:.8f},"
                    f"{way},1,0,0,{value:.3f}"
                )
    return found


def said(found, clock=True):
    columns = ("time," if clock else "") + "setup,kind,X,Y,Z,C,X_dir,ux,uy,uz,value"
    text = HEAD + "\n".join([columns, *found]) + "\n"
    return " ".join(of_campaign(as_campaign(text, MODEL), MODEL.machine))


@pytest.mark.parametrize("clock", [True, False])
def test_a_file_pasted_twice(clock):
    own = rows(clock=clock)
    assert "44 of 88 rows stand twice" in (words := said(own + own, clock))
    assert "lines 47 to 90 = lines 3 to 46" in words


def test_exported_twice_under_another_name():
    words = said(rows(clock=False) + rows(clock=False, name="again"), clock=False)
    assert "44 of 88 rows stand twice" in words


def test_one_row_with_a_clock_is_enough():
    assert "1 of 45 rows" in (words := said([*rows(), rows()[7]]))
    assert "line 47 = line 10" in words


@pytest.mark.parametrize("step", [1e-3, 1.0, 5.0])
def test_repeats_of_any_resolution_are_no_copies(step):
    assert said(rows(runs=5, step=step, clock=False), clock=False) == ""
    assert said(rows(runs=5, step=step)) == ""


def test_inches_and_radians_by_name():
    assert "positions of X look like inches: factor 25.4" in said(rows(inch=25.4))
    assert "positions of C look like radians: factor 57.3" in said(rows(degree=180.0 / np.pi))
