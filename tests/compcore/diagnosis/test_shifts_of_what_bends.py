"""A column that bends from its foot also moves the zero of its axis, by the same thermometers."""

from __future__ import annotations

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.thermometers import further_thermometers
from abbe.compcore.diagnosis.verdict import lacking
from abbe.compcore.effects.base import Effect
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect
from benchmarks.hidden.judging.trial import as_campaign

MODEL = """format = "abbe-model/1"
[machine]
name = "mill"
structure = "w X' Y' b Z t"
[machine.axes.X]
travel = [0.0, 800.0]
[machine.axes.Y]
travel = [-250.0, 250.0]
[machine.axes.Z]
travel = [0.0, 500.0]
[machine.signals.front]
unit = "degC"
role = "structure"
[machine.signals.rear]
unit = "degC"
role = "structure"
"""
FOOT = 300.0
"""From the column's foot to Z's zero, mm."""
BENT = 11e-6 / 420.0
"""Curvature of iron, 420 mm deep, a kelvin of difference, 1/(mm·K)."""


def bent(seed: int) -> tuple[Model, Campaign]:
    """Four sunny days of a column, read at three heights; it bends as a circle from its foot."""
    rng = np.random.default_rng(seed)
    heads, rows = [], []
    for day in range(4):
        heads.append(f'# [setups.d{day}]\n# free = ["zero"]\n')
        hours = np.arange(0.0, 8.0, 0.2)
        sun = rng.uniform(1.0, 2.0) * np.exp(-(((hours - rng.uniform(3.0, 5.0)) / 1.5) ** 2))
        rear = 20.0 + 0.3 * hours
        stays = 0.0
        for hour, more, cold in zip(hours, sun, rear, strict=True):
            stays = 0.9 * stays + rng.normal(0.0, 0.25)
            for z in (0.0, 200.0, 400.0):
                back = 1e3 * BENT * more * (FOOT + z) ** 2 / 2.0
                value = back + stays + rng.normal(0.0, 0.2)
                at = 3600.0 * (24.0 * day + hour)
                read = f"{cold + more:.2f},{cold:.2f}"
                rows.append(f"{at:.0f},d{day},displacement,0,0,{z},0,1,0,{value:.3f},{read}\n")
    model = parse_model(TomlSource(MODEL))
    columns = "time,setup,kind,X,Y,Z,ux,uy,uz,value,front,rear\n"
    head = '# format = "abbe-campaign/1"\n' + "".join(heads)
    return model, as_campaign(head + columns + "".join(rows), model)


def offered(kind: str, where: dict[str, object]) -> tuple[list[Effect], set[str]]:
    """What is offered beside one effect that was established: the first, and all as specs."""
    model, campaign = bent(1)
    more, warm = with_effect(model, kind, where)
    found = further_thermometers(lacking(fit(more, campaign)), [warm])
    return found[0] if found else [], {e.spec for effects in found for e in effects}


def test_what_bends_from_its_foot_shifts_the_zero_too() -> None:
    where = {"axis": "Z", "about": "X", "signals": ["front", "rear"], "deflection": True}
    first, specs = offered("thermal_bending", where)
    assert first
    assert {e.kind for e in first} == {"thermal_offset"}
    # where nothing moves nothing is offered
    assert not {s for s in specs if s.startswith("thermal_offset") and "direction=Y" not in s}
