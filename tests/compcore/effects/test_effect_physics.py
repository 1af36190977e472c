"""What several columns of one effect have to do with each other: beams, sensors, reversals."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.effects import make_effect
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.model.model import Model, Term, Value
from tests.support.compcore.catalogue import MILL, SIGNALS
from tests.support.compcore.machines import machine

HALF = 1e-3


def model(m, *specs):
    """A model from specs as typed, each with its parameters' values."""
    terms = []
    for spec, values in specs:
        kind, *pairs = spec.split(" ")
        effect = make_effect(kind, dict(p.split("=", 1) for p in pairs))
        terms.append(Term(effect, {k: Value(v) for k, v in values.items()}))
    return Model(m, tuple(terms))


def with_signals(m: Machine) -> Machine:
    return Machine(m.name, m.structure, m.axes, SIGNALS)


# an arm along Y, 900 mm long, that sags by 30 µm at its end
ARM = "w b X Y Z t"


@pytest.mark.parametrize("axis", ["Y", "X"])
def test_the_end_of_an_arm_deflects_by_the_cantilever_s_line(axis):
    """F·L³/(3EI), wherever the error is booked; with the slope F·L²/(2EI) on the tool."""
    m = model(machine(ARM), (f"overhang_sag axis={axis} direction=Z by=Y", {"sag": -0.03}))
    reach = np.array([0.0, 300.0, 600.0, 900.0])
    at = Conditions.at({"X": 100.0, "Y": reach, "Z": 0.0})
    found = m.predict(at)
    np.testing.assert_allclose(found.translation[:, 2], -0.03 * (reach / 900) ** 3, atol=1e-15)
    # the arm's slope is the derivative of its bending line under the load's own travel: 3/2·s·L²/L³
    slope = -0.03 * 1.5 * reach**2 / 900**3
    np.testing.assert_allclose(found.rotation[:, 0], slope, atol=1e-18)
    longer = Conditions.at({"X": 100.0, "Y": reach, "Z": 0.0}, tool=(0.0, 50.0, 0.0))
    moved = m.predict(longer).translation[:, 2] - found.translation[:, 2]
    np.testing.assert_allclose(moved, 50.0 * slope, atol=1e-15)


def test_slope_and_deflection_have_the_ratio_of_the_beam_s_theory():
    """Timoshenko: δ = F·L³/3EI and φ = F·L²/2EI, so φ = 3δ/2L, at every length."""
    m = model(machine(ARM), ("overhang_sag axis=Y direction=Z by=Y", {"sag": 0.05}))
    reach = np.linspace(1.0, 900.0, 7)
    found = m.predict(Conditions.at({"X": 0.0, "Y": reach, "Z": 0.0}))
    np.testing.assert_allclose(found.rotation[:, 0], 1.5 * found.translation[:, 2] / reach)


def test_a_ram_that_reaches_down_leans_where_it_deflects():
    m = model(machine(), ("overhang_sag axis=Z direction=X by=Z", {"sag": 0.01}))
    at = Conditions.at({"X": 0.0, "Y": 0.0, "Z": -360.0})
    tip = Conditions.at({"X": 0.0, "Y": 0.0, "Z": -360.0}, tool=(0.0, 0.0, -100.0))
    assert m.predict(at).translation[0, 0] == pytest.approx(0.01)
    assert m.predict(tip).translation[0, 0] == pytest.approx(0.01 + 100 * 1.5 * 0.01 / 360)


def test_a_beam_s_root_may_lie_beyond_the_travel():
    m = model(machine(ARM), ("overhang_sag axis=Y direction=Z by=Y root=-100", {"sag": 0.1}))
    found = m.predict(Conditions.at({"X": 0.0, "Y": [0.0, 900.0], "Z": 0.0})).translation[:, 2]
    np.testing.assert_allclose(found, [0.1 * 0.1**3, 0.1])
    far = model(machine(ARM), ("overhang_sag axis=Y direction=Z by=Y root=1000", {"sag": 0.1}))
    found = far.predict(Conditions.at({"X": 0.0, "Y": [0.0, 900.0], "Z": 0.0}))
    np.testing.assert_allclose(found.translation[:, 2], [0.1, 0.1 * 0.1**3])
    assert found.rotation[0, 0] < 0.0, "it reaches towards −Y and deflects upwards"


