"""What five targets show is a table, no wave; what bends a drilled plate is no beam that sags."""

from __future__ import annotations

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging import trial

DRILL = """format = "abbe-model/1"
[machine]
name = "drilling machine"
structure = "w X' Y' b Z t"
[machine.axes.X]
travel = [-400, 400]
[machine.axes.Y]
travel = [-400, 400]
[machine.axes.Z]
travel = [-200, 100]
"""

SLIT = """format = "abbe-model/1"
[machine]
name = "slit"
structure = "w b X t"
[machine.axes.X]
travel = [0, 70]
"""


def left(model: Model, campaign: Campaign) -> float:
    return float(np.sqrt(np.mean(np.square(compare(model, campaign).residual)))) * 1e3


def test_five_targets_show_no_wave() -> None:
    """A sine goes through them, and through any five that lie so."""
    model = parse_model(TomlSource(SLIT))
    rng = np.random.default_rng(4)
    errors = [6.0, 1.0, -15.0, 1.0, 6.0]
    lines = [
        f"s,displacement,{x},{sense},1,0,0,{e + rng.normal(0.0, 2.5):.2f}"
        for _ in range(3)
        for sense in (1, -1)
        for x, e in list(zip((15, 25, 35, 45, 55), errors, strict=True))[::sense]
    ]
    head = '# format = "abbe-campaign/1"\nsetup,kind,X,X_dir,ux,uy,uz,value\n'
    fitted = trial.as_campaign(head + "\n".join(lines) + "\n", model)
    found = to_the_verdict(model, fitted).last.result.model
    assert [e.kind for e in found.effects] == ["positioning"]


def test_one_run_each_way_leaves_something_to_diagnose() -> None:
    """As many coefficients as rows foretell nothing: a table of each direction is not taken."""
    model = parse_model(TomlSource(SLIT))
    rng = np.random.default_rng(3)
    errors = 20.0 * rng.normal(size=10)
    lines = [
        f"s,displacement,{15 + 5 * i},{sense},1,0,0,{errors[i] + rng.normal(0.0, 2.0):.2f}"
        for sense in (1, -1)
        for i in range(10)
    ]
    head = '# format = "abbe-campaign/1"\nsetup,kind,X,X_dir,ux,uy,uz,value\n'
    fitted = trial.as_campaign(head + "\n".join(lines) + "\n", model)
    course = to_the_verdict(model, fitted)
    assert course.last.result.dof > 0
    # the mean of both ways is what each foretells of the other
    assert [s.action for s in course.steps] == ["began", "described"]
    assert course.last.held_out.lengths < 3e-3


def drilled(model: Model, seed: int, holes: int) -> Campaign:
    """Holes of a plate that was bent when it was drilled: scales, and cubics of both positions."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-315, 315, holes), rng.uniform(-245, 250, holes)
    u, v = x / 315.0, y / 250.0
    error = np.array([-12.0 * u + 5.0 * v**2 + 3.0 * u**3, 9.0 * v - 6.0 * u * v**2 + 4.0 * u * v])
    error += rng.normal(0.0, 2.5, (2, holes))
    lines = [
        f"p,displacement,{a:.3f},{b:.3f},0,{1 - k},{k},0,{e:.1f}"
        for a, b, both in zip(x, y, error.T, strict=True)
        for k, e in enumerate(both)
    ]
    head = '# format = "abbe-campaign/1"\n# [setups.p]\n# free = ["frame"]\n'
    head += "setup,kind,X,Y,Z,ux,uy,uz,value\n"
    return trial.as_campaign(head + "\n".join(lines) + "\n", model)


def test_a_bent_plate_is_described_and_no_beam_sags_level() -> None:
    model = parse_model(TomlSource(DRILL))
    course = to_the_verdict(model, drilled(model, 1, 220))
    kinds = [e.kind for e in course.last.result.model.effects]
    assert "overhang_sag" not in kinds
    other = drilled(model, 2, 100)
    # what a cubic of X and Y leaves of other holes is 2.6 µm; nothing leaves 8.8
    assert left(course.last.result.model, other) < 2.8
