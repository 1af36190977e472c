"""Adding an effect to a model and taking one out, as a Python user does."""

from dataclasses import replace

import pytest

from abbe.compcore.effects.registry import make_effect
from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Value
from abbe.compcore.model.revise import add_effect, remove_effect, with_effect

MACHINE = Machine("mill", Structure.parse("w b Y X Z t"), {a: Axis(a, (0.0, 500.0)) for a in "XYZ"})
BACKLASH = make_effect("backlash", {"axis": "Z"})


@pytest.mark.parametrize("by", [BACKLASH, "backlash axis=Z", BACKLASH.spec])
def test_an_effect_and_its_spec_say_the_same(by: object) -> None:
    assert add_effect(Model(MACHINE), by).effects == (BACKLASH,)


def test_kind_and_keys() -> None:
    assert add_effect(Model(MACHINE), "backlash", axis="Z").effects == (BACKLASH,)


@pytest.mark.parametrize("spec", ["backlash Z", "backlash =Z", "backlash axis=Z axis=X", ""])
def test_a_spec_that_is_none(spec: str) -> None:
    with pytest.raises(InputError):
        add_effect(Model(MACHINE), spec)


def test_added_and_removed_is_as_before() -> None:
    before = add_effect(Model(MACHINE), "scale", axis="X")
    after = remove_effect(add_effect(before, BACKLASH), "backlash")
    assert after.effects == before.effects


def test_the_original_is_left_alone() -> None:
    before = Model(MACHINE)
    add_effect(before, BACKLASH)
    assert before.effects == ()


def test_a_wave_of_another_period_is_another_cause():
    """A rack: once in a turn of its pinion, and once at each tooth."""
    axes = {a: Axis(a, (0.0, 2000.0)) for a in "XYZ"}
    model = Model(Machine("rack", Structure.parse("w b Y X Z t"), axes), ())
    model, turn = with_effect(model, "cyclic", {"axis": "X"})
    values = {n: Value(0.0, 1e-3) for n in ("A1", "B1")} | {"period": Value(399.65, 0.16)}
    model = replace(model, terms=(replace(model.terms[0], values=values),))
    both, tooth = with_effect(model, "cyclic", {"axis": "X", "period": 10.0})
    assert both.effects == (turn, tooth)
    # the same wave, better known
    known, once = with_effect(model, "cyclic", {"axis": "X", "period": 400.0})
    assert known.effects == (once,)