@pytest.mark.parametrize(
    ("spec", "values"),
    [
        ("overhang_sag axis=X direction=Z by=X", {"sag": 0.03}),
        ("thermal_bending axis=X about=Y signals=T_front,T_rear deflection=true", {"kappa": 5e-8}),
    ],
)
def test_a_table_that_bends_points_along_its_own_line(spec, values):
    """The table of an X' axis moves towards −X; where its line goes, there its surface tilts.

    The error is the tool against the table: e(r) = −(u + ψ × r), r from the table's reference.
    """
    m = model(with_signals(machine("w X' b Y Z t")), (spec, values))

    def table(q):
        signals = dict.fromkeys(SIGNALS, 20.0) | {"T_front": 26.0}
        fixed = dict.fromkeys(m.machine.axes, 0.0)
        at = Conditions.at({**fixed, "X": q}, tool=(-q, 0.0, 0.0), signals=signals)
        found = m.predict(at)
        # r = 0: the tool stands at the table's reference
        return -found.translation[0], -found.rotation[0]

    for q in (100.0, 350.0, 600.0):
        ahead, behind = table(q + HALF)[0], table(q - HALF)[0]
        line = (ahead - behind) / (2 * HALF)
        _, psi = table(q)
        towards = np.array([-1.0, 0.0, 0.0])
        tilt = np.cross(psi, towards)
        # the sag's line is drawn by a load that travels along: its slope is half of 3·s·L²/L³
        part = 0.5 if spec.startswith("overhang") else 1.0
        np.testing.assert_allclose(tilt, part * line, atol=1e-12)
        assert np.abs(line).max() > 1e-6


@pytest.mark.parametrize("code", ["w b Y X Z t", "w b Z Y X t"])
@pytest.mark.parametrize("acts", [None, "before", "after"])
def test_a_beam_bent_by_heat_is_one_smooth_line(code, acts):
    """The carriage's place is the integral of its slope, in whatever order the error is applied."""
    m = with_signals(machine(code, X=Axis("X", (0.0, 700.0), error_acts=acts)))
    spec = "thermal_bending axis=X about=Z signals=T_front,T_rear deflection=true"
    m = model(m, (spec, {"kappa": 5e-8}))
    signals = dict.fromkeys(SIGNALS, 20.0) | {"T_front": 26.0}

    def place(q):
        at = Conditions.at({"X": q, "Y": 0.0, "Z": 0.0}, signals=signals)
        found = m.predict(at)
        return found.translation[0], found.rotation[0]

    for q in (50.0, 400.0, 690.0):
        slope = (place(q + HALF)[0] - place(q - HALF)[0]) / (2 * HALF)
        np.testing.assert_allclose(slope, np.cross(place(q)[1], [1.0, 0.0, 0.0]), atol=1e-13)
    assert place(700.0)[0][1] == pytest.approx(0.5 * 5e-8 * 6.0 * 700.0**2)


def test_backlash_is_the_reversal_value_of_iso_230_2():
    m = model(machine(), ("backlash axis=X", {"b": -0.008}))
    at = Conditions.at({"X": 300.0, "Y": 0.0, "Z": 0.0}, directions={"X": [1.0, -1.0, 0.0]})
    up, down, unknown = m.predict(at).translation[:, 0]
    assert up - down == pytest.approx(-0.008)
    assert unknown == 0.0


def readings(n=50, offset=0.0):
    rng = np.random.default_rng(3)
    t = {k: rng.uniform(18.0, 26.0, n) for k in SIGNALS}
    t["T_x"] = t["T_x"] + offset
    q = {a: rng.uniform(*MILL.axes[a].travel, n) for a in "XYZ"}
    return Conditions.at(q, signals=t, time=np.arange(n) * 100.0)


WARM = (
    ("scale_expansion axis=X signals=T_x,T_screw", {"alpha": 12e-6}),
    ("thermal_tilt axis=Y about=X signal=T_x tau=800", {"k": 7e-6}),
    ("formula channel=dZ terms=(T_x-T0)**2", {"c1": 1e-5}),
    ("thermal_offset direction=Y signal=T_rear", {"k": 0.003}),
)


def test_a_sensor_s_offset_is_taken_off_its_readings():
    """The machine errs by its true temperature; the sensor says 0.7 K more."""
    truth = model(MILL, *WARM).predict(readings())
    deceived = model(MILL, *WARM).predict(readings(offset=0.7))
    assert np.abs(deceived.translation - truth.translation).max() > 1e-3
    knowing = model(MILL, *WARM, ("sensor_offset signal=T_x", {"offset": 0.7}))
    found = knowing.predict(readings(offset=0.7))
    np.testing.assert_allclose(found.translation, truth.translation, atol=1e-15)
    parts = knowing.contributions(readings(offset=0.7))
    np.testing.assert_allclose(sum(parts.values()), truth.translation, atol=1e-15)
    assert not any(name.startswith("sensor_offset") for name in parts)


