"""Adding an effect to a model and taking one out, as a Python user does."""

import pytest

from abbe.compcore.effects.registry import make_effect
from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import add_effect, remove_effect

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
