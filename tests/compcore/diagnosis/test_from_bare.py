"""Where a bare machine ends: what speaks for motions, for their detail, and for a spindle."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.screening.levers import shift_of
from abbe.compcore.diagnosis.stepwise.best_on_the_way import foretells_better
from abbe.compcore.diagnosis.stepwise.growing_model import GrowingModel
from abbe.compcore.diagnosis.stepwise.to_the_verdict import _complete_motions
from abbe.compcore.diagnosis.stepwise.whole_body import _give_way
from abbe.compcore.effects.registry import make_effect
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging.trial import as_campaign

HEAD = '# format = "abbe-campaign/1"\n# instrument = "laser interferometer"\n'
MILL = """format = "abbe-model/1"
[machine]
name = "mill"
structure = "w Y' b X Z t"
[machine.axes.X]
travel = [0.0, 500.0]
[machine.axes.Y]
travel = [0.0, 1000.0]
[machine.axes.Z]
travel = [-300.0, 0.0]
[machine.signals.T_bearing]
unit = "degC"
role = "spindle"
"""


def spindle(model: Model) -> Campaign:
    """Lines of X and Y, cold, then a spindle on and off at one place; µm in the formulas."""
    noise = random.Random(3)
    rows = [HEAD + "time,setup,kind,X,Y,Z,ux,uy,uz,value,sd,T_bearing"]
    t = 0.0
    for line in range(2):
        for i in range(13):
            along = 6.0 * math.sin(i / 3.0) + noise.gauss(0.0, 0.3)
            rows.append(f"{t},x{line},displacement,{40 * i},300,-150,1,0,0,{along},0.3,20.5")
            rows.append(f"{t},y{line},displacement,250,{80 * i},-150,0,1,0,{-along},0.3,20.5")
            t += 10.0
    bearing = 0.0
    for i in range(200):
        heat = 12.0 if (i // 40) % 2 == 0 else 0.0
        bearing += (heat - bearing) * 120.0 / 420.0
        grows = -3.0 * bearing + noise.gauss(0.0, 0.3)
        rows.append(f"{t},e,displacement,250,300,-150,0,0,1,{grows},0.3,{20.5 + bearing:.2f}")
        t += 120.0
    return as_campaign("\n".join(rows) + "\n", model)


def test_what_a_spindle_foretells_speaks_against_no_motion() -> None:
    """Before, motions gave way: beside all of them nobody had put what the spindle does."""
    model = parse_model(TomlSource(MILL))
    campaign = spindle(model)
    grows = make_effect("thermal_offset", {"direction": "Z", "signal": "T_bearing"})
    motions = [make_effect("positioning", {"axis": a, "shape": "spline:5"}) for a in "XY"]
    plain = fit(model.with_effects(grows, motions[0]), campaign)
    body = fit(model.with_effects(*motions), campaign)
    one, two = LeftOutErrors.beside(plain, body, (grows, *motions))
    assert foretells_better(one.left.residual, two.left.residual, body)
    assert not _give_way(plain, body, (grows, *motions))


def test_a_wave_is_no_finer_motion() -> None:
    """A wave that grows along Y; before, splines and a table of its every crest came first."""
    noise = random.Random(1)
    model = parse_model(TomlSource(MILL.split("[machine.signals")[0]))
    rows = [HEAD + "setup,kind,X,Y,Z,ux,uy,uz,value,sd"]
    fine = [float(a + i) for a in (20, 480, 960) for i in range(21)]
    for line in range(2):
        for place in sorted(fine + [37.3 * i for i in range(27)]):
            y = min(max(round(place + noise.uniform(-0.3, 0.3), 1), 0.0), 1000.0)
            bent = 12.0 * math.sin(y / 50.0)
            wave = (0.3 + 2.4 * y / 1000.0) * math.sin(2.0 * math.pi * y / 8.0)
            value = bent + wave + noise.gauss(0.0, 0.2)
            rows.append(f"l{line},displacement,250,{y},-150,0,1,0,{value},0.2")
    campaign = as_campaign("\n".join(rows) + "\n", model)
    moves = make_effect("positioning", {"axis": "Y"})
    growing = GrowingModel(model.with_effects(moves), campaign, lambda _: None, lambda _: None)
    growing.added = [moves]
    unexplained = replace(growing.diagnosed(), established=(), verdict="unexplained")
    wave, finer = (
        next(f for f in unexplained.ranked if f.candidate.effect.kind == kind)
        for kind in ("cyclic", "positioning")
    )
    unexplained = replace(unexplained, ranked=(wave, finer))
    assert not _complete_motions(growing, unexplained)
    assert _complete_motions(growing, replace(unexplained, ranked=(finer,)))


@pytest.mark.parametrize(
    ("direction", "other", "same"),
    [
        ("Z", {"axis": "X", "about": "X", "signal": "load"}, True),
        ("Z", {"axis": "X", "about": "Z", "signal": "load"}, False),
        ("Z", {"axis": "Y", "about": "X", "signal": "load"}, False),
        ("Z", {"axis": "X", "direction": "Z", "signal": "load"}, False),
    ],
)
def test_a_load_bends_before_it_twists(
    direction: str, other: dict[str, object], same: bool
) -> None:
    """Where no lever differs; whatever came before decided between them by the last digits."""
    bends = make_effect("load_bending", {"axis": "X", "direction": direction, "signal": "load"})
    assert shift_of(bends, make_effect("load_bending", other)) == same
