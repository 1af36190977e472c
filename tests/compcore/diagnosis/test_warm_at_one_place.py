"""What was warm at one place, or with one tool, only: it is a shift, and what decides is said."""

from __future__ import annotations

import math
import random
from functools import cache

import pytest

from abbe.compcore.diagnosis.advice import advise
from abbe.compcore.diagnosis.explain import explanation
from abbe.compcore.diagnosis.verdict import Diagnosis, diagnose
from abbe.compcore.effects.catalogue.temperature.shifts import ThermalOffset
from abbe.compcore.effects.registry import make_effect
from abbe.compcore.errors import InputError
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from benchmarks.hidden.judging.trial import as_campaign

HEAD = '# format = "abbe-campaign/1"\n# instrument = "laser interferometer"\n'
MILL = """format = "abbe-model/1"
[machine]
name = "mill"
structure = "w Y' b X Z t"
[machine.axes.X]
travel = [0.0, 500.0]
[machine.axes.Y]
travel = [0.0, 600.0]
[machine.axes.Z]
travel = [-300.0, 0.0]
"""
SPINDLE = """[machine.signals.T_bearing]
unit = "degC"
role = "spindle"
[[effects]]
kind = "positioning"
axis = "Z"
shape = "spline:5"
[[effects]]
kind = "thermal_offset"
direction = "Z"
signal = "T_bearing"
"""
TABLE = """[machine.signals.T_motor]
unit = "degC"
role = "structure"
axis = "Y"
[machine.signals.T_amb]
unit = "degC"
role = "ambient"
"""


@cache
def spindle_at_one_place(places: tuple[float, ...]) -> Diagnosis:
    """Z by its places cold, then a spindle on and off; the head behind the bearing by 50 min.

    The growth of the head in truth: 5 µm/K, wherever Z stands.
    """
    noise = random.Random(5)
    model = parse_model(TomlSource(MILL + SPINDLE))
    rows = [HEAD + "time,setup,kind,X,Y,Z,ux,uy,uz,value,sd,T_bearing"]
    t = 0.0
    for line in range(2):
        for i in range(13):
            value = 0.02 * i - 0.004 * i * i + noise.gauss(0.0, 0.3)
            rows.append(f"{t},z{line},displacement,250,300,{-25 * i},0,0,1,{value},0.3,20.5")
            t += 10.0
    bearing = head = 0.0
    for i in range(220):
        heat = 12.0 if (i // 40) % 2 == 0 else 0.0
        bearing += (heat - bearing) * 120.0 / 420.0
        head += (bearing - head) * 120.0 / 3000.0
        z = places[i % len(places)]
        value = -1.5 * bearing - 5.0 * head + noise.gauss(0.0, 0.3)
        rows.append(f"{t},e,displacement,250,300,{z},0,0,1,{value},0.3,{20.5 + bearing:.2f}")
        t += 120.0
    return diagnose(model, as_campaign("\n".join(rows) + "\n", model))


def test_growth_that_was_seen_at_one_z_is_a_shift_and_another_z_decides() -> None:
    """Before: Z's scale by the bearing, 34 ppm/K; the model's own shift hid the one that lags."""
    found = spindle_at_one_place((-150.0,))
    first = found.established[0]
    assert first.effect.spec == "thermal_offset direction=Z signal=T_bearing tau=fit"
    apart = [a.found.candidate.effect.spec for a in first.aliases if not a.told_apart]
    assert "scale_expansion axis=Z signals=T_bearing tau=fit" in apart
    assert "Warm at another Z decides" in explanation(first, found)


def test_what_to_measure_next_is_what_the_campaign_cannot_tell_now() -> None:
    """Before, χ² of thousands "now" beside "cannot tell it from": the rival passed for unseen."""
    found = spindle_at_one_place((-150.0,))
    first = advise(found)[0]
    rivals = {a.found.candidate.effect.spec: a for a in found.established[0].aliases}
    now = rivals[first.separates or ""].separation
    assert first.separation_now == pytest.approx(now, rel=0.2, abs=1.0)
    assert first.separation_now < 14.0 < first.separation


def test_growth_that_was_seen_at_several_z_needs_no_other() -> None:
    """Z that was at four places while it was warm tells a scale from a shift."""
    found = spindle_at_one_place((-50.0, -150.0, -250.0, -290.0))
    first = found.established[0]
    assert first.effect.spec == "thermal_offset direction=Z signal=T_bearing tau=fit"
    assert "Warm at another Z decides" not in explanation(first, found)


def test_a_rise_above_the_air_shifts_before_it_tilts() -> None:
    """A ball on a warm table with one tool: a ram's tilt was the only one to take a difference."""
    noise = random.Random(6)
    model = parse_model(TomlSource(MILL + TABLE))
    rows = [HEAD + "time,setup,kind,X,Y,Z,tool_z,ux,uy,uz,value,sd,T_motor,T_amb"]
    for i in range(240):
        t = 60.0 * i
        air = 20.0 + 1.5 * math.sin(t / 3000.0)
        rise = 8.0 * (1.0 - math.exp(-t / 4000.0)) if i < 120 else 7.0 * math.exp(-(t - 7200) / 4e3)
        value = 1.9 * rise + noise.gauss(0.0, 0.2)
        rows.append(
            f"{t},ball{i // 60},displacement,{150 + 100 * (i % 3)},300,-200,-120,1,0,0,{value},0.2,"
            f"{air + rise:.2f},{air:.2f}"
        )
    found = diagnose(model, as_campaign("\n".join(rows) + "\n", model))
    first = found.established[0]
    assert first.effect.spec == "thermal_offset direction=X signals=T_motor,T_amb"
    assert first.estimates[0].value == pytest.approx(1.9e-3, abs=0.05e-3)
    kinds = {a.found.candidate.effect.kind for a in first.aliases if not a.told_apart}
    assert "thermal_tilt" in kinds
    assert "tool of another length decides" in explanation(first, found)


@pytest.mark.parametrize("keys", [{}, {"signal": "T_motor", "signals": "T_motor,T_amb"}])
def test_a_shift_takes_one_signal_or_two(keys: dict[str, str]) -> None:
    """Neither none nor both."""
    with pytest.raises(InputError, match="one signal or two signals, not both"):
        make_effect("thermal_offset", {"direction": "X", **keys})


def test_a_difference_needs_one_unit() -> None:
    """Kelvin less kilowatts are nothing."""
    other = '[machine.signals.load]\nunit = "kW"\nrole = "load"\n'
    machine = parse_model(TomlSource(MILL + TABLE + other)).machine
    with pytest.raises(InputError, match="two signals of one unit"):
        ThermalOffset(direction="X", signals=("T_motor", "load")).check(machine)
