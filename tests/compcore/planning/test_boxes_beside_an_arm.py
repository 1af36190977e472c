"""Keep-out boxes beside a SCARA robot: its tip goes on arcs, by closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.start_model import StartOptions, start_model
from abbe.compcore.planning.envelope import KeepOut, WorkingSpace
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.motion import steps_of
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.rotations import turns
from abbe.compcore.planning.targets import SurveyTask
from abbe.compcore.planning.way_of_the_tip import way_of_the_tip

LINK, TOOL = 325.0, (550.0, 0.0, -50.0)
SCARA = Machine(
    "scara", Structure.parse("w b C C2 Z t"),
    {"C": Axis("C", (-2.0, 2.0)), "C2": Axis("C2", (-2.4, 2.4), location=(LINK, 0.0, 0.0)),
     "Z": Axis("Z", (-200.0, 0.0))},
)  # fmt: skip


def tip(c: np.ndarray, c2: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Of two links in a plane, (n, 3) mm."""
    fore = TOOL[0] - LINK
    x = LINK * np.cos(c) + fore * np.cos(c + c2)
    y = LINK * np.sin(c) + fore * np.sin(c + c2)
    return np.stack([x, y, TOOL[2] + z], axis=1)


def turning(axis: str, *boxes: KeepOut) -> tuple[WorkingSpace, PlannedSetup]:
    """A joint read over its travel by a rotary calibrator."""
    space = WorkingSpace(boxes, 10.0)
    model = start_model(SCARA, StartOptions(play=True, rotary_motions=True))
    task = SurveyTask(model, tools={"P": TOOL}, space=space)
    found = next(s for s in turns(task, INSTRUMENTS["rotary-calibrator"]) if s.axis == axis)
    return space, replace(found, name="a")


def nearest(setup: PlannedSetup, box: KeepOut) -> float:
    """mm from the tip's arcs to a box; 0: inside."""
    q = {
        a: np.interp(np.linspace(0, setup.count - 1, 20001), np.arange(setup.count), at)
        for a, at in setup.targets.items()
    }
    at = tip(q["C"], q["C2"], q["Z"])
    out = np.maximum(np.maximum(np.asarray(box.low) - at, at - np.asarray(box.high)), 0.0)
    return float(np.linalg.norm(out, axis=1).min())


def test_the_way_is_the_arc_and_ends_at_the_targets() -> None:
    rng = np.random.default_rng(7)
    q = {"C": rng.uniform(-2, 2, 6), "C2": rng.uniform(-2, 2, 6), "Z": rng.uniform(-200, 0, 6)}
    way = way_of_the_tip(SCARA, q, TOOL)
    ends = tip(q["C"], q["C2"], q["Z"])
    at = [int(np.argmin(np.linalg.norm(way - e, axis=1))) for e in ends]
    np.testing.assert_allclose(way[at], ends, atol=1e-9)
    assert at == sorted(at)
    # both joints turn by up to 1° between two places: no chord is farther than 0.2 mm from its arc
    first = np.linspace(0.0, 1.0, 4001)[:, None]
    on_arc = tip(*(q[a][0] + first[:, 0] * (q[a][1] - q[a][0]) for a in ("C", "C2", "Z")))
    middles = 0.5 * (way[: at[1]] + way[1 : at[1] + 1])
    off = np.linalg.norm(middles[:, None] - on_arc[None], axis=2).min(axis=1)
    assert off.max() < 0.2


@pytest.mark.parametrize("axis", ["C", "C2"])
def test_a_joint_turns_no_tip_into_a_box(axis: str) -> None:
    """Where C ends, more than the whole offset away from the tip with all joints at 0."""
    _, plain = turning(axis)
    q = {a: float(at[len(at) // 20]) for a, at in plain.targets.items()}
    at = tip(*(np.array([q[a]]) for a in ("C", "C2", "Z")))[0]
    box = KeepOut(tuple((at - 15.0).tolist()), tuple((at + 15.0).tolist()))
    space, setup = turning(axis, box)
    assert nearest(setup, box) == 0.0
    assert space.hindrance(SCARA, setup) == "the tool would enter keep-out box 1"
    with pytest.raises(InputError, match="keep-out box 1"):
        steps_of(SCARA, [setup], space)


def test_a_box_between_two_targets_is_seen() -> None:
    """The chord passes it, and it is far from where the tip is with all joints at 0."""
    box = KeepOut((24.0, 530.0, -400.0), (54.0, 565.0, 10.0))
    space = WorkingSpace((box,), 0.0, beyond=0.0)
    q = {"C": np.array([-1.9, 1.9]), "C2": np.zeros(2), "Z": np.full(2, -50.0)}
    assert tip(q["C"], q["C2"], q["Z"])[:, 0].max() < box.low[0] - 180.0
    assert space.entered(SCARA, q, TOOL, turns=True) == 1


def test_a_free_way_is_free() -> None:
    """The whole tool's offset, 552 mm, is no length that swings: the forearm has 225."""
    box = KeepOut((950.0, -25.0, -400.0), (1000.0, 25.0, 10.0))
    space, setup = turning("C2", box)
    assert nearest(setup, box) >= 400.0
    assert space.hindrance(SCARA, setup) is None
    assert steps_of(SCARA, [setup], space)
