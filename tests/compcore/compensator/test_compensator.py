"""The compensator's behaviour: what it answers, when it folds, what it never does."""

from __future__ import annotations

import sys
import threading
from types import FrameType

import numpy as np
import pytest

from abbe.compcore.compensator.compensator import Compensator
from abbe.compcore.effects import make_effect
from abbe.compcore.effects.catalogue.temperature.lengths import ScaleExpansion
from abbe.compcore.errors import InputError, NotContractionError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from tests.support.compcore.random_models import random_signals

TRAVELS = {"X": (0.0, 700.0), "Y": (0.0, 900.0), "Z": (-360.0, 0.0), "C": (-3.0, 3.0)}
WARM = {"T_x": 22.5, "T_y": 19.0, "T_z": 24.0}


def machine(code: str = "w b Y X Z t") -> Machine:
    structure = Structure.parse(code)
    axes = {a: Axis(a, TRAVELS[a]) for a in structure.axes}
    signals = {name: Signal(name, "degC", "scale", name[-1].upper()) for name in WARM}
    return Machine("test", structure, axes, signals)


def term(of: Machine, kind: str, value: float, **keys: object) -> Term:
    effect = make_effect(kind, keys)
    rng = np.random.default_rng(len(keys))
    return Term(effect, {p.name: Value(value * rng.uniform(0.5, 1.0)) for p in effect.linear(of)})


def model(*terms: Term, of: Machine | None = None) -> Model:
    return Model(of or machine(), terms)


def full_model(shape: str = "spline:8") -> Model:
    """21 error motions and three thermal effects, one of them lagged."""
    of = machine()
    keys: dict[str, object] = {"shape": shape}
    terms = []
    for axis in of.structure.axes:
        if shape == "table":
            keys["positions"] = tuple(np.linspace(*TRAVELS[axis], 41))
        terms.append(term(of, "positioning", 0.01, axis=axis, **keys))
        for other in "XYZ":
            terms.append(term(of, "angular", 3e-5, axis=axis, about=other, **keys))
            if other != axis:
                terms.append(term(of, "straightness", 0.005, axis=axis, direction=other, **keys))
    pairs = (("Y", "X"), ("Y", "Z"), ("X", "Z"))
    terms += [term(of, "squareness", 5e-5, axes=pair) for pair in pairs]
    for axis, tau in (("X", 900.0), ("Y", None), ("Z", None)):
        signal = (f"T_{axis.lower()}",)
        terms.append(term(of, "scale_expansion", 1.2e-5, axis=axis, signals=signal, tau=tau))
    return Model(of, tuple(terms))


