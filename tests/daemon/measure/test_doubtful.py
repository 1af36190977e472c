"""Readings that cannot be this machine's: what is said of them, and what is not."""

from __future__ import annotations

import pytest

from abbe.daemon.measure.following.doubtful import (
    RepeatedTargets,
    SameReadings,
    TinyReadings,
    known_fault,
    not_followed,
    other_unit,
)


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (-1.0, "the sign is turned"),
        (0.0, "it stands still"),
        (1e3, "µm that are taken for mm"),
        (1e-3, "m that are taken for mm"),
        (25.4, "mm that are taken for inches"),
        (1.0 / 25.4, "inches that are taken for mm"),
        (2.0, "counts every way twice"),
        (0.5, "counts half"),
        (0.3, "is it set up along this line"),
        (1.01, "is it set up along this line"),
    ],
)
def test_what_is_wrong_is_told_by_how_it_moves(factor: float, words: str) -> None:
    for moved in (50.0, -50.0):
        read = factor * moved + 0.004
        said = not_followed([read - moved], [moved])
        assert words in said
        assert f"by {read:+.4f} mm" in said


@pytest.mark.parametrize(
    ("configured", "reads", "words"),
    [
        ("um", 1.0, 'reads mm that are taken for µm: say unit = "mm" of its channel laser.length'),
        ("um", 1e-6, 'reads nm that are taken for µm: say unit = "nm"'),
        ("nm", 1e-3, 'reads µm that are taken for nm: say unit = "um"'),
        ("mm", -1e-3, "the sign is turned (sign = -1, or 1), and it reads µm"),
        ("m", 1.0, 'reads mm that are taken for m: say unit = "mm"'),
    ],
)
def test_the_unit_that_is_configured_is_named_and_the_right_one(
    configured: str, reads: float, words: str
) -> None:
    """`reads`: what one of the instrument's numbers is, mm."""
    factor = {"m": 1e3, "mm": 1.0, "um": 1e-3, "nm": 1e-6}[configured] / reads
    said = not_followed([factor * 2.0 - 2.0], [2.0], configured, "laser.length")
    assert words in said


def test_what_a_slow_or_reset_read_out_shows_is_no_known_fault() -> None:
    for factor in (0.0, 0.5):
        assert known_fault([factor * 2.0 - 2.0], [2.0])
        assert known_fault([factor * 2.0 - 2.0], [2.0], slow=True) == ""


def test_errors_that_differ_by_far_less_than_they_can_be_known() -> None:
    """An indicator of 0.5 µm that shows 8, 6, 11, 9 µm in mm, taken for µm."""
    tiny = TinyReadings()
    shown = [(8e-6,), (6e-6,), (11e-6,), (9e-6,), (7e-6,)]
    assert [tiny.add(v, 0.5e-3) for v in shown] == [False, False, False, True, False]
    tiny.forget()
    assert not any(tiny.add((1e3 * v[0],), 0.5e-3) for v in shown)
    tiny.forget()
    assert not any(tiny.add((0.0,), 0.5e-3) for _ in shown)


def test_a_distance_in_another_unit() -> None:
    assert other_unit([0.8, -12.0], [600.0, 700.0]) == ""  # the plan's place is approximate
    for read in (0.6, 600e3, 600.0 / 25.4):
        assert "in its own unit" in other_unit([read - 600.0], [600.0])


def visits(runs: int, targets: int) -> list[tuple[int, int]]:
    there = [(t, 1) for t in range(targets)]
    return [*there, *((t, -1) for t in reversed(range(targets)))] * runs


def changes(slips: dict[int, float], *, play: float = 0.03, drift: float = 0.0002) -> list[float]:
    """Largest changes of a line there and back twice, an error at each target, mm; `slips` at."""
    repeated, lost, found = RepeatedTargets(), 0.0, []
    for k, (t, sense) in enumerate(visits(2, 8)):
        lost += slips.get(k, 0.0)
        value = (0.1 * t - 0.02 * t * t + play * (sense < 0) + drift * k + lost,)
        found.append(repeated.change(t, sense, value))
        repeated.add(t, sense, value, float(k))
    return found


def test_a_lost_count_shows_at_once_where_targets_are_read_again() -> None:
    assert max(changes({})) < 0.001
    for at in (12, 18, 25):
        found = changes({at: 0.05})
        assert found[at] == pytest.approx(0.05, abs=0.001)
        assert max(found[:at]) < 0.001


@pytest.mark.parametrize("lost", [0, 3, 6])
def test_where_a_count_may_have_been_lost_is_told_on_the_way_back(lost: int) -> None:
    """Lost between two targets there, or between the same two back: it looks the same."""
    for where in (lost, 15 - lost - 1):
        repeated, off = RepeatedTargets(), 0.0
        for k, (t, sense) in enumerate(visits(1, 8)):
            off += 0.05 * (k == where + 1)
            value = (0.1 * t + off,)
            if repeated.change(t, sense, value) > 0.02:
                assert (k, repeated.perhaps_lost(t, sense, value)) == (15 - lost, [lost + 1.0])
            repeated.add(t, sense, value, float(k))


def test_targets_missed_on_the_way_back_leave_more_in_doubt() -> None:
    repeated = RepeatedTargets()
    for k, (t, sense) in enumerate([*((t, 1) for t in range(6)), (5, -1), (2, -1)]):
        off = 0.05 * (k > 3)
        if k == 7:
            assert repeated.change(t, sense, (off,)) == pytest.approx(0.05)
            assert repeated.perhaps_lost(t, sense, (off,)) == [3.0, 4.0, 5.0]
        repeated.add(t, sense, (off,), float(k))


def test_the_very_same_in_a_row_is_noticed_once() -> None:
    same = SameReadings()
    assert [same.add((0.1,)) for _ in range(8)].index(True) == 5
    assert not any(same.add((0.1,)) for _ in range(8))
    assert not any(same.add((0.1 * k,)) for k in range(20))
