"""Where a stylus reaches a sphere on the table: leaning, the table's edge, travels; by hand."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.planning.envelope import WorkingSpace
from abbe.compcore.planning.probing.room import hindered, room_about

LINE = (300.0, 250.0, -350.0)
TOOL = (0.0, 0.0, -150.0)


def trunnion() -> Machine:
    axes = {
        "X": Axis("X", (0.0, 600.0)),
        "Y": Axis("Y", (-200.0, 700.0)),
        "Z": Axis("Z", (-400.0, 300.0)),
        "A": Axis("A", (-2.1, 2.1), location=LINE),
        "C": Axis("C", (-3.2, 3.2), location=LINE),
    }
    return Machine("", Structure.parse("w C' A' b X Y Z t"), axes)


def poses(up: float, *tilts: float) -> dict[str, np.ndarray]:
    """The tip in a sphere over the middle of the table, worked out by hand: A' tilts it to +Y."""
    a = np.radians(tilts)
    n = len(tilts)
    return {
        "X": np.full(n, LINE[0]),
        "Y": LINE[1] + up * np.sin(a),
        "Z": LINE[2] + up * np.cos(a) - TOOL[2],
        "A": a,
        "C": np.zeros(n),
    }


def looked_at(up: float, table: float, radius: float, *tilts: float) -> tuple[list[bool], str]:
    back = ("Z", 299.0)
    found, why = hindered(trunnion(), poses(up, *tilts), TOOL, back, table, radius)
    return found.tolist(), why


def test_without_the_tables_size_nothing_leans_by_more_than_sixty_degrees() -> None:
    found, why = looked_at(100.0, 0.0, 40.0, -90.0, -61.0, -59.0, 0.0, 59.0)
    assert found == [True, True, False, False, False]
    assert "90°, more than 60° (how large is the table? table_radius)" in why


@pytest.mark.parametrize(
    ("up", "table", "free"),
    # upright beside a table on its edge, 40 mm of spindle and 30 mm about the sphere
    [(71.0, 200.0, True), (69.0, 200.0, False), (60.0, 20.0, True)],
)
def test_a_spindle_stays_clear_of_a_table_on_its_edge(up: float, table: float, free: bool) -> None:
    found, why = looked_at(up, table, 40.0, -90.0, 90.0)
    assert found == [not free] * 2
    assert why == ("" if free else "tool or spindle would touch the table")


def test_drawn_back_it_stays_clear_of_the_rim_that_comes_up() -> None:
    """The rim of 600 mm rises to 250 where the tip still hangs over the middle, at 149."""
    assert looked_at(100.0, 600.0, 40.0, 0.0, -90.0)[0] == [False, True]
    assert looked_at(100.0, 450.0, 40.0, 0.0, -90.0)[0] == [False, False]


def test_no_stylus_comes_round_a_post_that_hangs() -> None:
    found, why = looked_at(300.0, 20.0, 5.0, -115.0)
    assert found == [True]
    assert "115°, more than 110°" in why


def test_travels_have_to_leave_room_about_the_sphere() -> None:
    at = poses(100.0, 0.0, -80.0)
    assert room_about(trunnion(), at, TOOL).all()
    near = at | {"X": np.array([29.0, 31.0])}
    assert room_about(trunnion(), near, TOOL).tolist() == [False, True]


def test_a_plan_says_why_a_pose_is_none() -> None:
    hindered_, why = WorkingSpace(table=200.0, radius=90.0).cannot_touch(
        trunnion(), poses(100.0, -90.0), TOOL
    )
    assert hindered_.all()
    assert "would touch the table" in why