def points(of: Model, count: int, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    axes = of.machine.structure.axes
    return np.stack([rng.uniform(*of.machine.axis(a).travel, count) for a in axes], axis=1)


def truth(of: Model, at: np.ndarray, signals: dict[str, float], **lags: float) -> np.ndarray:
    """The effects themselves; lagged values by signal name."""
    n = len(at)

    class Lagged(Conditions):
        def lag(self, name: str, tau: float) -> np.ndarray:
            return np.full(n, lags[name])

    conditions = Lagged(
        positions={a: at[:, i] for i, a in enumerate(of.machine.structure.axes)},
        signals={name: np.full(n, value) for name, value in signals.items()},
    )
    error = of.axis_error(conditions)
    return np.stack([error[a] for a in "XYZ"], axis=1)


def worst_nm(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(found - expected, axis=1).max() * 1e6)


def test_a_step_is_the_effects_error_as_moves_of_x_y_z() -> None:
    of = model(term(machine(), "scale", 1e-4, axis="X"), term(machine(), "scale", 5e-5, axis="Z"))
    compensator = Compensator(of)
    assert compensator.axes == ("Y", "X", "Z")
    k = [t.values["k"].value for t in of.terms]
    assert compensator.step((100.0, 300.0, -200.0)) == pytest.approx((300 * k[0], 0, -200 * k[1]))


def test_the_step_of_a_full_model_is_within_ten_nanometres_and_equals_the_batch() -> None:
    of = full_model()
    compensator = Compensator(of)
    compensator.update(0.0, WARM)
    at = points(of, 40_000)
    batch = compensator.errors(at)
    assert worst_nm(batch, truth(of, at, WARM, T_x=WARM["T_x"])) <= 10.0
    steps = np.array([compensator.step(row) for row in at[:500].tolist()])
    assert np.abs(steps - batch[:500]).max() < 1e-12


def test_tables_are_folded_without_any_loss() -> None:
    of = full_model("table")
    compensator = Compensator(of)
    compensator.update(0.0, WARM)
    at = points(of, 5000)
    assert worst_nm(compensator.errors(at), truth(of, at, WARM, T_x=WARM["T_x"])) < 1e-6
    assert {axis: len(nodes) for axis, nodes in compensator.nodes.items()} == dict.fromkeys(
        "XYZ", 41
    )


def test_a_looser_tolerance_costs_more_and_needs_fewer_nodes() -> None:
    of = full_model()
    at = points(of, 20_000)
    expected = truth(of, at, WARM, T_x=WARM["T_x"])
    off, nodes = [], []
    for tolerance in (1e-6, 1e-5, 1e-3):
        compensator = Compensator(of, tolerance_mm=tolerance)
        compensator.update(0.0, WARM)
        off.append(worst_nm(compensator.errors(at), expected) * 1e-6)
        nodes.append(sum(map(len, compensator.nodes.values())))
        assert off[-1] <= tolerance
    assert nodes[0] > 2 * nodes[1] > 8 * nodes[2]
    assert off[2] > 1e-5  # what the tighter tolerance forbids is seen with the looser one


def test_lags_follow_the_recorded_signal() -> None:
    of = full_model()
    compensator = Compensator(of)
    for time, warmth in ((0.0, 20.0), (600.0, 26.0), (1500.0, 26.0)):
        compensator.update(time, {**WARM, "T_x": warmth})
    # τ = 900 s: a ramp of 6 K in 600 s, then 900 s at rest, in closed form
    at_ramp_end = 20.0 + 0.01 * (600.0 - 900.0 * (1.0 - np.exp(-600.0 / 900.0)))
    lagged = 26.0 + (at_ramp_end - 26.0) * np.exp(-1.0)
    at = points(of, 300)
    expected = truth(of, at, {**WARM, "T_x": 26.0}, T_x=lagged)
    assert worst_nm(compensator.errors(at), expected) <= 10.0
    unlagged = truth(of, at, {**WARM, "T_x": 26.0}, T_x=26.0)
    assert worst_nm(compensator.errors(at), unlagged) > 100.0


def test_a_model_that_reads_signals_waits_for_them() -> None:
    compensator = Compensator(full_model())
    assert compensator.signals == ("T_x", "T_y", "T_z")
    with pytest.raises(InputError, match="first update with T_x, T_y, T_z"):
        compensator.step((0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="first update"):
        compensator.errors(np.zeros((20, 3)))


def test_a_model_that_reads_the_clock_waits_for_it() -> None:
    of = model(term(machine(), "drift", 1e-6, direction="X"))
    compensator = Compensator(of)
    with pytest.raises(InputError, match="the time"):
        compensator.step((0.0, 0.0, 0.0))
    rate = of.terms[0].values["rate"].value
    for time in (100.0, 200.0):
        assert compensator.update(time, {})
        assert compensator.step((0.0, 0.0, 0.0)) == pytest.approx((rate * time, 0.0, 0.0))


def test_update_says_whether_anything_changed() -> None:
    of = model(term(machine(), "scale_expansion", 1e-5, axis="X", signals=("T_x",)))
    compensator = Compensator(of)
    assert compensator.update(0.0, {"T_x": 21.0})
    assert not compensator.update(1.0, {"T_x": 21.0})  # the clock alone moves nothing here
    assert compensator.update(2.0, {"T_x": 21.1})
    lagging = Compensator(full_model())
    assert lagging.update(0.0, WARM)
    assert not lagging.update(1.0, WARM)
    assert lagging.update(2.0, {**WARM, "T_x": 23.0})
    assert lagging.update(3.0, {**WARM, "T_x": 23.0})  # the lag still moves


@pytest.mark.parametrize(
    ("signals", "problem"),
    [
        ({"T_x": 21.0, "T_y": 21.0}, "signal is missing"),
        ({**WARM, "T_z": float("nan")}, "not a finite number"),
        ({**WARM, "T_x": float("inf")}, "not a finite number"),
    ],
)
def test_a_bad_update_changes_nothing(signals: dict[str, float], problem: str) -> None:
    compensator = Compensator(full_model())
    compensator.update(0.0, WARM)
    compensator.update(500.0, {**WARM, "T_x": 25.0})
    before = compensator.step((100.0, 600.0, -50.0))
    with pytest.raises(InputError, match=problem):
        compensator.update(1000.0, signals)
    assert compensator.step((100.0, 600.0, -50.0)) == before
    other = Compensator(full_model())
    for time, value in ((0.0, WARM), (500.0, {**WARM, "T_x": 25.0}), (1500.0, WARM)):
        other.update(time, value)
    compensator.update(1500.0, WARM)
    assert compensator.step((1.0, 2.0, -3.0)) == other.step((1.0, 2.0, -3.0))


def test_a_lag_may_begin_anew() -> None:
    compensator, fresh = Compensator(full_model()), Compensator(full_model())
    compensator.update(0.0, WARM)
    compensator.restart_lags("T_x")
    for each in (compensator, fresh):
        each.update(1.0, {**WARM, "T_x": 35.0})
    assert compensator.step((1.0, 600.0, -3.0)) == fresh.step((1.0, 600.0, -3.0))


def test_readings_are_amended() -> None:
    of = machine()
    expansion = term(of, "scale_expansion", 1e-5, axis="X", signals=("T_x",), tau=300.0)
    offset = term(of, "sensor_offset", 0.8, signal="T_x")
    compensator = Compensator(model(expansion, offset, of=of))
    compensator.update(0.0, WARM)
    alpha, high = expansion.values["alpha"].value, offset.values["offset"].value
    true = WARM["T_x"] - high
    assert compensator.step((0.0, 500.0, 0.0))[0] == pytest.approx(alpha * 500 * (true - 20.0))
    many = points(compensator.model, 100)
    expected = compensator.model.axis_error(
        Conditions(
            {a: many[:, i] for i, a in enumerate(compensator.axes)},
            signals={"T_x": np.full(100, WARM["T_x"])},
        )
    )["X"]
    assert compensator.errors(many)[:, 0] == pytest.approx(expected, abs=1e-9)


def test_a_gain_is_taken_off_readings_and_off_their_lags() -> None:
    of = machine()
    expansion = term(of, "scale_expansion", 1e-5, axis="X", signals=("T_x",), tau=300.0)
    gain = term(of, "sensor_gain", 0.25, signal="T_x")
    compensator = Compensator(model(expansion, gain, of=of))
    compensator.update(0.0, WARM)
    compensator.update(200.0, {**WARM, "T_x": WARM["T_x"] + 5.0})
    alpha, part = expansion.values["alpha"].value, gain.values["gain"].value
    lagged = WARM["T_x"] + 5.0 * lag_of_a_ramp(200.0, 300.0)
    true = (lagged - 20.0) / (1.0 + part)
    assert compensator.step((0.0, 500.0, 0.0))[0] == pytest.approx(alpha * 500 * true)


def lag_of_a_ramp(duration: float, tau: float) -> float:
    """A first-order lag behind a ramp from 0 to 1, at its end."""
    return float(1.0 - tau / duration * -np.expm1(-duration / tau))


def test_only_update_evaluates_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    compensator = Compensator(full_model())
    calls = []
    evaluate = ScaleExpansion.motions

    def counted(self: ScaleExpansion, *args: object) -> object:
        calls.append(self.axis)
        return evaluate(self, *args)  # type: ignore[arg-type]

    monkeypatch.setattr(ScaleExpansion, "motions", counted)
    compensator.update(0.0, WARM)
    assert sorted(calls) == ["X", "Y", "Z"]
    calls.clear()
    for row in points(compensator.model, 50).tolist():
        compensator.step(row)
    compensator.errors(points(compensator.model, 50))
    assert not calls
    compensator.update(1.0, {**WARM, "T_z": 24.1})
    assert calls == ["Z"]  # of what changed only


@pytest.mark.parametrize("composition", ["first-order", "exact"])
def test_a_step_makes_no_arrays(composition: str) -> None:
    of = full_model()
    compensator = Compensator(Model(of.machine, of.terms, composition))  # type: ignore[arg-type]
    compensator.update(0.0, WARM)
    at = points(of, 200).tolist()
    seen: set[str] = set()

    def watch(frame: FrameType, event: str, what: object) -> None:
        if event == "c_call":
            seen.add(f"{getattr(what, '__module__', None)} {type(getattr(what, '__self__', None))}")
        elif event == "call":
            seen.add(frame.f_code.co_filename)

    sys.setprofile(watch)
    try:
        results = [compensator.step(row) for row in at]
    finally:
        sys.setprofile(None)
    assert seen
    assert not [name for name in seen if "numpy" in name or "ndarray" in name]
    assert {type(value) for result in results for value in result} == {float}


def test_new_tables_come_into_force_at_once() -> None:
    compensator = Compensator(full_model())
    cold = {name: value - 5.0 for name, value in WARM.items()}
    at = (317.0, 421.0, -123.0)
    allowed = set()
    for signals in (WARM, cold):
        fresh = Compensator(compensator.model)
        fresh.update(0.0, {**signals, "T_x": WARM["T_x"]})
        allowed.add(fresh.step(at))
    assert len(allowed) == 2
    compensator.update(0.0, WARM)
    stop = threading.Event()
    seen: set[tuple[float, float, float]] = set()

    def live() -> None:
        while not stop.is_set():
            seen.add(compensator.step(at))

    thread = threading.Thread(target=live)
    thread.start()
    for i in range(60):
        compensator.update(float(i), {**(WARM if i % 2 else cold), "T_x": WARM["T_x"]})
    stop.set()
    thread.join()
    assert seen == allowed


def test_the_tool_reaches_further() -> None:
    of = model(term(machine(), "angular", 1e-4, axis="Y", about="Z", shape="constant"))
    angle = of.terms[0].values["value"].value
    compensator = Compensator(of, tool=(0.0, 0.0, -100.0))
    assert compensator.step((0.0, 0.0, 0.0)) == pytest.approx((0.0, 0.0, 0.0))
    compensator.set_tool(0.0, 50.0, -100.0)
    assert compensator.step((0.0, 0.0, 0.0)) == pytest.approx((-50.0 * angle, 0.0, 0.0))
    compensator.set_tool(0.0, 3000.0, 0.0)  # beyond what the tables were laid out for
    assert compensator.step((0.0, 0.0, 0.0)) == pytest.approx((-3000.0 * angle, 0.0, 0.0))


def test_a_long_tool_stays_within_the_tolerance() -> None:
    of = full_model()
    compensator = Compensator(of)
    compensator.update(0.0, WARM)
    before = len(compensator.nodes["Z"])
    compensator.set_tool(1500.0, -2000.0, 0.0)
    assert len(compensator.nodes["Z"]) > before
    at = points(of, 2000)
    conditions = Conditions(
        positions={a: at[:, i] for i, a in enumerate(compensator.axes)},
        tool=np.tile([1500.0, -2000.0, 0.0], (len(at), 1)),
        signals={name: np.full(len(at), value) for name, value in WARM.items()},
    )
    error = of.axis_error(conditions)
    expected = np.stack([error[a] for a in "XYZ"], axis=1)
    assert worst_nm(compensator.errors(at), expected) <= 10.0


def test_the_spindle_turns_the_tool() -> None:
    of = machine("w b Y X Z (C) t")
    compensator = Compensator(
        model(term(of, "angular", 1e-4, axis="Y", about="Z", shape="constant"), of=of)
    )
    angle = compensator.model.terms[0].values["value"].value
    compensator.set_tool(50.0, 0.0, 0.0, spindle_angle=np.pi / 2)
    assert compensator.step((0.0, 0.0, 0.0)) == pytest.approx((-50.0 * angle, 0.0, 0.0))


def test_signals_far_from_anything_expected_are_done_justice() -> None:
    of = machine()
    tilt = term(of, "formula", 1e-9, channel="E_BX", terms=("sin(X/40)*(T_y-T0)**2",))
    compensator = Compensator(model(tilt, of=of))
    at = points(compensator.model, 3000)
    for warmth in (25.0, 400.0, 21.0):
        compensator.update(0.0, {"T_y": warmth})
        expected = truth(compensator.model, at, {"T_y": warmth})
        assert worst_nm(compensator.errors(at), expected) <= 10.0


def test_what_fits_no_table_is_evaluated_at_the_point_and_named() -> None:
    of = machine()
    odd = term(of, "formula", 1e-5, channel="dX", terms=("max(X-350,Y-450)",))
    smooth = term(of, "positioning", 0.01, axis="X", shape="spline:6")
    compensator = Compensator(model(odd, smooth, of=of))
    assert compensator.direct_effects == (odd.effect.spec,)
    at = points(compensator.model, 500)
    expected = truth(compensator.model, at, {})
    assert worst_nm(compensator.errors(at), expected) <= 10.0
    assert worst_nm(np.array([compensator.step(p) for p in at[:30].tolist()]), expected[:30]) <= 10


def test_directions_choose_the_side_of_a_reversal() -> None:
    of = machine()
    compensator = Compensator(model(term(of, "backlash", 0.02, axis="X"), of=of))
    b = compensator.model.terms[0].values["b"].value
    at = (10.0, 20.0, -30.0)
    for direction, expected in ((1, 0.5 * b), (-1.0, -0.5 * b), (0, 0.0), (0.3, 0.5 * b)):
        assert compensator.step(at, (0, direction, 0)) == pytest.approx((expected, 0.0, 0.0))
        many = compensator.errors(np.tile(at, (50, 1)), np.tile([0, direction, 0], (50, 1)))
        assert many[:, 0] == pytest.approx(expected)
    assert compensator.step(at) == (0.0, 0.0, 0.0)


def test_a_position_that_is_not_a_number_gives_none() -> None:
    compensator = Compensator(full_model())
    compensator.update(0.0, WARM)
    assert np.isnan(compensator.step((float("nan"), 1.0, -1.0))).any()
    many = points(compensator.model, 50)
    many[7, 1] = np.nan
    found = np.isnan(compensator.errors(many)).any(axis=1)
    assert found[7]
    assert found.sum() == 1


@pytest.mark.parametrize("shape", [(3,), (4, 2), (2, 3, 1)])
def test_positions_of_the_wrong_shape_are_refused(shape: tuple[int, ...]) -> None:
    compensator = Compensator(model(term(machine(), "scale", 1e-5, axis="X")))
    with pytest.raises(InputError, match=r"\(n, 3\) for Y, X, Z"):
        compensator.errors(np.zeros(shape))
    with pytest.raises(InputError, match="directions"):
        compensator.errors(np.zeros((20, 3)), np.zeros((20, 2)))


def test_no_points_give_no_errors() -> None:
    compensator = Compensator(model(term(machine(), "scale", 1e-5, axis="X")))
    assert compensator.errors(np.zeros((0, 3))).shape == (0, 3)


def test_a_model_without_values_corrects_nothing() -> None:
    effect = make_effect("positioning", {"axis": "X"})
    compensator = Compensator(Model(machine(), (Term(effect),)))
    assert compensator.step((1.0, 2.0, -3.0)) == (0.0, 0.0, 0.0)
    assert not compensator.errors(np.ones((40, 3))).any()


def test_effects_of_the_instrument_stay_out() -> None:
    of = machine()
    seen = term(of, "scale", 1e-4, axis="X")
    air = term(of, "instrument_drift", 1e-3, setup="s1")
    both, alone = Compensator(model(seen, air, of=of)), Compensator(model(seen, of=of))
    assert both.step((1.0, 500.0, -3.0)) == alone.step((1.0, 500.0, -3.0))
    assert both.step((1.0, 500.0, -3.0))[0] != 0.0


def test_a_tolerance_must_be_above_zero() -> None:
    with pytest.raises(InputError, match="above zero"):
        Compensator(model(), tolerance_mm=0.0)


@pytest.mark.parametrize("code", ["w b Y X Z t", "w C' Y' b X Z t"])
def test_a_command_reaches_its_target(code: str) -> None:
    of = machine(code)
    terms = [term(of, "positioning", 0.05, axis=a, shape="spline:9") for a in "XYZ"]
    terms.append(term(of, "angular", 2e-4, axis="X", about="Z", shape="polynomial:3"))
    terms.append(term(of, "backlash", 0.02, axis="Z"))
    compensator = Compensator(Model(of, tuple(terms)))
    target = points(compensator.model, 200)
    arriving = np.sign(np.random.default_rng(2).normal(size=target.shape))
    found = compensator.command(target, arriving)
    carrying = [compensator.axes.index(a) for a in "XYZ"]
    reached = found.positions[:, carrying] + compensator.errors(found.positions, arriving)
    assert np.abs(reached - target[:, carrying]).max() < 1e-9
    rest = [i for i in range(len(compensator.axes)) if i not in carrying]
    assert (found.positions[:, rest] == target[:, rest]).all()
    assert found.contraction.max() < 1e-2
    assert found.iterations <= 5


def test_a_correction_that_cannot_be_undone_is_said() -> None:
    of = machine()
    compensator = Compensator(model(term(of, "scale", -2.5, axis="X"), of=of))
    with pytest.raises(NotContractionError, match="mm per mm"):
        compensator.command(points(compensator.model, 10))


def test_many_updates_agree_with_a_fresh_start() -> None:
    """Nothing is carried over from one fold to the next but the lags."""
    of = full_model()
    compensator = Compensator(of)
    rng = np.random.default_rng(4)
    walk = random_signals(rng, 30)
    for i in range(30):
        signals = {"T_x": 20.0, "T_y": walk["T_y"][i], "T_z": walk["T_z"][i]}
        compensator.update(float(i), signals)
    fresh = Compensator(of)
    fresh.update(0.0, signals)
    at = points(of, 100)
    assert np.abs(fresh.errors(at) - compensator.errors(at)).max() < 1e-15
