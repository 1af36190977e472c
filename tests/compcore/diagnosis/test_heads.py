"""Heads before a sphere, by closed forms written here: the pivot length is named, and no scales."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.effects import RotaryLocation, SpindleLocation
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging.trial import as_campaign

F64 = NDArray[np.float64]
LINE = 250.0
"""mm by which the head's line lies above the spindle's face."""
TOOL = 100.0


def turned(c: float, b: float) -> F64:
    """Rz(c)·Ry(b)."""
    z = np.array([[np.cos(c), -np.sin(c), 0.0], [np.sin(c), np.cos(c), 0.0], [0.0, 0.0, 1.0]])
    y = np.array([[np.cos(b), 0.0, np.sin(b)], [0.0, 1.0, 0.0], [-np.sin(b), 0.0, np.cos(b)]])
    return np.asarray(z @ y)


def fork(off: F64, zero: float = 0.0) -> tuple[Model, Campaign]:
    """A fork head C, B; its lines lie `off` (mm) beside the spindle, C counts `zero` rad short.

    The sphere's place is unknown; the controller keeps the tip at it. The tip that is thought at
    P + R·(0, 0, −LINE − TOOL) hangs from lines that lie `off` elsewhere, right at zero:
    the error is off − R·off, and what C turns too far.
    """
    model = parse_model(
        TomlSource(f"""
format = "abbe-model/1"
[machine]
name = "gantry"
structure = "w b X Y Z C B t"
axes.X.travel = [-800.0, 800.0]
axes.Y.travel = [-800.0, 800.0]
axes.Z.travel = [-800.0, 300.0]
axes.C = {{ travel = [-180.0, 180.0], location = [0.0, 0.0, {LINE}] }}
axes.B = {{ travel = [-110.0, 110.0], location = [0.0, 0.0, {LINE}] }}
""")
    )
    rng = np.random.default_rng(5)
    rows = ['# format = "abbe-campaign/1"', '# [setups.P1]\n# free = ["frame"]']
    rows.append("setup,kind,X,Y,Z,C,B,tool_x,tool_y,tool_z,ux,uy,uz,value,sd")
    poses = [(30.0 * i, 0.0) for i in range(12)] + [(0.0, 15.0 * i) for i in range(-6, 7)]
    poses += [(45.0 * i, b) for i in range(-4, 4) for b in (-75.0, -45.0, 45.0, 75.0)]
    arm = np.array([0.0, 0.0, -LINE - TOOL])
    for c, b in np.deg2rad(poses):
        c = (c + np.pi) % (2.0 * np.pi) - np.pi
        r = turned(c, b)
        at = arm - r @ arm
        error = off - r @ off + (turned(c + zero, b) - r) @ arm
        for k in range(3):
            u = np.eye(3)[k]
            rows.append(
                f"P1,displacement,{at[0]:.6f},{at[1]:.6f},{at[2]:.6f},{np.rad2deg(c):.6f},"
                f"{np.rad2deg(b):.6f},0,0,{-TOOL},{u[0]},{u[1]},{u[2]},"
                f"{error[k] * 1e3 + rng.normal(0.0, 0.3):.3f},0.3"
            )
    return model, as_campaign("\n".join(rows) + "\n", model)


def test_a_pivot_length_is_no_three_scales() -> None:
    """Around one sphere X, Y and Z move on a ball: its radius is their scales, too."""
    model, campaign = fork(np.array([0.0, 0.0, 0.035]))
    named = [e.found.candidate.effect.spec for e in diagnose(model, campaign).established]
    assert named == ["spindle_location"]


def test_a_spindle_beside_the_head_is_no_zero_of_the_head() -> None:
    """B that counts from elsewhere turns the spindle in its holder: nothing tells them apart."""
    off = np.array([0.018, 0.0, 0.035])
    model, campaign = fork(off)
    lines = [RotaryLocation(axis=a) for a in "CB"]
    found = fit(model.with_effects(*lines, SpindleLocation()), campaign).model
    values = {n: v for t in found.terms for n, v in t.values.items()}
    for k, name in ((0, "E_X0S"), (1, "E_Y0S"), (2, "E_Z0S")):
        sd = values[name].sd
        assert sd is not None
        assert sd < 3e-4
        assert values[name].value == pytest.approx(-off[k], abs=3.0 * sd), name
    assert values["E_B0B"].value == pytest.approx(0.0, abs=1e-9)


def test_two_zeros_that_are_the_same_are_the_one_nearer_to_the_bed() -> None:
    """C that is turned by 50 µrad, or B's line about C: the former, and not half of each."""
    model, campaign = fork(np.zeros(3), 50e-6)
    chain = [RotaryLocation(axis=a) for a in "CB"]
    start = fit(model.with_effects(*chain), campaign).model
    values = {n: v for t in start.terms for n, v in t.values.items()}
    assert values["E_C0B"].value == pytest.approx(0.0, abs=1e-9)
    assert values["E_C0C"].value == pytest.approx(50e-6, abs=1e-6)
