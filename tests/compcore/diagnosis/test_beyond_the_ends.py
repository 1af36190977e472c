"""A description in a temperature is taken only if it holds beyond what it was made of."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.uncatalogued.beyond_the_ends import holds_at_the_ends
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.revise import with_effect
from benchmarks.hidden.judging.trial import as_campaign

MACHINE = """
format = "abbe-model/1"
[machine]
name = "one place"
structure = "w b X Y Z t"
[machine.axes.X]
travel = [0.0, 400.0]
[machine.axes.Y]
travel = [0.0, 400.0]
[machine.axes.Z]
travel = [0.0, 400.0]
[machine.signals.T]
unit = "degC"
role = "structure"
"""


@pytest.mark.parametrize(
    ("error_um", "holds"),
    [
        # what levels off at both ends is between them nearly straight, and no parabola
        (lambda warm: 10.0 * np.tanh(2.0 * (warm - 4.5)), False),
        (lambda warm: 0.8 * warm**2, True),
    ],
)
def test_the_warmest_and_the_coldest_hours_are_foretold_from_the_others(
    error_um: Callable[[float], float], *, holds: bool
) -> None:
    rng = np.random.default_rng(5)
    rows = ['# format = "abbe-campaign/1"', "# [setups.one]", '# free = ["zero"]']
    rows.append("time,setup,kind,X,Y,Z,ux,uy,uz,value,T")
    for i, warm in enumerate(np.linspace(0.0, 9.0, 200)[rng.permutation(200)]):
        value = error_um(warm) + rng.normal(0.0, 0.3)
        rows.append(f"{60 * i},one,displacement,200,200,200,0,0,1,{value:.3f},{20.0 + warm:.3f}")
    model = parse_model(TomlSource(MACHINE))
    campaign = as_campaign("\n".join(rows) + "\n", model)
    more, added = with_effect(model, "formula", {"channel": "dZ", "terms": "(T-25),(T-25)**2"})
    before, after = fit(model, campaign), fit(more, campaign)
    was, now = LeftOutErrors.of(before), LeftOutErrors.of(after)
    assert was.falls_to(now, after, bound=False) < 0.5
    assert holds_at_the_ends(before, after, [added]) is holds
