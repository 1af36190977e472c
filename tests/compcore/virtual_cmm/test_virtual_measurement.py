"""The virtual CMM against closed forms, the law of propagation, drawn models and true machines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign, Kind, Setup
from abbe.compcore.effects import Positioning, Scale, ScaleExpansion, Squareness
from abbe.compcore.effects.registry import make_effect
from abbe.compcore.errors import InputError
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.virtual_cmm import causes
from abbe.compcore.virtual_cmm.drawn_inputs import draw
from abbe.compcore.virtual_cmm.features import PartCharacteristic
from abbe.compcore.virtual_cmm.linear_propagation import propagated
from abbe.compcore.virtual_cmm.machine_displacements import UnsureMachine
from abbe.compcore.virtual_cmm.part_program import (
    PartProgram,
    PartWarmth,
    ProbeUncertainty,
    SignalState,
)
from abbe.compcore.virtual_cmm.simulation import VirtualMeasurement
from abbe.compcore.virtual_cmm.task_uncertainty import TaskUncertainty, distribution, gathered
from tests.support.compcore.unsure_machines import MACHINE, hole, length, point, unsure

SCALE = Scale(axis="X")
(SCALE_NAME,) = [p.name for p in SCALE.linear(MACHINE)]
SQUARE = Squareness(axes=("Y", "X"))
(SQUARE_NAME,) = [p.name for p in SQUARE.linear(MACHINE)]
ACROSS = length(point("a", (100, 300, 0), (-1, 0, 0)), point("b", (500, 300, 0), (1, 0, 0)))
BLOCKS = 12
WITHIN = 5.0 / np.sqrt(2.0 * BLOCKS * 250)
"""Five standard deviations of a standard deviation of so many draws, as a part of it."""


def nothing() -> tuple[Scale, dict[str, tuple[float, float]]]:
    (name,) = [p.name for p in Scale(axis="Z").linear(MACHINE)]
    return Scale(axis="Z"), {name: (0.0, 1e-12)}


def measured(
    model: Model, program: PartProgram, blocks: int = BLOCKS
) -> tuple[TaskUncertainty, ...]:
    virtual = VirtualMeasurement(model, program)
    return gathered(virtual, [virtual.block(i) for i in range(blocks)])


def holds(model: Model, program: PartProgram, expected: float) -> TaskUncertainty:
    """The Monte-Carlo and the law of propagation both give a standard uncertainty."""
    (found,) = measured(model, program)
    assert found.corrected.sd == pytest.approx(expected, rel=WITHIN)
    assert propagated(VirtualMeasurement(model, program)).sd[0] == pytest.approx(expected, rel=1e-4)
    assert found.corrected.expanded == pytest.approx(1.96 * expected, rel=2.5 * WITHIN)
    return found


def test_a_length_along_an_axis_whose_scale_is_unsure() -> None:
    model = unsure((SCALE, {SCALE_NAME: (50e-6, 4e-6)}))
    found = holds(model, ACROSS, 400.0 * 4e-6)
    assert abs(found.corrected.bias) < 5.0 * 400.0 * 4e-6 / np.sqrt(BLOCKS * 250)
    # 50 ppm too far: it reads too short
    assert found.uncorrected.bias == pytest.approx(-400.0 * 50e-6, rel=0.02)
    (row,) = found.budget
    assert row.cause == SCALE.spec
    assert row.share == pytest.approx(1.0, abs=1e-6)


def test_a_diagonal_and_squareness() -> None:
    program = length(point("a", (100, 100, 0), (-1, -1, 0)), point("b", (500, 400, 0), (1, 1, 0)))
    # along (0.8, 0.6): a shear φ changes the length by φ·L·sin·cos
    holds(unsure((SQUARE, {SQUARE_NAME: (20e-6, 5e-6)})), program, 5e-6 * 500.0 * 0.8 * 0.6)


def test_a_circle_touched_evenly() -> None:
    circle = hole("c", (300, 400, -50), 30.0, 8)
    program = PartProgram(
        "circle",
        (circle,),
        (PartCharacteristic("d", "diameter", ("c",)), PartCharacteristic("x", "x", ("c",))),
        probe=ProbeUncertainty(repeatability=1e-3, tip=2e-3),
    )
    diameter, x = measured(unsure(nothing()), program)
    assert diameter.corrected.sd == pytest.approx(
        2.0 * np.hypot(1e-3 / np.sqrt(8), 2e-3), rel=WITHIN
    )
    assert x.corrected.sd == pytest.approx(1e-3 * np.sqrt(2.0 / 8), rel=WITHIN)
    shares = {row.cause: row.share for row in diameter.budget}
    assert shares[causes.TIP] == pytest.approx(8.0 / 8.25, abs=0.1)


def test_three_lobes_do_nothing_to_a_diameter_and_much_to_roundness() -> None:
    def found(count: int) -> dict[str, TaskUncertainty]:
        names = ("diameter", "roundness")
        program = PartProgram(
            "circle",
            (hole("c", (300, 400, -50), 30.0, count),),
            tuple(PartCharacteristic(n, n, ("c",)) for n in names),
            probe=ProbeUncertainty(lobing=1e-3),
        )
        return dict(zip(names, measured(unsure(nothing()), program, 4), strict=True))

    even = found(12)
    assert even["diameter"].corrected.sd < 1e-9
    assert 1.7e-3 < even["roundness"].corrected.bias <= 2.0e-3  # peak to valley of a cosine
    # three touches see three lobes as a diameter
    assert found(3)["diameter"].corrected.sd == pytest.approx(2e-3 / np.sqrt(2.0), rel=0.1)


def test_the_part_s_own_warmth() -> None:
    warmth = PartWarmth(22.0, 0.3, 11.5e-6, 1e-6)
    program = replace(ACROSS, warmth=warmth)
    holds(unsure(nothing()), program, 400.0 * np.hypot(11.5e-6 * 0.3, 1e-6 * 2.0))
    # a length that is not reduced to 20 °C is too long by what is known, too
    (raw,) = measured(unsure(nothing()), replace(program, warmth=replace(warmth, reduced=False)), 2)
    assert raw.corrected.bias == pytest.approx(400.0 * 11.5e-6 * 2.0, rel=0.03)


EXPANDING = ScaleExpansion(axis="X", signals=("T",))
EXPANSION_NAMES = [p.name for p in EXPANDING.linear(MACHINE)]


def expanding(sd: float = 0.0) -> Model:
    values = {name: (10e-6 if i == 0 else 0.0, sd) for i, name in enumerate(EXPANSION_NAMES)}
    return unsure((EXPANDING, values), nothing())


def test_a_thermometer_that_is_unsure() -> None:
    program = replace(ACROSS, signals={"T": SignalState(23.0, sd=0.1)})
    found = holds(expanding(), program, 400.0 * 10e-6 * 0.1)
    assert found.budget[0].cause == causes.SENSORS
    # the machine as it is does not read thermometers
    assert found.uncorrected.sd < 1e-9


def test_a_temperature_that_varies_is_taken_out_by_the_correction_only() -> None:
    program = replace(ACROSS, signals={"T": SignalState(20.0, varies=2.0)})
    (found,) = measured(expanding(), program)
    assert found.corrected.sd < 1e-9
    assert found.uncorrected.sd == pytest.approx(400.0 * 10e-6 * 2.0 / np.sqrt(3.0), rel=WITHIN)


def test_every_draw_is_the_drawn_model_s_own_prediction() -> None:
    """Whatever the effects are: linear, with a period, of the thermometer, by direction."""
    rng = np.random.default_rng(1)
    kinds = [
        Positioning(axis="X", shape="polynomial:3"),
        Squareness(axes=("Y", "X")),
        EXPANDING,
        make_effect("angular", {"axis": "Y", "about": "Z", "shape": "polynomial:2"}),
        make_effect("cyclic", {"axis": "X"}),
        make_effect("backlash", {"axis": "X"}),
        make_effect("sensor_offset", {"signal": "T"}),
    ]
    known = []
    for effect in kinds:
        linear = {p.name: (1e-2 * abs(p.plausible[1]) * rng.uniform(), 2e-3 * abs(p.plausible[1]))
                  for p in effect.linear(MACHINE)}  # fmt: skip
        bent = {p.name: (p.starts[0], 0.01 * p.starts[0]) for p in effect.nonlinear(MACHINE)}
        known.append((effect, {**linear, **bent}))
    model = unsure(*known)
    circle = hole("c", (300, 400, -50), 30.0, 6)
    program = PartProgram(
        "c", (circle,), (PartCharacteristic("d", "diameter", ("c",)),),
        signals={"T": SignalState(24.0, 0.2, 1.0)},
    )  # fmt: skip
    machine = UnsureMachine(model, program)
    drawn = draw(program, machine.parameters, 3, range(4))
    found = machine.errors(drawn, 4)
    offsets = drawn.parameters * np.sqrt(np.diag(model.covariance))
    for d in range(4):
        terms, at = [], 0
        for term in model.terms:
            own = {
                k: Value(v.value + offsets[d, at + j])
                for j, (k, v) in enumerate(term.values.items())
            }
            at += len(own)
            terms.append(replace(term, values=own))
        normal = circle.normals[:, 0]
        way = np.where(np.abs(normal) > 0.05, -np.sign(normal), np.sign(drawn.sides[d, :, 0]))
        directions = {"X": way}
        true_t = 24.0 + drawn.varied[d, 0]
        middle = machine.middle
        at_true = Conditions.at(middle.positions, tool=middle.tool, directions=directions,
                                signals={"T": true_t})  # fmt: skip
        expected = replace(model, terms=tuple(terms)).predict(at_true).translation
        np.testing.assert_allclose(found.true[d], expected, rtol=1e-9, atol=1e-12)
        at_read = replace(at_true, signals={"T": np.full(6, true_t + 0.2 * drawn.sensors[d, 0])})
        np.testing.assert_allclose(found.applied[d], model.predict(at_read).translation, atol=1e-15)
    total = sum(found.parts.values())
    np.testing.assert_allclose(total, found.true - found.applied, atol=1e-12)


def test_a_draw_is_the_same_in_whatever_company() -> None:
    together = draw(ACROSS, 7, 5, range(20))
    for numbers in (range(3, 4), range(3, 12)):
        alone = draw(ACROSS, 7, 5, numbers)
        assert np.array_equal(alone.parameters[0], together.parameters[3])
        assert np.array_equal(alone.sides[0], together.sides[3])
    assert not np.array_equal(together.parameters[0], together.parameters[1])


def test_intervals_hold_the_truth() -> None:
    """Truths are drawn, measured and fitted: 95 % intervals of a length hold 95 % of them."""
    rng = np.random.default_rng(8)
    effect = Positioning(axis="X", shape="polynomial:2")
    names = [p.name for p in effect.linear(MACHINE)]
    inside = 0
    for _ in range(60):
        truth = Model(
            MACHINE, (Term(effect, {n: Value(float(rng.normal(0, 2e-2))) for n in names}),)
        )
        fitted = fit(Model(MACHINE, (Term(effect),)), _laser(truth, rng)).model
        virtual = VirtualMeasurement(fitted, ACROSS)
        found = distribution(virtual.block(0).corrected[:, 0])
        at = virtual.machine.middle
        left = fitted.predict(at).translation - truth.predict(at).translation
        error = float(left[1, 0] - left[0, 0])  # measured − true of the corrected machine
        inside += found.low <= error <= found.high
    assert inside >= 51  # of a binomial of 60 with 95 %, fewer once in 2000


def _laser(truth: Model, rng: np.random.Generator) -> Campaign:
    x = np.linspace(0.0, 700.0, 11)
    n = len(x)
    at = Conditions.at({"X": x, "Y": 300.0, "Z": 0.0})
    at = replace(at, setup=np.full(n, "line"), u=np.tile([1.0, 0.0, 0.0], (n, 1)))
    value = truth.predict(at).translation[:, 0] + rng.normal(0.0, 1e-3, n) + 5e-3
    none = np.full(n, "", dtype="<U1")
    return Campaign(
        "line", at, np.full(n, Kind.DISPLACEMENT, dtype=np.int8), value, np.full(n, 1e-3), none,
        none, np.arange(n), {"line": Setup("line", ("zero",))},
    )  # fmt: skip


def test_what_was_not_measured_is_named_apart() -> None:
    model = unsure((SCALE, {SCALE_NAME: (0.0, 4e-6)}))
    blind = replace(model.terms[0], values={SCALE_NAME: Value(0.0, 4e-6, measured=False)})
    (found,) = measured(replace(model, terms=(blind,)), ACROSS, 1)
    assert found.budget[0].cause == SCALE.spec + causes.NOT_MEASURED


def test_outside_of_what_was_measured_the_extrapolation_counts() -> None:
    model = unsure((SCALE, {SCALE_NAME: (50e-6, 1e-9)}))
    ranges = {"positions": {"X": [0.0, 300.0]}, "signals": {}, "tool": []}
    (found,) = measured(replace(model, fit={"measured": ranges}), ACROSS)
    # b is 200 mm outside, where the model goes on by 50 ppm: a rectangle of that half width
    assert found.corrected.sd == pytest.approx(200.0 * 50e-6 / np.sqrt(3.0), rel=WITHIN)
    assert found.budget[0].cause == causes.OUTSIDE


@pytest.mark.parametrize(
    ("model", "program", "words"),
    [
        (Model(MACHINE, (Term(SCALE, {SCALE_NAME: Value(1e-5)}),)), ACROSS, "without a covariance"),
        (Model(MACHINE, (Term(SCALE),)), ACROSS, "not fitted"),
        (expanding(), ACROSS, "the model needs T"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_words(
    model: Model, program: PartProgram, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        VirtualMeasurement(model, program)
