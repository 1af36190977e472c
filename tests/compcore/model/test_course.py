"""How far an error motion goes, by a table whose curve is known."""

from __future__ import annotations

import pytest

from abbe.compcore.effects import Angular, Backlash, LoadBending, Scale
from abbe.compcore.model.course import peak_to_valley, play
from abbe.compcore.model.model import Term, Value
from tests.support.compcore.unsure_machines import MACHINE

YAW = Angular(axis="X", about="Z", shape="table", positions=(0.0, 200.0, 400.0, 700.0))


@pytest.mark.parametrize(
    ("low", "high", "size"), [(0.0, 700.0, 9e-6), (0.0, 200.0, 5e-6), (100.0, 300.0, 4.5e-6)]
)
def test_only_what_was_measured_counts(low: float, high: float, size: float) -> None:
    values = dict(zip((p.name for p in YAW.linear(MACHINE)), (0.0, 5e-6, -4e-6, 1e-6), strict=True))
    term = Term(YAW, {name: Value(v, 1e-7) for name, v in values.items()})
    assert peak_to_valley(term, MACHINE, low, high) == pytest.approx(size, rel=0.02)


def test_a_constant_of_an_axis_has_no_curve() -> None:
    assert peak_to_valley(Term(Scale(axis="X"), {"k": Value(1e-5, 1e-6)}), MACHINE, 0, 700) is None


def test_play_by_its_least_and_greatest() -> None:
    lost = Backlash(axis="X", shape="table", positions=(0.0, 200.0, 700.0))
    values = zip((p.name for p in lost.linear(MACHINE)), (-3e-3, 4e-3, 1e-3), strict=True)
    term = Term(lost, {name: Value(v, 1e-4) for name, v in values})
    assert play(term, MACHINE, 0.0, 700.0) == pytest.approx((-3e-3, 4e-3), rel=0.02)
    assert peak_to_valley(term, MACHINE, 0.0, 700.0) is None


def test_what_goes_with_a_load_has_no_one_curve() -> None:
    bends = LoadBending(axis="X", signal="load", direction="Z")
    names = ("c0", "c1", "c2")
    term = Term(bends, {name: Value(1e-6, 1e-7) for name in names})
    assert peak_to_valley(term, MACHINE, 0.0, 700.0) is None
    assert play(term, MACHINE, 0.0, 700.0) is None
