"""Any table that a dialect can hold is written and read back as it was, whatever the machine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.machine.machine import Axis, Machine, own_component
from abbe.compcore.machine.structure import Structure
from abbe.compcore.tables.projection.curves.curve import Curve, fit_tables
from abbe.compcore.tables.table import Table, move
from abbe.drivers.controllers import controller_kinds, make_controller

OPTIONS = {
    "linuxcnc": [{}, {"type": "1"}, {"units": "inch"}],
    "fanuc": [{}, {"limit": "127", "bidirectional": "true", "format": "16i"}],
    "siemens-840d": [
        {},
        {"pitch": "cec", "encoder": "1", "first_table": "3"},
        {"products": "mirrored", "first_table": "2"},
    ],
    "twincat-isg": [{}, {"form": "axes"}],
    "csv": [
        {},
        {"holds": "moves", "sign": "compensation"},
        {"entries": "incremental", "reversal": "difference", "decimals": "4"},
        {"reversal": "single", "entries": "incremental"},
    ],
    "heidenhain-nd": [{}, {"decimals": "4"}],
    "heidenhain-tnc": [
        {},
        {"decimals": "5", "angle_decimals": "7", "axes": "X:X1,Y:Y2"},
        {"form": "kinematics", "kinematics_sign": "compensation"},
        {"form": "kinematics", "reference": "{axis}..{column}"},
    ],
    "pmac": [{}, {"counts": "X:2000,Y:5000", "owners": "32", "motors": "X:3,Y:4,Z:1,C:2"}],
    "cmm-map": [{}, {"decimals": "6", "signs": "R=-1,Z.L=-1"}],
}
CASES = [
    (name, options)
    for name in controller_kinds()
    if name not in ("grid-csv", "aerotech-2d")
    for options in OPTIONS.get(name, [{}])
]

machines = st.fixed_dictionaries(
    {
        "code": st.sampled_from(["w b Y X Z t", "w X' b Y Z t", "w C' b X Y Z t"]),
        "low": st.tuples(*[st.integers(-6000, 2000)] * 3),
        "length": st.tuples(*[st.integers(500, 20_000)] * 3),
        "seed": st.integers(0, 10_000),
        "size": st.sampled_from([1e-6, 3e-4, 0.02]),
        "points": st.integers(3, 25),
    }
)


def made(drawn: dict) -> Machine:
    structure = Structure.parse(drawn["code"])
    axes = {
        name: Axis(name, (low * 0.1, (low + length) * 0.1))
        for name, low, length in zip("XYZ", drawn["low"], drawn["length"], strict=True)
    }
    if "C" in structure.axes:
        axes["C"] = Axis("C", (-2.0, 3.0))
    return Machine("random", structure, axes)


def wavy(rng: np.random.Generator, positions: np.ndarray, size: float) -> np.ndarray:
    """Upwards and downwards, (2, m)."""
    x = np.linspace(0.0, 1.0, len(positions))
    waves = rng.normal(size=(2, 5)) @ np.cos(np.outer(np.arange(5), np.pi * x))
    return size * np.stack([waves[0], waves[0] + 0.3 * waves[1]])


def curves(controller, drawn: dict) -> list[Curve]:
    """One curve for every table that the dialect can hold on this machine."""
    rng = np.random.default_rng(drawn["seed"])
    owner = controller.machine
    found = []
    for holds in controller.capability.holds:
        for axis in owner.structure.axes:
            if holds.inputs is not None and axis not in holds.inputs:
                continue
            allowed = holds.outputs or owner.structure.axes
            if holds.form == "axis" and axis not in allowed:
                continue
            positions = np.linspace(*owner.axis(axis).travel, 61)
            if holds.form == "motions":
                outputs = [ErrorMotion(axis, c) for c in "XYZABC"]
            elif holds.form == "axis" and owner.axis(axis).rotary:
                outputs = [ErrorMotion(axis, own_component(axis))]
            elif holds.form == "axis":
                outputs = [move(axis)]
            else:
                outputs = [move(o) for o in "XYZ" if o != axis and o in allowed][:1]
            for output in outputs:
                size = drawn["size"] * (1e-2 if output.rotation else 1.0)
                values = wavy(rng, positions, size)
                curve = Curve(holds, output, axis, positions, values)
                if holds.form == "product":
                    lever = next(a for a in "XYZ" if a != axis)
                    low, high = owner.axis(lever).travel
                    half, part = 0.5 * (high - low), rng.uniform(0.2, 0.8)
                    about = (lever, round(low + part * (high - low), 3))
                    curve = replace(curve, values=values / half, reach=half, lever=about)
                found.append(curve)
    return found


IDS = [f"{name}-{i}" for i, (name, _) in enumerate(CASES)]


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("name", "options"), CASES, ids=IDS)
@settings(max_examples=6)
@given(drawn=machines)
def test_what_is_written_is_read_back(name, options, drawn):
    owner = made(drawn)
    options = dict(options)
    if "motors" in options and "C" not in owner.axes:
        options["motors"] = "X:3,Y:4,Z:1"
    controller = make_controller(name, owner, options)
    capability = controller.capability
    wanted = curves(controller, drawn)
    if capability.per_output:
        wanted = list({c.output: c for c in wanted}.values())
    if any(h.per_output for h in capability.holds):
        wanted = list({(c.holds.form, c.output): c for c in wanted}.values())
    wanted = wanted[: capability.most_tables]
    tables, _ = fit_tables(wanted, capability, drawn["size"] / drawn["points"])
    tables = controller.adapted(tables)
    files = controller.write(tables)  # checks itself by reading back
    assert files
    assert all(text.isascii() or "µ" in text for text in files.values())
    found = controller.read(files)
    for table in tables:
        (mine,) = [t for t in found if t.same_number(table)]
        assert mine.difference(table) <= 1e-9 * max(1e-3, table.largest())
        assert mine.nodes[0] == pytest.approx(table.nodes[0], abs=1e-9)
    controller.check(tables, files)


@settings(max_examples=15)
@given(
    st.tuples(*[st.integers(2, 5)] * 3),
    st.integers(0, 9999),
    st.sampled_from([{}, {"sign": "error", "decimals": "4"}]),
)
def test_grids_are_read_back(shape, seed, options):
    rng = np.random.default_rng(seed)
    structure = Structure.parse("w C' b X Y Z t")
    axes = {a: Axis(a, (-400.0, 900.0)) for a in "XYZ"} | {"C": Axis("C", (-1.5, 1.5))}
    controller = make_controller("grid-csv", Machine("", structure, axes), options)
    (holds,) = controller.capability.holds
    tables = []
    for inputs, sizes in ((("X", "Y", "Z"), shape), (("C",), shape[:1])):
        nodes = tuple(
            np.round(np.cumsum(rng.integers(1, 9000, n)), 0) * (1e-2 if a in "XYZ" else 1e-3)
            for a, n in zip(inputs, sizes, strict=True)
        )
        nodes = tuple(n if a in "XYZ" else np.round(n, 3) * np.pi / 180.0
                      for a, n in zip(inputs, nodes, strict=True))  # fmt: skip
        for c in "XYZABC":
            step = holds.step(c in "ABC")
            values = rng.integers(-5000, 5000, sizes) * step
            tables.append(Table(move(c), inputs, nodes, values))
    found = controller.read(controller.write(tables))
    for table in tables:
        (mine,) = [t for t in found if t.same_number(table)]
        assert mine.forward == pytest.approx(table.forward, abs=1e-12)


@settings(max_examples=15)
@given(
    st.tuples(st.integers(2, 6), st.integers(2, 6)),
    st.tuples(st.integers(-900, 900), st.integers(-900, 900)),
    st.integers(0, 9999),
    st.sampled_from(["X,Y", "X,Y,Z"]),
)
def test_planes_are_read_back(shape, start, seed, outputs):
    rng = np.random.default_rng(seed)
    structure = Structure.parse("w b X Y Z t")
    owner = Machine("", structure, {a: Axis(a, (-900.0, 900.0)) for a in "XYZ"})
    controller = make_controller("aerotech-2d", owner, {"outputs": outputs})
    nodes = tuple(s + 12.5 * np.arange(n) for s, n in zip(start, shape, strict=True))
    tables = [
        Table(move(c), ("Y", "X"), nodes, rng.integers(-9000, 9000, shape) * 1e-6)
        for c in outputs.split(",")
    ]
    found = controller.read(controller.write(tables))
    assert len(found) == len(tables)
    for table, mine in zip(tables, found, strict=True):
        assert mine.difference(table) < 1e-12


def test_a_file_that_reads_back_differently_is_not_let_out():
    """The check that every write ends with."""
    from abbe.compcore.errors import AbbeError

    structure = Structure.parse("w b X Y Z t")
    owner = Machine("", structure, {a: Axis(a, (0.0, 100.0)) for a in "XYZ"})
    controller = make_controller("linuxcnc", owner)
    table = Table(move("X"), ("X",), (np.array([0.0, 100.0]),), np.array([0.0, 0.010]))
    files = controller.write([table])
    with pytest.raises(AbbeError, match=r"E_XX in the files differs .* by 2 µm"):
        controller.check([table], {"x.comp": files["x.comp"].replace("100.010000", "100.012000")})
    with pytest.raises(AbbeError, match="0 times"):
        controller.check([table], {"y.comp": files["x.comp"]})
    with pytest.raises(AbbeError, match="more than was to be written"):
        controller.check([table], {**files, "y.comp": files["x.comp"]})
    finer = Table(move("X"), ("X",), (np.array([0.0, 100.0]),), np.array([0.0, 1.23456789e-3]))
    with pytest.raises(AbbeError, match="differs"):
        controller.write([finer])
