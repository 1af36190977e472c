from __future__ import annotations

import math

import pytest

from abbe.compcore.effects.base import NonlinearParameter, Parameter
from abbe.compcore.errors import InputError
from abbe.compcore.units import display, read_in, to_internal
from tools.effect_scenes import SCENES


@pytest.mark.parametrize(
    ("value", "unit", "expected", "number"),
    [
        (5.0, "um", "mm", 5e-3),
        (5.0, "µm", "mm", 5e-3),
        (12.0, "nm", "mm", 1.2e-5),
        (2.0, "m", "mm", 2000.0),
        (0.021, "mm/m", "rad", 21e-6),
        (21.0, "urad", "rad", 21e-6),
        (21.0, "µrad", "rad", 21e-6),
        (180.0, "deg", "rad", math.pi),
        (1.0, "arcsec", "rad", math.pi / 648000.0),
        (16.0, "ppm", "1", 16e-6),
        (16.0, "ppm/K", "1/K", 16e-6),
        (1.5, "h", "s", 5400.0),
        (3.0, "um/K", "mm/K", 3e-3),
        (3.0, "urad/K", "rad/K", 3e-6),
        (3.0, "rad/K", "rad/K", 3.0),
        (3.6, "um/h", "mm/s", 1e-6),
        (6.0, "urad/min", "rad/s", 1e-7),
        (2.0, "mm/s", "mm/s", 2.0),
        (7.0, "any spelling alike", "any spelling alike", 7.0),
    ],
)
def test_known_units(value, unit, expected, number):
    assert to_internal(value, unit, expected) == pytest.approx(number, rel=1e-15)


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("urad", "mm"),
        ("um", "rad"),
        ("inch", "mm"),
        ("um/K", "mm"),
        ("um", "mm/K"),
        ("um/s", "mm/K"),
        ("um/K", "mm/s"),
        ("urad/h", "mm/s"),
    ],
)
def test_a_unit_of_another_kind_is_never_a_factor_of_one(unit, expected):
    with pytest.raises(InputError, match=f"wrong unit: found '{unit}', expected '{expected}'"):
        to_internal(1.0, unit, expected)


@pytest.mark.parametrize(
    ("unit", "shown"),
    [
        ("mm", ("µm", 1e3)),
        ("rad", ("µrad", 1e6)),
        ("rad/K", ("µrad/K", 1e6)),
        ("mm/K", ("µm/K", 1e3)),
        ("mm/s", ("µm/h", 3.6e6)),
        ("rad/s", ("µrad/h", 3.6e9)),
        ("1/K", ("ppm/K", 1e6)),
        ("1", ("ppm", 1e6)),
        ("s", ("s", 1.0)),
    ],
)
def test_what_people_read(unit, shown):
    assert display(unit) == shown


def test_errors_are_read_in_micrometres_and_places_periods_and_paths_in_millimetres():
    error = Parameter("b", "mm", (-0.05, 0.05))
    period = NonlinearParameter("period", "mm", (1.0, 60.0), (10.0,), (1.0, 60.0), extent=True)
    assert read_in(error) == ("µm", 1e3)
    assert read_in(period) == ("mm", 1.0)


@pytest.mark.parametrize(
    ("kind", "name"),
    [("cyclic", "period"), ("local_defect", "centre"), ("local_defect", "width"),
     ("dead_path", "length")],
)  # fmt: skip
def test_parameters_that_are_no_errors_say_so(kind: str, name: str):
    scene = SCENES[kind]
    free = {key: None for key in ("period", "centre", "width") if key == name}
    effect = scene.effect(kind).model_copy(update=free)
    known = {p.name: p for p in (*effect.linear(scene.machine), *effect.nonlinear(scene.machine))}
    assert read_in(known[name]) == ("mm", 1.0)


def test_what_is_measured_only_where_it_stands_is_no_error():
    """Every length that the columns themselves depend on is a place, a width or a period."""
    for kind, scene in SCENES.items():
        for p in scene.effect(kind).nonlinear(scene.machine):
            assert p.extent or p.unit != "mm", f"{kind}: {p.name}"
