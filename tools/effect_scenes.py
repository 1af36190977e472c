"""What the handbook's pictures show: for each effect an example, and along what its curve runs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from abbe.compcore.effects import Effect, make_effect
from abbe.compcore.effects.base import FUNCTIONAL_POINT, ErrorMotion
from abbe.compcore.effects.catalogue.error_grid import ErrorGrid, MeasuredTable
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure

SIGNALS = {
    s.name: s
    for s in (
        Signal("T", role="scale"),
        Signal("T1", role="structure"),
        Signal("T2", role="structure"),
        Signal("T_spindle", role="spindle"),
        Signal("T_screw", role="screw"),
        Signal("T_part", role="workpiece"),
        Signal("T_air", role="air"),
        Signal("p_air", unit="hPa", role="air"),
        Signal("load", unit="kg", role="load"),
        Signal("feed", unit="mm/min", role="speed"),
        Signal("Y_ahead", unit="mm"),
    )
}


def _machine(code: str, axes: Mapping[str, Axis]) -> Machine:
    structure = Structure.parse(code)
    return Machine(code, structure, {a: axes[a] for a in structure.axes}, SIGNALS)


_AXES = {
    "X": Axis("X", (0.0, 700.0)),
    "Y": Axis("Y", (0.0, 900.0)),
    "Z": Axis("Z", (-360.0, 0.0)),
}
BRIDGE = _machine("w b Y X Z t", _AXES)
ARM = _machine("w b X Z Y t", _AXES)
CANTILEVER = _machine("w b Y X Z t", _AXES | {"Z": Axis("Z", (-500.0, 0.0))})
_SWIVEL = Axis("A", (-math.pi / 2, math.pi / 2), location=(0.0, 0.0, 250.0))
HEAD = _machine("w b X Y Z A t", _AXES | {"A": _SWIVEL})
TABLE = _machine(
    "w C' b X Y Z t",
    {a: Axis(a, (-300.0, 300.0)) for a in "XYZ"} | {"C": Axis("C", (-math.pi, math.pi))},
)


@dataclass(frozen=True)
class Curve:
    """The diagram beside the volume.

    Attributes
    ----------
    over
        What runs along the abscissa: an axis, a signal, ``t`` or ``C``; in mm, the signal's unit,
        hours, degrees.
    span
        From, to, in that unit.
    lines
        Label → what is different on that line (positions, directions, signals by name).
    words
        Of the abscissa.
    """

    over: str
    span: tuple[float, float]
    words: str
    lines: Mapping[str, Mapping[str, float]] = field(default_factory=lambda: {"": {}})


@dataclass(frozen=True)
class Scene:
    """One picture.

    Attributes
    ----------
    keys, values
        Where-keys, and the parameters' values.
    curve
        The diagram.
    caption
        What the picture shows, in a few words.
    machine
        Whose volume is drawn.
    state
        Positions, directions, signals (others: 20 °C, 0) and ``t`` (s) in the volume.
    versus
        A second deformed grid: what is different in it.
    look
        ``grid``, ``rings`` (a rotary table), ``pins`` (tools), ``line``, ``rays`` or ``plate``
        (what an instrument sees).
    u
        Measured direction of an instrument's line; for rings where the tool stands beside the axis.
    count
        Planes of the grid square to X, Y and Z.
    others
        Further effects of the model: kind, keys, values.
    tables
        The data of an error grid.
    """

    keys: Mapping[str, Any]
    values: Mapping[str, float]
    curve: Curve
    caption: str
    machine: Machine = BRIDGE
    state: Mapping[str, float] = field(default_factory=dict)
    versus: Mapping[str, float] | None = None
    look: str = "grid"
    u: str = "X"
    count: tuple[int, int, int] = (5, 4, 3)
    others: tuple[tuple[str, Mapping[str, Any], Mapping[str, float]], ...] = ()
    tables: tuple[MeasuredTable, ...] = ()

    def effect(self, kind: str) -> Effect:
        """The effect that is drawn, with its data where it has any."""
        made = make_effect(kind, self.keys)
        return made.holding(self.tables, "0" * 64) if isinstance(made, ErrorGrid) else made


def _over(axis: str, machine: Machine = BRIDGE, **lines: Mapping[str, float]) -> Curve:
    span = machine.axis(axis).travel
    named = {k.replace("_", " "): v for k, v in lines.items()} or {"": {}}
    return Curve(axis, span, f"{axis} in mm", named)


_TURN = Curve("C", (-180.0, 180.0), "C in degrees")


def _both(axis: str, does: str = "arriving") -> dict[str, dict[str, float]]:
    return {f"{does} +": {f"{axis}_dir": 1.0}, f"{does} −": {f"{axis}_dir": -1.0}}


def _some_grid() -> tuple[MeasuredTable, ...]:
    nodes = tuple(np.linspace(*_AXES[a].travel, n) for a, n in zip("XYZ", (5, 4, 3), strict=True))
    x, y, z = np.meshgrid(*(np.arange(len(n), dtype=float) for n in nodes), indexing="ij")
    waves = {"X": np.sin(2.1 * x + 1.3 * y), "Y": np.cos(1.7 * x - z), "Z": np.sin(x * y - 0.8 * z)}
    return tuple(
        MeasuredTable(ErrorMotion(FUNCTIONAL_POINT, c), ("X", "Y", "Z"), nodes, 0.02 * waves[c])
        for c in ("X", "Y", "Z")
    )


SCENES: Mapping[str, Scene] = {
    "positioning": Scene(
        {"axis": "X", "shape": "spline:6"},
        {"c1": 0.0, "c2": 0.03, "c3": -0.04, "c4": 0.05, "c5": -0.03, "c6": 0.02},
        _over("X"),
        "planes square to X stand at uneven distances",
        count=(12, 3, 2),
    ),
    "scale": Scene(
        {"axis": "X"}, {"k": 1e-4}, _over("X"), "the volume is longer along X than it says"
    ),
    "straightness": Scene(
        {"axis": "X", "direction": "Z", "shape": "spline:5"},
        {"c1": 0.0, "c2": 0.03, "c3": -0.01, "c4": -0.03, "c5": 0.0},
        _over("X"),
        "lines along X bend in Z, everywhere alike",
    ),
    "angular": Scene(
        {"axis": "Y", "about": "Y", "shape": "polynomial:2"},
        {"c0": 0.0, "c1": 6e-5, "c2": 3e-5},
        _over("Y"),
        "the bridge rolls as it travels: the volume is twisted",
    ),
    "squareness": Scene(
        {"axes": "Y,X"}, {"angle": 1e-4}, _over("Y"), "X and Y are not at right angles"
    ),
    "cyclic": Scene(
        {"axis": "X", "period": 175.0},
        {"A1": 0.0, "B1": 0.01},
        _over("X"),
        "planes square to X crowd and part with the period (here 175 mm, to be seen)",
        count=(21, 2, 2),
    ),
    "backlash": Scene(
        {"axis": "X"},
        {"b": -0.02},
        Curve("X", (0.0, 700.0), "X in mm", _both("X")),
        "blue: arriving in +X, orange: in −X",
        state={"X_dir": 1.0},
        versus={"X_dir": -1.0},
    ),
    "reversal_angle": Scene(
        {"axis": "Y", "about": "Z"},
        {"b": 6e-5},
        Curve("Y", (0.0, 900.0), "Y in mm", _both("Y")),
        "the bridge cocks: blue arriving in +Y, orange in −Y",
        state={"Y_dir": 1.0},
        versus={"Y_dir": -1.0},
    ),
    "two_drives": Scene(
        {"axis": "Y", "signal": "Y_ahead", "across": "X", "master": 0.0, "slave": 700.0},
        {"zero": 0.0},
        Curve(
            "Y_ahead",
            (-0.04, 0.04),
            "slave ahead of the master, mm",
            {"X = 0": {"X": 0.0}, "X = 700": {"X": 700.0}},
        ),
        "the slave, at X = 700, is ahead: the bridge yaws about the master",
        state={"Y_ahead": 0.04},
    ),
    "lateral_reversal": Scene(
        {"axis": "X", "direction": "Y"},
        {"b": 0.02},
        Curve("X", (0.0, 700.0), "X in mm", _both("X")),
        "the carriage steps aside: blue arriving in +X, orange in −X",
        state={"X_dir": 1.0},
        versus={"X_dir": -1.0},
    ),
    "local_defect": Scene(
        {"axis": "X", "error": "E_ZX", "centre": 250.0, "width": 90.0},
        {"depth": -0.02},
        _over("X"),
        "a dent in the guideway, wherever Y and Z stand",
    ),
    "joint": Scene(
        {"axis": "X", "error": "E_XX", "centre": 400.0},
        {"step": 0.01},
        Curve("X", (0.0, 700.0), "X in mm", _both("X")),
        "the scale is of two pieces, which lie 10 µm too far apart",
    ),
    "rotary_location": Scene(
        {"axis": "C"},
        {"E_X0C": 0.01, "E_Y0C": 0.0, "E_A0C": 0.0, "E_B0C": 8e-5, "E_C0C": 0.0},
        _TURN,
        "circles cut on the table, whose line lies elsewhere and leans: another size, on a cone",
        machine=TABLE,
        look="rings",
    ),
    "rotary_positioning": Scene(
        {"axis": "C", "harmonics": 2},
        {"A1": 0.0, "B1": 1e-4, "A2": 5e-5, "B2": 0.0},
        _TURN,
        "the table turns too far here and not far enough there: uneven spokes",
        machine=TABLE,
        look="rings",
    ),
    "rotary_radial": Scene(
        {"axis": "C", "direction": "X", "harmonics": 2},
        {"A1": 0.0, "B1": 0.0, "A2": 0.01, "B2": 0.0},
        _TURN,
        "the line wanders along X twice a turn: circles cut on the table become ovals",
        machine=TABLE,
        look="rings",
    ),
    "rotary_axial": Scene(
        {"axis": "C", "harmonics": 2},
        {"A1": 0.0, "B1": 0.0, "A2": 0.01, "B2": 0.0},
        _TURN,
        "what is cut on a table that rises and sinks twice a turn",
        machine=TABLE,
        look="rings",
    ),
    "rotary_tilt": Scene(
        {"axis": "C", "direction": "X", "harmonics": 1},
        {"A1": 8e-5, "B1": 0.0},
        _TURN,
        "what is cut on a table that wobbles about X while it turns, tool at +Y",
        u="Y",
        machine=TABLE,
        look="rings",
    ),
    "spindle_location": Scene(
        {},
        {"E_Y0S": 0.0, "E_Z0S": -0.05},
        Curve("A", (-90.0, 90.0), "A in degrees"),
        "a swivel head whose pivot is longer than entered: the tip errs as the head tilts",
        machine=HEAD,
        state={"A": 0.9},
    ),
    "spindle_squareness": Scene(
        {"direction": "X"},
        {"angle": 1e-4},
        Curve("tool", (0.0, 250.0), "length of the tool in mm"),
        "tools lean towards X; long ones end elsewhere than short ones",
        look="pins",
    ),
    "cross_angular": Scene(
        {"axis": "Y", "about": "Y", "by": "X"},
        {"kappa": 2e-7},
        _over("X"),
        "the bridge tilts where its carriage stands: rows along X bend",
    ),
    "overhang_sag": Scene(
        {"axis": "Y", "direction": "Z", "by": "Y"},
        {"sag": -0.05},
        _over("Y", ARM),
        "a horizontal arm along Y sags as it reaches out",
        machine=ARM,
    ),
    "gravity_flexure": Scene(
        {"axis": "A"},
        {"sag": 1e-4},
        Curve("A", (-90.0, 90.0), "A in degrees"),
        "a swivel head hangs from its line the more it lies",
        machine=HEAD,
        state={"A": 0.9},
    ),
    "load_bending": Scene(
        {"axis": "X", "signal": "load", "direction": "Z"},
        {"c0": -1.0e-5, "c1": 0.0, "c2": 1.0e-5},
        Curve(
            "X", (0.0, 700.0), "X in mm", {"500 kg": {"load": 500.0}, "1000 kg": {"load": 1000.0}}
        ),
        "the table bends under 1000 kg between its supports",
        state={"load": 1000.0},
    ),
    "scale_expansion": Scene(
        {"axis": "X", "signals": "T"},
        {"alpha": 16e-6},
        Curve("X", (0.0, 700.0), "X in mm", {"18 °C": {"T": 18.0}, "23 °C": {"T": 23.0}}),
        "the scale of X at 23 °C",
        state={"T": 23.0},
    ),
    "thermal_offset": Scene(
        {"direction": "Z", "signal": "T_spindle"},
        {"k": -0.003},
        Curve("T_spindle", (18.0, 35.0), "temperature of the spindle in °C"),
        "the whole volume is lower when the spindle has 35 °C",
        state={"T_spindle": 35.0},
    ),
    "thermal_bending": Scene(
        {"axis": "Z", "about": "Y", "signals": "T1,T2"},
        {"kappa": 8e-8},
        Curve("Z", (-500.0, 0.0), "Z in mm", {"T1 − T2 = 1 K": {"T1": 21.0}, "3 K": {"T1": 23.0}}),
        "the ram turns by more, the further it is out: with a probe of 150 mm",
        machine=CANTILEVER,
        state={"T1": 23.0, "tool": 150.0},
    ),
    "thermal_tilt": Scene(
        {"axis": "Y", "about": "X", "signals": "T1,T2"},
        {"k": 2e-5},
        Curve("T1", (18.0, 24.0), "T1 in °C, T2 at 20 °C"),
        "the bridge leans when one side is 3 K warmer",
        state={"T1": 23.0},
    ),
    "screw_heating": Scene(
        {"axis": "X", "signal": "T_screw"},
        {"k": 11.5e-6},
        Curve(
            "X",
            (0.0, 700.0),
            "X in mm",
            {"25 °C": {"T_screw": 25.0}, "35 °C": {"T_screw": 35.0}},
        ),
        "the screw grows away from its bearing at X = 0",
        state={"T_screw": 35.0},
    ),
    "warm_up": Scene(
        {"direction": "Z", "tau": 5400.0},
        {"A": 0.02},
        Curve("t", (0.0, 6.0), "hours after switch-on"),
        "where the volume is after six hours",
        state={"t": 21_600.0},
    ),
    "drift": Scene(
        {"direction": "X"},
        {"rate": 1e-6},
        Curve("t", (0.0, 6.0), "hours"),
        "where the volume is after six hours",
        state={"t": 21_600.0},
    ),
    "event": Scene(
        {"direction": "Y", "t0": 9000.0},
        {"step": 0.015},
        Curve("t", (0.0, 6.0), "hours"),
        "grey before, blue after",
        state={"t": 21_600.0},
    ),
    "feed_lag": Scene(
        {"axis": "X", "signal": "feed"},
        {"delay": -2e-4},
        Curve("feed", (0.0, 10_000.0), "feed in mm/min", _both("X", "moving")),
        "at 6000 mm/min: blue moving in +X, orange in −X",
        state={"X_dir": 1.0, "feed": 6000.0},
        versus={"X_dir": -1.0},
    ),
    "workpiece_expansion": Scene(
        {"signal": "T_part", "datum": "350,450,-180"},
        {"alpha": 11.5e-6},
        Curve("T_part", (15.0, 30.0), "temperature of the workpiece in °C"),
        "a workpiece of 30 °C shrinks to 20 °C about its datum (diagram: 450 mm from it)",
        state={"T_part": 30.0, "Y": 900.0},
    ),
    "dead_path": Scene(
        {"setups": "line"},
        {"length": 1000.0},
        Curve("t", (0.0, 3.0), "hours; the air warms by 3 K"),
        "the laser's zero wanders along its beam",
        look="line",
    ),
    "air_refraction": Scene(
        {"setups": "line"},
        {"share": 100.0},
        Curve(
            "X",
            (0.0, 700.0),
            "X in mm",
            {"17 °C": {"T_air": 17.0}, "25 °C": {"T_air": 25.0}},
        ),
        "the laser's readings at 25 °C, uncompensated",
        look="line",
        state={"T_air": 25.0},
    ),
    "cosine": Scene(
        {"setup": "line"},
        {"theta2": 4e-5},
        _over("X"),
        "the laser reads too little, in proportion to the way",
        look="line",
    ),
    "instrument_drift": Scene(
        {"setup": "line"},
        {"rate": 4e-6},
        Curve("t", (0.0, 1.5), "hours, from one end of the line to the other"),
        "a straightness line whose instrument creeps",
        look="line",
        u="Z",
    ),
    "stylus_bending": Scene(
        {"setups": "line"},
        {"bend": 0.002},
        Curve("tool", (40.0, 300.0), "length of the stylus in mm; touched across it"),
        "a sphere touched from all round: it comes out too wide across a long stylus",
        look="sphere",
        state={"tool": 200.0},
        u="X",
    ),
    "probe_lobing": Scene(
        {"setups": "line"},
        {"A": 0.002, "B": 0.0, "C": 0.0},
        Curve("around", (0.0, 360.0), "degrees about the stylus; touched across it"),
        "a sphere touched from all round: three lobes, of the probe's three seats",
        look="sphere",
        state={"tool": 100.0},
        u="X",
    ),
    "length_bias": Scene(
        {},
        {"bias": 0.02},
        Curve("distance", (200.0, 900.0), "distance in mm"),
        "each distance from the base is too long by the same",
        look="rays",
    ),
    "sensor_offset": Scene(
        {"signal": "T"},
        {"offset": 2.0},
        _over("X"),
        "a scale's sensor reads 2 K too much: what must be taken off the prediction",
        others=(("scale_expansion", {"axis": "X", "signals": "T"}, {"alpha": 16e-6}),),
        state={"T": 20.0},
    ),
    "sensor_gain": Scene(
        {"signal": "T"},
        {"gain": 0.1},
        _over("X"),
        "a scale's sensor shows 30 °C at 29.1: what must be taken off the prediction",
        others=(("scale_expansion", {"axis": "X", "signals": "T"}, {"alpha": 16e-6}),),
        state={"T": 30.0},
    ),
    "sensor_bend": Scene(
        {"signal": "T"},
        {"bend": 1e-3},
        _over("X"),
        "a scale's sensor shows 50.9 °C at 50: what must be taken off the prediction",
        others=(("scale_expansion", {"axis": "X", "signals": "T"}, {"alpha": 16e-6}),),
        state={"T": 50.9},
    ),
    "error_grid": Scene(
        {"file": "grid.json"},
        {},
        Curve("X", (0.0, 700.0), "X in mm", {"Y = 100": {"Y": 100.0}, "Y = 800": {"Y": 800.0}}),
        "a grid that was measured: no sum of what the axes do, and nobody knows why",
        tables=_some_grid(),
    ),
    "setup_zero": Scene(
        {"setup": "line"},
        {"zero": 0.01},
        _over("X"),
        "one line, zeroed elsewhere",
        look="line",
        u="Z",
    ),
    "setup_slope": Scene(
        {"setup": "line"},
        {"slope": 0.01},
        _over("X"),
        "one line whose straightedge was not parallel",
        look="line",
        u="Z",
    ),
    "setup_scale": Scene(
        {"setup": "line"},
        {"s": 1e-4},
        _over("X"),
        "a plate that is warmer than was stated",
        look="plate",
        u="X",
    ),
    "gauge_expansion": Scene(
        {"signal": "T_part", "setups": "line"},
        {"alpha": -7e-6},
        Curve("X", (0.0, 700.0), "X in mm", {"20 °C": {"T_part": 20.0}, "24 °C": {"T_part": 24.0}}),
        "a gauge of ceramic at 24 °C that was reckoned as one of steel",
        look="plate",
        u="X",
        state={"T_part": 24.0},
    ),
    "setup_frame": Scene(
        {"setup": "line"},
        {"x": 0.004, "y": 0.008, "z": 0.006, "a": 2e-5, "b": -3e-5, "c": 4e-5},
        _over("X"),
        "a plate that was set down a little elsewhere",
        look="plate",
        u="Z",
    ),
    "formula": Scene(
        {"channel": "E_ZX", "terms": "X*Y/700/900"},
        {"c1": 0.03},
        Curve("X", (0.0, 700.0), "X in mm", {"Y = 300": {"Y": 300.0}, "Y = 900": {"Y": 900.0}}),
        "whatever can be written: here dZ grows with X times Y",
    ),
}
"""Kind → its picture."""
