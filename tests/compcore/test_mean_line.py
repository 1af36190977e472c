"""The line of means: drawn of what goes along an axis, not of what other joints do."""

from __future__ import annotations

import numpy as np

from abbe.compcore.figures.means import mean_line

PARTS = 12


def _drawn(x: np.ndarray, y: np.ndarray) -> list[tuple[float, float]]:
    part = np.minimum((x * PARTS).astype(np.int64), PARTS - 1)
    return mean_line(x, y, part, PARTS)


def test_random_poses_of_an_arm_make_no_zigzag() -> None:
    rng = np.random.default_rng(5)
    drawn = 0
    for _ in range(200):
        joint, other = rng.uniform(size=(2, 120))
        drawn += bool(_drawn(joint, np.sin(2.0 * np.pi * other)))
    assert drawn <= 4


def test_what_goes_with_the_joint_is_drawn() -> None:
    rng = np.random.default_rng(5)
    joint, other = rng.uniform(size=(2, 120))
    line = _drawn(joint, 2.0 * np.sin(2.0 * np.pi * joint) + np.sin(2.0 * np.pi * other))
    assert len(line) == PARTS
    assert max(v for _, v in line) > 1.0 > -1.0 > min(v for _, v in line)


def test_lines_at_one_place_do_not_vouch_for_poses_elsewhere() -> None:
    """A joint that stands at one angle for 270 quiet rows, and anywhere for 120 others."""
    rng = np.random.default_rng(5)
    drawn = 0
    for _ in range(200):
        joint = np.r_[np.full(270, 0.01), rng.uniform(size=120)]
        y = np.r_[rng.normal(size=270), 20.0 * np.sin(2.0 * np.pi * rng.uniform(size=120))]
        drawn += len(_drawn(joint, y)) > 2
    assert drawn <= 10


def test_play_is_a_level() -> None:
    """A side that lies 2 µm off everywhere is seen, and does not go up and down."""
    rng = np.random.default_rng(5)
    line = _drawn(rng.uniform(size=120), 2.0 + rng.normal(size=120))
    assert len(line) == 2
    assert line[0][1] == line[1][1]
    assert abs(line[0][1] - 2.0) < 0.3


def test_a_line_read_once_is_joined() -> None:
    x = (np.arange(PARTS) + 0.5) / PARTS
    assert [v for _, v in _drawn(x, x**2)] == (x**2).tolist()
