"""A plain positioning error that is read in even steps is fitted by no screw's short wave."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.campaign.sampling import alias
from abbe.compcore.effects import Cyclic
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure

AXES = {a: Axis(a, (0.0, 700.0)) for a in "XYZ"}
MACHINE = Machine("bridge", Structure.parse("w b Y X Z t"), AXES, {})


@pytest.mark.parametrize("step", [1.0, 7.0, 50.0, 200.0])
def test_no_period_is_tried_that_even_steps_show_as_a_longer_one(step: float):
    """Read every 50 mm, a wave of 6.2 mm is one of 775 mm: a plain positioning error."""
    (seen,) = Cyclic(axis="X").search(MACHINE, Coverage(steps={"X": step}))
    assert all(p > 2.0 * step or alias(step, p) <= 60.0 for p in seen.starts)
    assert (10.0 in seen.starts) == (step < 10.0), "read every 7 mm, 10 mm look like 23 mm"
    assert seen.bounds[1] == pytest.approx(700.0)


def test_uneven_steps_and_other_axes_narrow_nothing():
    (free,) = Cyclic(axis="X").nonlinear(MACHINE)
    for coverage in (Coverage(), Coverage(steps={"Y": 50.0})):
        assert Cyclic(axis="X").search(MACHINE, coverage) == (free,)
    assert Cyclic(axis="X", period=10.0).search(MACHINE, Coverage(steps={"X": 50.0})) == ()
    assert np.isfinite(free.bounds).all()