def test_lags_that_the_live_path_keeps_are_amended_too():
    at = readings()
    kept = Conditions(
        positions=at.positions,
        signals=at.signals,
        time=at.time,
        given_lags={("T_x", 800.0): at.lag("T_x", 800.0)},
    )
    m = model(MILL, *WARM, ("sensor_offset signal=T_x", {"offset": 0.7}))
    np.testing.assert_allclose(m.predict(kept).translation, m.predict(at).translation, atol=1e-15)


def test_the_columns_of_a_sensor_s_offset_are_the_derivative():
    effect = make_effect("sensor_offset", {"signal": "T_x"})
    plain = model(MILL, *WARM)
    motions = effect.motions_among(MILL, readings(), {}, plain.terms)
    step = 1e-4
    ends = [
        model(MILL, *WARM, ("sensor_offset signal=T_x", {"offset": o})).error_motions(readings())
        for o in (step, -step)
    ]
    found: dict = {}
    for motion in motions:
        found[motion.error_motion] = found.get(motion.error_motion, 0.0) + motion.columns[:, 0]
    assert {str(c) for c in found} == {"E_XX", "E_AY", "dZ"}
    for channel, column in found.items():
        slope = (ends[0][channel] - ends[1][channel]) / (2 * step)
        np.testing.assert_allclose(column, slope, atol=1e-9 * np.abs(slope).max())
    assert effect.motions(MILL, readings(), {}) == ()


def magnified(at, gain):
    """What a thermometer shows that reads differences from 20 °C too large by a part of them."""
    return {**at.signals, "T_x": 20.0 + (1.0 + gain) * (at.signals["T_x"] - 20.0)}


def test_a_sensor_s_gain_is_taken_off_its_readings():
    """The machine errs by its true temperature, lags included; the sensor magnifies it."""
    at = readings()
    shown = Conditions(positions=at.positions, signals=magnified(at, 0.1), time=at.time)
    truth = model(MILL, *WARM).predict(at)
    deceived = model(MILL, *WARM).predict(shown)
    assert np.abs(deceived.translation - truth.translation).max() > 1e-3
    knowing = model(MILL, *WARM, ("sensor_gain signal=T_x", {"gain": 0.1}))
    np.testing.assert_allclose(knowing.predict(shown).translation, truth.translation, atol=1e-14)
    assert not any(name.startswith("sensor_gain") for name in knowing.contributions(shown))
    lags = {("T_x", 800.0): shown.lag("T_x", 800.0)}
    kept = Conditions(positions=at.positions, signals=shown.signals, time=at.time, given_lags=lags)
    np.testing.assert_allclose(knowing.predict(kept).translation, truth.translation, atol=1e-14)


@pytest.mark.parametrize("gain", [0.0, 0.15])
def test_the_columns_of_a_sensor_s_gain_are_the_derivative(gain):
    step = 1e-5
    ends = [
        model(MILL, *WARM, ("sensor_gain signal=T_x", {"gain": g})).error_motions(readings())
        for g in (gain + step, gain - step)
    ]
    whole = model(MILL, *WARM, ("sensor_gain signal=T_x", {"gain": gain}))
    effect = whole.terms[-1].effect
    found: dict = {}
    for motion in effect.motions_among(MILL, whole.amended(readings()), {}, whole.terms):
        found[motion.error_motion] = found.get(motion.error_motion, 0.0) + motion.columns[:, 0]
    assert {str(c) for c in found} == {"E_XX", "E_AY", "dZ"}
    for channel, column in found.items():
        slope = (ends[0][channel] - ends[1][channel]) / (2 * step)
        if str(channel) != "dZ":  # a square: its derivative is taken over half a unit
            np.testing.assert_allclose(column, slope, atol=1e-7 * np.abs(slope).max())


def bent(at, bend):
    """What a thermometer shows that runs off with the square of the distance from 20 °C."""
    off = at.signals["T_x"] - 20.0
    return {**at.signals, "T_x": 20.0 + off + bend * off**2}


