"""A campaign in which each line is measured once, as ISO 230-1 has it: no other foretells any."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.stepwise import Course, to_the_verdict
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging import trial

F64 = NDArray[np.float64]
Errors = Callable[[F64], tuple[F64, F64]]

BRIDGE = """format = "abbe-model/1"
[machine]
name = "bridge"
structure = "w b Y X Z t"
[machine.axes.X]
travel = [0.0, 700.0]
[machine.axes.Y]
travel = [0.0, 900.0]
[machine.axes.Z]
travel = [-360.0, 0.0]
"""
TRAVELS = {"X": (0.0, 700.0), "Y": (0.0, 900.0), "Z": (-360.0, 0.0)}
MIDDLE = np.array([350.0, 450.0, -180.0])
TOOL = np.array([0.0, 0.0, -100.0])
NOISE = 0.4
"""Of a reading, µm or µrad."""


def bridge(q: F64) -> tuple[F64, F64]:
    """Error of the functional point, mm, and rotation, rad, by three carriages one on another."""
    x, y, z = q
    of_y = np.array(
        [3e-3 * np.sin(y / 280), 2e-5 * y + 4e-3 * np.sin(y / 210), 3e-3 * np.cos(y / 250)]
    )
    turn_y = 1e-6 * np.array([0.0, -12.0 * np.cos(y / 260), 0.0])
    of_x = np.array(
        [3e-3 * np.cos(x / 150) - 1.5e-5 * x, 3e-3 * np.sin(x / 170), 2e-3 * np.cos(x / 220)]
    )
    turn_x = 1e-6 * np.array([10.0 * np.cos(x / 200), 0.0, 0.0])
    of_z = np.array(
        [2e-3 * np.sin(z / 90), 2e-3 * np.cos(z / 100), 1e-5 * z + 2e-3 * np.sin(z / 80)]
    )
    point = (
        of_y
        + of_x
        + of_z
        + np.cross(turn_y, TOOL + np.array([x, 0.0, z]))
        + np.cross(turn_x, TOOL + np.array([0.0, 0.0, z]))
    )
    return point, turn_y + turn_x


def sound(q: F64) -> tuple[F64, F64]:
    """A machine without errors."""
    return np.zeros(3), np.zeros(3)


def each_once(errors: Errors, model: Model, seed: int, off: F64 | float = 0.0) -> Campaign:
    """Positioning, both straightnesses and two rolls: 11 lines, each there and back."""
    rng = np.random.default_rng(seed)
    lines = [(a, d, "displacement") for a in "XYZ" for d in "XYZ"]
    lines += [("X", "X", "rotation"), ("Y", "Y", "rotation")]
    head, rows, time = ['# format = "abbe-campaign/1"'], [], 0.0
    for axis, direction, kind in lines:
        name = f"{axis}{direction}{kind[0]}"
        free = '["zero"]' if axis == direction else '["zero", "slope"]'
        head += [f"# [setups.{name}]", f"# free = {free}"]
        zero = rng.normal(0.0, 30.0)
        targets = np.linspace(*TRAVELS[axis], 15)
        for place in (*targets, *targets[::-1]):
            time += 12.0
            q = MIDDLE + off
            q["XYZ".index(axis)] = place
            point, turn = errors(q)
            shown = 1e3 * point if kind == "displacement" else 1e6 * turn
            value = shown["XYZ".index(direction)] + zero + rng.normal(0.0, NOISE)
            u = ",".join("1" if direction == d else "0" for d in "XYZ")
            at = ",".join(f"{v:g}" for v in (*q, *TOOL))
            rows.append(f"{time:g},{name},{kind},{at},{u},{value:.3f},{NOISE:g}")
    columns = "time,setup,kind,X,Y,Z,tool_x,tool_y,tool_z,ux,uy,uz,value,sd"
    return trial.as_campaign("\n".join([*head, columns, *rows]) + "\n", model)


def course_of(errors: Errors, seed: int) -> tuple[Model, Course]:
    model = parse_model(TomlSource(BRIDGE))
    return model, to_the_verdict(model, each_once(errors, model, seed))


def rms(values: F64) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_every_motion_is_found_though_one_line_alone_shows_it() -> None:
    """One motion of eleven was found where whole set-ups only were left out, and then nothing."""
    model, course = course_of(bridge, 1)
    assert course.diagnosis.verdict == "complete"
    found = {e.spec for e in course.last.result.model.effects}
    assert {f"positioning axis={a}" for a in "XYZ"} <= found
    assert {"angular axis=X about=X", "angular axis=Y about=Y"} <= found
    seen = {f"straightness axis={a} direction={d}" for a, d in ("XY", "YX", "YZ", "ZX")}
    assert seen <= found, "what is left is within the noise"
    assert not {s.split()[0] for s in found} & {
        "cyclic",
        "cross_angular",
        "overhang_sag",
        "formula",
    }
    # other lines, 60 mm beside those that were fitted
    others = each_once(bridge, model, 2, np.array([60.0, -60.0, 40.0]))
    before = rms(compare(model, others).residual)
    assert rms(compare(course.last.result.model, others).residual) < before / 4.0


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_nothing_is_found_where_nothing_is(seed: int) -> None:
    _, course = course_of(sound, seed)
    assert course.diagnosis.verdict == "complete"
    assert course.last.result.model.effects == ()
