"""Temperatures that stand to each other as never when the model was fitted: said, and how sure."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.effects import make_effect
from abbe.compcore.files.model_file import format_model, parse_model
from abbe.compcore.files.model_toml.fit_record import measured_differences, wider
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.measured_ranges import (
    farthest,
    nearest,
    outside,
    outside_names,
    signals_outside,
)
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.model.uncertainty import uncertainty

MACHINE = Machine(
    "lathe",
    Structure.parse("w b X Z t"),
    {"X": Axis("X", (0.0, 500.0)), "Z": Axis("Z", (0.0, 400.0))},
    signals={
        **{f"T_{n}": Signal(f"T_{n}", "degC", "spindle") for n in ("front", "rear", "bed")},
        "load": Signal("load", "%", "load"),
    },
)
SIGNALS = {"T_front": [20.0, 36.0], "T_rear": [20.0, 36.0], "T_bed": [20.0, 30.0]}
APART = {"T_front": {"T_rear": [-2.0, 4.0]}}
READ = 0.2  # K, of two thermometers that read in tenths


def warm(front: float, rear: float, *, k_front: float, k_rear: float) -> tuple[Model, Conditions]:
    """Two effects of so many mm/K, known exactly, and one row."""
    terms = tuple(
        Term(
            make_effect("thermal_offset", {"direction": "X", "signal": name}), {"k": Value(k, 0.0)}
        )
        for name, k in (("T_front", k_front), ("T_rear", k_rear))
    )
    fit = {"measured": {"signals": SIGNALS, "differences": APART}}
    at = Conditions(
        {"X": np.array([100.0]), "Z": np.array([200.0])},
        tool=np.zeros((1, 3)),
        signals={
            "T_front": np.array([front]), "T_rear": np.array([rear]), "T_bed": np.array([25.0])
        },
    )  # fmt: skip
    return Model(MACHINE, terms, fit=fit, covariance=np.zeros((2, 2))), at


def test_each_where_it_was_and_both_as_never_is_outside() -> None:
    model, at = warm(24.0, 30.0, k_front=-8e-3, k_rear=8e-3)
    (one,) = outside(model, at)
    assert str(one) == "T_front − T_rear = -6 K was not measured (-2 … 4 K)"
    assert one.by == pytest.approx(4.0)
    near = nearest(model, at)
    assert near.by_itself is at
    # brought back to 2 K and what they may read wrongly, half of it each
    assert near.together.signals["T_front"] == pytest.approx([24.0 + 1.9])
    assert near.together.signals["T_rear"] == pytest.approx([30.0 - 1.9])
    assert at.signals["T_front"] == pytest.approx([24.0])
    assert outside_names(model, at) == ["T_front-T_rear"]
    assert signals_outside(model, at)[0].tolist() == [True]


@pytest.mark.parametrize("rear", [20.2, 24.0, 26.1])
def test_as_far_apart_as_they_were_is_inside(rear: float) -> None:
    model, at = warm(24.0, rear, k_front=-8e-3, k_rear=8e-3)
    near = nearest(model, at)
    assert near.together is at
    assert near.beyond == ()
    assert outside_names(model, at) == [""]
    assert signals_outside(model, at)[0].tolist() == [False]
    found = uncertainty(model, at)
    assert found is not None
    assert found.translation == pytest.approx(np.zeros((1, 3)))


@pytest.mark.parametrize(
    ("k_front", "k_rear", "change"),
    [
        # that they pull the same way is what the model says
        (-8e-3, 8e-3, 2 * 8e-3 * 1.9),
        # that they cancel was only seen where they stood to each other as they did
        (8e-3, 8e-3, math.sqrt(2) * 8e-3 * 1.9),
        (8e-3, 0.0, 8e-3 * 1.9),
    ],
)
def test_the_plus_minus_is_wider_by_what_each_effect_changes(
    k_front: float, k_rear: float, change: float
) -> None:
    model, at = warm(24.0, 30.0, k_front=k_front, k_rear=k_rear)
    found = uncertainty(model, at)
    assert found is not None
    assert found.translation[0] == pytest.approx([change / math.sqrt(3.0), 0.0, 0.0])


def test_what_is_outside_by_itself_is_not_said_twice() -> None:
    model, at = warm(24.0, 19.0, k_front=8e-3, k_rear=8e-3)
    # brought to 20 °C the rear one is 4 K colder, as it was
    assert [b.name for b in outside(model, at)] == ["T_rear"]
    far, there = warm(34.0, 19.0, k_front=8e-3, k_rear=8e-3)
    found = outside(far, there)
    assert [b.name for b in found] == ["T_rear", "T_front − T_rear"]
    assert farthest((*outside(model, at), *found))[0].value == 19.0


def test_a_temperature_that_nobody_recorded_spoils_no_other() -> None:
    model, at = warm(24.0, math.nan, k_front=8e-3, k_rear=8e-3)
    assert outside(model, at) == ()
    rows = Conditions(
        {"X": np.full(3, 100.0), "Z": np.full(3, 200.0)},
        tool=np.zeros((3, 3)),
        signals={
            "T_front": np.array([24.0, 24.0, 24.0]),
            "T_rear": np.array([np.nan, 30.0, 25.0]),
            "T_bed": np.full(3, 25.0),
        },
    )
    assert signals_outside(model, rows)[0].tolist() == [False, True, False]
    assert nearest(model, rows).together.signals["T_front"] == pytest.approx([24.0, 25.9, 24.0])


def test_of_temperatures_that_the_model_reads_it_is_recorded_and_kept() -> None:
    model, _ = warm(24.0, 30.0, k_front=8e-3, k_rear=8e-3)
    n = 4
    at = Conditions(
        {"X": np.full(n, 100.0), "Z": np.full(n, 200.0)},
        tool=np.zeros((n, 3)),
        signals={
            "T_front": np.array([20.0, 22.0, np.nan, 25.0]),
            "T_rear": np.array([21.0, 21.0, 20.0, 28.0]),
            "T_bed": np.full(n, 21.0),
            "load": np.full(n, 21.0),
        },
    )
    found = measured_differences(model, at)
    assert found == {"T_front": {"T_rear": [-3.0, 1.0]}}
    fitted = replace(model, fit={"measured": {"signals": SIGNALS, "differences": found}})
    again = parse_model(TomlSource(format_model(fitted)))
    assert again.measured_differences == {("T_front", "T_rear"): (-3.0, 1.0)}


def test_a_renewed_model_knows_what_was_before() -> None:
    now = {
        "signals": {}, "positions": {}, "tool": [[0.0, 0.0]] * 3,
        "differences": {"T_front": {"T_rear": [-1.0, 5.0], "T_bed": [0.0, 1.0]}},
    }  # fmt: skip
    before = {"measured": {"signals": SIGNALS, "differences": APART}}
    # how far front and bed were apart before nobody recorded, though both were
    assert wider(now, before)["differences"] == {"T_front": {"T_rear": [-2.0, 5.0]}}
    first = wider(now, {})["differences"]
    assert first == now["differences"]
    bed_is_new = {"measured": {"signals": {"T_front": [20.0, 36.0]}, "differences": {}}}
    assert wider(now, bed_is_new)["differences"] == now["differences"]
    gone = {**now, "differences": {}}
    assert wider(gone, before)["differences"] == APART