def test_a_sensor_s_bend_is_taken_off_its_readings():
    """The machine errs by its true temperature; what is behind a lag, by the lagged reading's."""
    at = readings()
    shown = Conditions(positions=at.positions, signals=bent(at, 4e-3), time=at.time)
    plain = [w for w in WARM if "tau" not in w[0]]
    assert plain
    truth = model(MILL, *plain).predict(at)
    deceived = model(MILL, *plain).predict(shown)
    assert np.abs(deceived.translation - truth.translation).max() > 1e-4
    knowing = model(MILL, *plain, ("sensor_bend signal=T_x", {"bend": 4e-3}))
    np.testing.assert_allclose(knowing.predict(shown).translation, truth.translation, atol=1e-14)
    # with a lag it makes no difference who kept the lagged readings: live it is the daemon
    knowing = model(MILL, *WARM, ("sensor_bend signal=T_x", {"bend": 4e-3}))
    whole = knowing.predict(shown).translation
    lags = {("T_x", 800.0): shown.lag("T_x", 800.0)}
    kept = Conditions(positions=at.positions, signals=shown.signals, time=at.time, given_lags=lags)
    np.testing.assert_allclose(knowing.predict(kept).translation, whole, atol=1e-14)
    half = np.arange(shown.n // 2, shown.n)
    np.testing.assert_allclose(
        knowing.predict(shown.rows(half)).translation, whole[half], atol=1e-14
    )


@pytest.mark.parametrize("bend", [0.0, 4e-3])
def test_the_columns_of_a_sensor_s_bend_are_the_derivative(bend):
    step = 1e-6
    ends = [
        model(MILL, *WARM, ("sensor_bend signal=T_x", {"bend": b})).error_motions(readings())
        for b in (bend + step, bend - step)
    ]
    whole = model(MILL, *WARM, ("sensor_bend signal=T_x", {"bend": bend}))
    effect = whole.terms[-1].effect
    found: dict = {}
    for motion in effect.motions_among(MILL, whole.amended(readings()), {}, whole.terms):
        found[motion.error_motion] = found.get(motion.error_motion, 0.0) + motion.columns[:, 0]
    assert {str(c) for c in found} == {"E_XX", "E_AY", "dZ"}
    for channel, column in found.items():
        slope = (ends[0][channel] - ends[1][channel]) / (2 * step)
        np.testing.assert_allclose(column, slope, atol=1e-5 * np.abs(slope).max())


@pytest.mark.parametrize("kind", ["sensor_gain", "sensor_bend"])
def test_a_sensor_s_gain_is_one_of_a_temperature(kind):
    effect = make_effect(kind, {"signal": "F"})
    with pytest.raises(InputError, match=r"not a temperature|no such signal"):
        effect.check(MILL)


def test_a_sensor_s_offset_needs_a_signal_that_exists():
    effect = make_effect("sensor_offset", {"signal": "T_q"})
    with pytest.raises(InputError, match=r"no such signal.*T_q.*T_x"):
        effect.check(MILL)


def test_spindle_growth_turns_with_the_head_and_other_shifts_do_not():
    head = Machine(
        "head",
        machine("w b X Y Z B t").structure,
        machine("w b X Y Z B t", B=Axis("B", (-2.0, 2.0))).axes,
        SIGNALS,
    )
    signals = dict.fromkeys(SIGNALS, 20.0) | {"T_spindle": 30.0, "T_front": 30.0}
    at = Conditions.at({"X": 0.0, "Y": 0.0, "Z": 0.0, "B": np.pi / 2}, signals=signals)
    spindle = model(head, ("thermal_offset direction=Z signal=T_spindle", {"k": 0.001}))
    np.testing.assert_allclose(spindle.predict(at).translation, [[0.01, 0.0, 0.0]], atol=1e-15)
    column = model(head, ("thermal_offset direction=Z signal=T_front", {"k": 0.001}))
    np.testing.assert_allclose(column.predict(at).translation, [[0.0, 0.0, 0.01]], atol=1e-15)


def test_a_warm_workpiece_is_measured_right_at_the_reference_temperature():
    """Steel, 500 mm at 20 °C, at 30 °C: the reading is 500.0575 mm and is corrected to 500."""
    m = model(MILL, ("workpiece_expansion signal=T_part", {"alpha": 11.5e-6}))
    reading = 500.0 * (1 + 11.5e-6 * 10.0)
    signals = dict.fromkeys(SIGNALS, 20.0) | {"T_part": 30.0}
    at = Conditions.at({"X": reading, "Y": 0.0, "Z": 0.0}, signals=signals)
    corrected = reading + m.axis_error(at)["X"][0]
    assert corrected == pytest.approx(500.0, abs=1e-5)
    # the probe's tip, not the carriage, touches the workpiece
    tip = Conditions.at({"X": reading - 60, "Y": 0.0, "Z": 0.0}, signals=signals, tool=(60, 0, 0))
    assert m.axis_error(tip)["X"][0] == pytest.approx(m.axis_error(at)["X"][0])


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ("overhang_sag axis=Y direction=Y by=Y", "across its reach"),
        ("overhang_sag axis=Y direction=Z by=Y root=100", "at or beyond an end"),
        ("cross_angular axis=Y about=X by=Y", "another axis"),
        ("thermal_bending axis=Z about=Z signals=T_front,T_rear deflection=true", "twist"),
        ("thermal_bending axis=Z about=X signals=T_front,T_front", "two signals of one unit"),
        ("thermal_tilt axis=Z about=X signals=T_front,p_air", "two signals of one unit"),
        ("scale_expansion axis=X signals=load", "not a temperature"),
        ("workpiece_expansion signal=load", "not a temperature"),
        ("feed_lag axis=X signal=T_x", "not a feed"),
        ("dead_path setups=a signals=T_air,T_x", "not one temperature, pressure and humidity"),
        ("dead_path setups=a signals=speed", "not one temperature, pressure and humidity"),
        ("spindle_squareness direction=Z", "across its own direction"),
        ("rotary_location axis=X", "effect of rotary axes"),
        ("cyclic axis=Q", "no such axis"),
        ("backlash axis=Q", "no such axis.*X, Y, Z"),
        ("cross_angular axis=Y about=X by=Q", "no such axis"),
        ("thermal_offset direction=Z signal=T_q", "no such signal.*T_x"),
    ],
)
def test_what_makes_no_sense_is_refused(spec, said):
    kind, *pairs = spec.split(" ")
    with pytest.raises(InputError, match=said):
        make_effect(kind, dict(p.split("=", 1) for p in pairs)).check(MILL)


