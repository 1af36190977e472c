"""Nothing warms by a length or a pressure, and nothing sags that does not reach out."""

from __future__ import annotations

import pytest

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects import effect_class
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.machine import Machine


def machine(structure: str, unit: str = "degC", role: str = "other") -> Machine:
    text = f'format = "abbe-model/1"\n[machine]\nstructure = "{structure}"\n'
    text += "".join(f"[machine.axes.{a}]\ntravel = [0.0, 900.0]\n" for a in "XYZ")
    text += f'[machine.signals.s]\nunit = "{unit}"\nrole = "{role}"\n'
    return parse_model(TomlSource(text)).machine


def proposed(kind: str, m: Machine) -> set[str]:
    xyz = frozenset("XYZ")
    seen = Coverage(xyz, xyz, {"s": (0.0, 5.0)}, duration=2e4, tool_varies=True)
    return {e.spec for e in effect_class(kind).candidates(m, seen)}


@pytest.mark.parametrize(
    ("unit", "role", "warms"),
    [
        ("degC", "other", True),
        ("rpm", "speed", True),
        ("A", "load", True),
        ("%", "coolant", True),
        ("mm", "other", False),
        ("bar", "other", False),
        ("kg", "load", False),
    ],
)
def test_a_body_warms_by_a_temperature_a_speed_a_current_or_a_valve(unit, role, warms) -> None:
    m = machine("w b X Y Z t", unit, role)
    assert bool(proposed("thermal_offset", m)) == warms
    assert bool(proposed("thermal_tilt", m)) == warms


def test_an_arm_along_y_sags_downwards_and_its_column_rolls_on_its_rails() -> None:
    """Z is upright where the ram reaches along Y: sideways, and by the column's place, nothing."""
    assert proposed("overhang_sag", machine("w b X Z Y t")) == {
        "overhang_sag axis=Y direction=Z by=Y",
        "overhang_sag axis=X direction=Z by=Y",
        "overhang_sag axis=Z direction=Z by=Y",
    }


def test_a_gantry_that_rolls_along_its_rails_reaches_no_further_out() -> None:
    m = machine("w b X Y Z t")
    assert "overhang_sag axis=Z direction=Y by=Z" in proposed("overhang_sag", m)
    assert not any(spec.endswith("by=X") for spec in proposed("overhang_sag", m))
