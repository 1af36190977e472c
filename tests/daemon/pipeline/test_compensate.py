"""Which directions a signal's loss affects; a compensator that fails is a fault, not an end."""

from __future__ import annotations

import logging
import math

import pytest

from abbe.compcore.effects import Angular, ScaleExpansion, Straightness, ThermalTilt, make_effect
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from abbe.daemon.guard import ALL
from abbe.daemon.pipeline.compensate import LiveCompensator, affected_directions
from abbe.daemon.pipeline.reading.convert import SignalReading

X, Y, Z = 1, 2, 4


def machine(code: str = "w b Y X Z t") -> Machine:
    structure = Structure.parse(code)
    return Machine(
        "test",
        structure,
        {a: Axis(a, (0.0, 500.0) if a in "XYZ" else (-1.0, 1.0)) for a in structure.axes},
        {n: Signal(n) for n in ("T1", "T2", "T3")},
    )


def growth(axis: str, signal: str, alpha: float = 1e-5) -> Term:
    return Term(ScaleExpansion(axis=axis, signals=(signal,)), {"alpha": Value(alpha)})


def model(*terms: Term, code: str = "w b Y X Z t") -> Model:
    return Model(machine(code), terms)


def good(**values: float) -> dict[str, SignalReading]:
    return {name: SignalReading(value, "", 0.0) for name, value in values.items()}


def test_expansion_of_a_scale_affects_its_own_direction() -> None:
    assert affected_directions(model(growth("X", "T1"), growth("Z", "T2"))) == {"T1": X, "T2": Z}


def test_a_tilt_affects_the_two_directions_across_it() -> None:
    effect = ThermalTilt(axis="Y", about="X", signals=("T1", "T2"))
    names = [p.name for p in effect.linear(machine())]
    tilt = Term(effect, {n: Value(1e-6) for n in names})
    assert affected_directions(model(tilt)) == {"T1": Y | Z, "T2": Y | Z}


def test_effects_without_values_or_signals_affect_nothing() -> None:
    shaped = Straightness(axis="X", direction="Y", shape="constant")
    assert affected_directions(model(Term(shaped), Term(Angular(axis="X", about="Y")))) == {}


def test_behind_a_rotary_axis_all_directions_count() -> None:
    code = "w b Y X Z C t"
    assert affected_directions(model(growth("X", "T1"), code=code)) == {"T1": ALL}


def test_a_lost_signal_marks_its_directions_and_its_last_value_stays_in_use() -> None:
    stage = LiveCompensator(model(growth("X", "T1"), growth("Y", "T2")))
    stage.update(0.0, good(T1=21.0, T2=22.0))
    before = stage.step([100.0, 200.0, 0.0], [0.0, 0.0, 0.0])
    assert before == pytest.approx((200.0 * 1e-5 * 1.0, 100.0 * 1e-5 * 2.0, 0.0))
    assert stage.faulty == 0
    cut = {"T1": SignalReading(21.0, "broken wire", 0.0), **good(T2=22.0)}
    stage.update(1.0, cut)
    assert stage.faulty == X
    assert stage.step([100.0, 200.0, 0.0], [0.0, 0.0, 0.0]) == before


def test_a_signal_that_never_came_does_not_keep_the_others_waiting() -> None:
    stage = LiveCompensator(model(growth("X", "T1"), growth("Y", "T2")))
    assert stage.step([100.0, 200.0, 0.0], [0.0] * 3) is None
    stage.update(0.0, {"T1": SignalReading(math.nan, "not read"), **good(T2=22.0)})
    assert stage.faulty == X
    found = stage.step([100.0, 200.0, 0.0], [0.0] * 3)
    assert found is not None
    assert found[1] == pytest.approx(100.0 * 1e-5 * 2.0)


def test_a_lag_begins_with_the_first_value_not_with_what_stood_in_for_it() -> None:
    effect = ScaleExpansion(axis="X", signals=("T1",), tau=1000.0)
    stage = LiveCompensator(model(Term(effect, {"alpha": Value(1e-5)})))
    stage.update(0.0, {"T1": SignalReading(math.nan, "not read")})
    stage.step([0.0, 100.0, 0.0], [0.0] * 3)
    stage.update(1.0, good(T1=30.0))
    found = stage.step([0.0, 100.0, 0.0], [0.0] * 3)
    assert found is not None
    assert found[0] == pytest.approx(100.0 * 1e-5 * 10.0)


def test_a_compensator_that_fails_is_a_named_fault_and_recovers(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    stage = LiveCompensator(model(growth("X", "T1")))
    stage.update(0.0, good(T1=21.0))
    fine = stage.step([0.0, 100.0, 0.0], [0.0] * 3)
    compensator = stage._compensator
    with monkeypatch.context() as patch:
        patch.setattr(compensator, "step", lambda *_: (math.nan, 0.0, 0.0))
        assert stage.step([0.0, 100.0, 0.0], [0.0] * 3) is None
        assert "nan" in stage.fault

        def crash(*_: object) -> None:
            raise ZeroDivisionError("on purpose")

        patch.setattr(compensator, "step", crash)
        for _ in range(3):
            assert stage.step([0.0, 100.0, 0.0], [0.0] * 3) is None
        assert stage.fault == "ZeroDivisionError: on purpose"
    assert len([r for r in caplog.records if "on purpose" in r.message]) == 1
    assert stage.step([0.0, 100.0, 0.0], [0.0] * 3) == fine
    assert stage.fault == ""


def test_what_no_table_holds_is_named_in_the_log(caplog: pytest.LogCaptureFixture) -> None:
    odd = make_effect("formula", {"channel": "dX", "terms": ("max(X-350,Y-450)",)})
    with caplog.at_level(logging.INFO, "abbe.pipeline"):
        LiveCompensator(model(growth("X", "T1")))
        assert caplog.messages == []
        names = [p.name for p in odd.linear(machine())]
        LiveCompensator(model(Term(odd, {n: Value(1e-5) for n in names})))
    assert caplog.messages == [f"computed at every point, as no table holds them: {odd.spec}"]