@pytest.mark.parametrize(
    ("kind", "keys", "field"),
    [
        ("warm_up", {}, "warm_up"),
        ("warm_up", {"axis": "X", "direction": "X"}, "warm_up"),
        ("warm_up", {"direction": "Q"}, "direction"),
        ("warm_up", {"direction": "X", "tau": -5}, "tau"),
        ("thermal_offset", {"direction": "Z", "signal": "T", "tau": "soon"}, "tau"),
        ("thermal_tilt", {"axis": "Y", "about": "X"}, "thermal_tilt"),
        (
            "thermal_tilt",
            {"axis": "Y", "about": "X", "signal": "T", "signals": "A,B"},
            "thermal_tilt",
        ),
        ("thermal_tilt", {"axis": "Y", "about": "X", "signals": "A,B,C"}, "signals"),
        ("thermal_bending", {"axis": "Y", "about": "X", "signals": "A"}, "signals"),
        ("load_bending", {"axis": "Y", "signal": "L"}, "load_bending"),
        ("local_defect", {"axis": "X", "error": "E_ZY"}, "error"),
        ("local_defect", {"axis": "X", "error": "E_ZX", "width": 0}, "width"),
        ("cyclic", {"axis": "X", "harmonics": 0}, "harmonics"),
        ("cyclic", {"axis": "X", "period": "ten"}, "period"),
        ("rotary_tilt", {"axis": "C", "direction": "X", "harmonics": 2, "shape": "table"}, "shape"),
        ("rotary_axial", {"axis": "C", "positions": "0,90"}, "positions"),
        ("cosine", {}, "setup"),
        ("cosine", {"setup": "a", "angle": 3}, "angle"),
    ],
)
def test_wrong_keys_are_named(kind, keys, field):
    with pytest.raises(InputError) as caught:
        make_effect(kind, keys)
    assert caught.value.field == field


def test_a_set_up_that_measures_something_else_is_refused():
    at = Conditions(
        positions={a: np.zeros(2) for a in "XYZ"},
        setup=np.array(["level", "level"]),
        u=np.eye(3)[:2],
        kind=np.array([1, 1], dtype=np.int8),
    )
    effect = make_effect("instrument_drift", {"setup": "level"})
    with pytest.raises(InputError, match="measures angles.*expected angle"):
        effect.motions(MILL, at, {})


def test_microseconds_are_no_delay_of_a_feed():
    """A mean stroke a minute, read while the machine stood, is its heat."""
    lag = make_effect("feed_lag", {"axis": "X", "signal": "feed"})
    assert lag.misnamed({"delay": 1.75e-6})
    assert not lag.misnamed({"delay": -4e-4})
