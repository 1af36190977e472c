"""ISO/TR 16907, 8.2: what each type can hold, checked against what tables of it would do."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.effects import ErrorMotion, make_effect
from abbe.compcore.effects.base import FUNCTIONAL_POINT, SPINDLE, WORKPIECE
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term
from abbe.compcore.tables.compensation_types import (
    TYPES,
    MotionDependence,
    error_motions,
    on_machine,
    types_needed,
)
from tests.support.compcore.catalogue import FIVE_AXIS, MILL, ROWS
from tests.support.compcore.machines import machine

BRIDGE = machine()
LINEAR = ["L-POS", "L-STR", "L-SQU", "L-ANG"]
ROTARY = ["R-POS", "R-RAX", "R-POR", "R-ANG"]


def test_all_types_of_the_report_are_there():
    assert set(TYPES) == {
        "L-POS", "R-POS", "L-STR", "L-SQU", "L-ANG", "R-ANG", "FOR", "L-VOL", "L-VOL+", "R-VOL+",
        "R-RAX", "R-POR", "R-VOL", "L-SPEC", "R-SPEC",
    }  # fmt: skip


def with_parts(*names: str) -> set[str]:
    """Types with all that they contain, directly or in one of their parts."""
    return {*names}.union(*(with_parts(part) for n in names for part in TYPES[n].contains))


def test_volumes_are_made_of_their_parts():
    assert with_parts("L-VOL") == {"L-VOL", *LINEAR}
    assert with_parts("R-VOL") == {"R-VOL", *ROTARY}
    assert with_parts("L-VOL+") == {"L-VOL+", "L-VOL", "FOR", *LINEAR}
    assert with_parts("R-VOL+", "L-POS") == {"R-VOL+", "R-VOL", "FOR", "L-POS", *ROTARY}
    assert TYPES["L-VOL+"].orientation
    assert not TYPES["L-VOL"].orientation
    assert [n for n, t in TYPES.items() if t.tool] == [
        "L-ANG", "L-VOL", "L-VOL+", "R-ANG", "R-VOL", "R-VOL+",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("channel", "positions", "held_by"),
    [
        (ErrorMotion("X", "X"), "X", {"L-POS"}),
        (ErrorMotion("X", "Y"), "X", {"L-STR"}),
        (ErrorMotion("X", "C"), "", {"L-STR", "L-SQU", "L-ANG"}),
        (ErrorMotion("X", "C"), "X", {"L-ANG"}),
        (ErrorMotion("X", "C"), "Z", set()),
        (ErrorMotion("X", "C"), "XZ", set()),
        (ErrorMotion("C", "C"), "C", {"R-POS"}),
        (ErrorMotion("C", "X"), "C", {"R-RAX"}),
        (ErrorMotion("C", "Z"), "C", {"R-RAX"}),
        (ErrorMotion("C", "A"), "C", {"R-ANG"}),
        (ErrorMotion("C", "X"), "", {"R-POR"}),
        (ErrorMotion("C", "A"), "", {"R-POR"}),
        (ErrorMotion("C", "C"), "", {"R-POR"}),
        (ErrorMotion(FUNCTIONAL_POINT, "Z"), "", {"L-POS"}),
        (ErrorMotion(FUNCTIONAL_POINT, "Z"), "X", set()),
        (ErrorMotion(SPINDLE, "Z"), "", {"L-POS"}),
        (ErrorMotion(SPINDLE, "A"), "", {"L-ANG"}),
        (ErrorMotion(WORKPIECE, "X"), "", set()),
    ],
)
def test_which_elementary_types_hold_an_error_motion(channel, positions, held_by):
    motion = MotionDependence(channel, tuple(positions))
    role = motion.role(FIVE_AXIS)
    elementary = [*LINEAR, *ROTARY, "FOR", "L-SPEC", "R-SPEC"]
    assert {t for t in elementary if role in TYPES[t].holds} == held_by
    whole = {r for t in with_parts("L-VOL", "R-VOL") for r in TYPES[t].holds}
    assert (role in whole) == bool(held_by)


def test_directions_belong_to_the_table_of_their_axis():
    backlash = MotionDependence(ErrorMotion("X", "X"), directions=("X",))
    assert backlash.role(BRIDGE) == "positioning"
    assert MotionDependence(ErrorMotion("X", "X"), directions=("Y",)).role(BRIDGE) == "beyond"


def test_a_head_that_turns_carries_its_spindle_s_errors_out_of_reach():
    head = machine("w b X Y Z B t")
    assert MotionDependence(ErrorMotion(SPINDLE, "Z")).role(head) == "beyond"
    assert MotionDependence(ErrorMotion(FUNCTIONAL_POINT, "Z")).role(head) == "positioning"


@pytest.mark.parametrize("code", ["w b Y X Z t", "w X' b Y Z t", "w Z' b X Y t"])
def test_a_constant_angle_is_slopes_of_straightness(code):
    """Why L-STR holds a squareness: without a tool, ω × Σ q_b·u_b has no part along any u_b."""
    m = machine(code)
    rng = np.random.default_rng(1)
    n = 40
    at = Conditions.at({a: rng.uniform(*m.axes[a].travel, n) for a in "XYZ"})
    positions = np.stack([at.positions[a] for a in "XYZ"], axis=1)
    for axis in "XYZ":
        for letter in "ABC":
            moved = Chain(m, at).influence(ErrorMotion(axis, letter))[0]
            slopes, *_ = np.linalg.lstsq(positions, moved, rcond=None)
            np.testing.assert_allclose(positions @ slopes, moved, atol=1e-9)
            np.testing.assert_allclose(np.diag(slopes), 0.0, atol=1e-12)


def model(m, *specs):
    terms = []
    for spec in specs:
        kind, *pairs = spec.split(" ")
        terms.append(Term(make_effect(kind, dict(p.split("=", 1) for p in pairs))))
    return Model(m, tuple(terms))


def test_a_rigid_machine_needs_l_vol():
    needed = types_needed(
        model(
            BRIDGE,
            "positioning axis=X",
            "straightness axis=X direction=Y",
            "angular axis=Y about=X",
            "squareness axes=Y,X",
        )
    )
    assert needed.types == ("L-VOL",)
    assert not needed.beyond
    assert {k: [str(m.error_motion) for m in v] for k, v in needed.by_type.items()} == {
        "L-POS": ["E_XX"],
        "L-STR": ["E_YX"],
        "L-ANG": ["E_AY"],
        "L-SQU": ["E_CY"],
    }


def test_what_is_beyond_is_said_with_its_cause():
    needed = types_needed(
        model(
            MILL,
            "positioning axis=X",
            "cross_angular axis=Y about=X by=Z",
            "thermal_bending axis=Z about=X signals=T_front,T_rear",
            "workpiece_expansion signal=T_part",
            "cosine setup=a",
        )
    )
    assert needed.types == ("L-POS", "L-ANG")
    assert [m.effect.split()[0] for m in needed.beyond] == [
        "cross_angular",
        *["workpiece_expansion"] * 3,
    ]
    (bending,) = needed.by_type["L-ANG"]
    assert bending.varies
    assert not needed.by_type["L-POS"][0].varies


def test_five_axes_need_both_volumes():
    needed = types_needed(
        model(
            FIVE_AXIS,
            "rotary_location axis=C",
            "rotary_positioning axis=C",
            "rotary_radial axis=C direction=X",
            "rotary_tilt axis=C direction=X",
            "positioning axis=X",
        )
    )
    assert needed.types == ("L-POS", "R-VOL")


@pytest.mark.parametrize("row", ROWS, ids=lambda r: r.label)
def test_every_effect_says_what_it_moves(row):
    effect = make_effect(row.kind, row.keys)
    motions = error_motions(row.machine, effect)
    if effect.scope == "instrument":
        assert motions == ()
        return
    assert motions
    for motion in motions:
        assert motion.role(row.machine)
        timed = row.kind in ("warm_up", "drift", "event")
        assert motion.varies == (timed or bool(effect.signals_needed()) or "t/" in effect.spec)


@pytest.mark.parametrize(
    ("code", "held"),
    [
        ("w b Y X Z t", ("L-VOL",)),
        ("w C' b X Y Z t", ("L-VOL", "R-VOL")),
        ("w C' A' b X Y Z t", ("L-VOL+", "R-VOL+")),
        ("w b X Y Z C B t", ("L-VOL+", "R-VOL+")),
        ("w C' b X Y Z B t", ("L-VOL+", "R-VOL+")),
    ],
)
def test_orientation_needs_two_rotary_axes(code, held):
    """ISO/TR 16907, 8.2.8: a grid on a three-axis machine is L-VOL."""
    structure = Structure.parse(code)
    axes = {a: Axis(a, (0.0, 100.0) if a in "XYZ" else (-1.0, 1.0)) for a in structure.axes}
    assert on_machine(["L-VOL+", "R-VOL+"], Machine("", structure, axes)) == held
    alone = on_machine(["FOR"], Machine("", structure, axes))
    assert bool(alone) is (len(structure.rotary) == 2)
