"""The guard keeps its promises for any sequence of inputs, and does exactly what its page says."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.daemon.guard import ALL, Correction, Guard, GuardLimits, GuardState, Vec3

LIMITS = GuardLimits(
    max_correction=(0.05, 0.08, 0.1),
    max_norm=0.11,
    max_rate=0.2,
    hold=1.0,
    ramp=2.0,
    longest_step=0.2,
)
ROOMY = GuardLimits(max_correction=(1.0, 1.0, 1.0), max_norm=2.0, max_rate=1.0, hold=1.0, ramp=2.0)
C: Vec3 = (0.02, -0.03, 0.01)
TINY = 1e-12

number = st.one_of(
    st.floats(-0.2, 0.2), st.floats(allow_nan=True, allow_infinity=True), st.just(math.nan)
)
computed = st.one_of(st.none(), st.tuples(number, number, number))
step = st.tuples(
    st.one_of(st.just(0.01), st.floats(0.0, 5.0)), computed, st.integers(0, ALL), st.booleans()
)

TURNING = GuardLimits(
    max_correction=LIMITS.max_correction,
    max_norm=LIMITS.max_norm,
    max_rate=LIMITS.max_rate,
    hold=LIMITS.hold,
    ramp=LIMITS.ramp,
    longest_step=LIMITS.longest_step,
    turning=("B", "C"),
    max_turn=(2e-4, 4e-4),
    max_turn_rate=5e-4,
)
P: Correction = (0.02, -0.03, 0.01, 1e-4, -3e-4)
turn = st.one_of(
    st.floats(-1e-3, 1e-3), st.floats(allow_nan=True, allow_infinity=True), st.just(math.nan)
)
poses = st.one_of(st.none(), st.tuples(number, number, number, turn, turn))
action = st.sampled_from(["", "", "", "release", "change"])
any_step = st.one_of(
    st.tuples(
        st.just(limits),
        st.lists(
            st.tuples(
                st.one_of(st.just(0.01), st.floats(0.0, 5.0)),
                values,
                st.integers(0, (1 << len(limits.directions)) - 1),
                action,
            ),
            max_size=60,
        ),
    )
    for limits, values in ((LIMITS, computed), (TURNING, poses))
)


def do(guard: Guard, what: str) -> None:
    if what == "release":
        guard.release()
    elif what == "change":
        guard.change()


@given(any_step)
def test_no_sequence_of_inputs_breaks_a_bound(
    case: tuple[GuardLimits, list[tuple[float, Correction | None, int, str]]],
) -> None:
    """X, Y, Z alone, and with two rotary axes; with changes by a person in between."""
    limits, steps = case
    guard = Guard(limits)
    now, before = 100.0, (0.0,) * len(limits.directions)
    for dt, value, faulty, what in steps:
        now += dt
        do(guard, what)
        decision = guard.step(now, value, faulty)
        after = decision.correction
        assert all(map(math.isfinite, after))
        for x, most in zip(after, limits.most, strict=True):
            assert abs(x) <= most + TINY
        assert math.hypot(*after[:3]) <= limits.max_norm + TINY
        span = min(dt, limits.longest_step)
        for a, b, rate in zip(after, before, limits.rates, strict=True):
            assert abs(a - b) <= rate * span + TINY
        if limits.turning:
            assert len(set(decision.states)) == 1
        before = after


def test_with_rotary_axes_all_directions_go_together() -> None:
    """A turn and what takes its move of the tip back: by one share, on the way in and out."""
    guard = Guard(TURNING)
    now = 0.0
    shares = []
    for value, faulty in [(P, 0)] * 300 + [(P, 0b10000)] * 400 + [(P, 0)] * 300 + [(None, 0)] * 400:
        now += 0.01
        decision = guard.step(now, value, faulty)
        parts = [a / p for a, p in zip(decision.correction, P, strict=True)]
        assert parts == pytest.approx([parts[0]] * 5, abs=1e-9)
        assert len(set(decision.states)) == 1
        shares.append(parts[0])
    assert shares[299] == shares[999] == 1.0
    assert shares[699] == shares[-1] == 0.0
    assert 0.4 < shares[500] < 0.6


def test_a_turn_that_is_too_large_or_too_fast_takes_the_tip_along() -> None:
    guard = Guard(TURNING)
    now = run(guard, 0.0, 3.0, P)
    large = (*P[:3], 8e-4, -3e-4)
    now = run(guard, now, 0.5, large)
    decision = guard.step(now + 0.01, large)
    assert decision.size_limited
    assert decision.limited == 0b11111
    assert [a / b for a, b in zip(decision.correction, large, strict=True)] == pytest.approx(
        [0.25] * 5
    )
    guard = Guard(TURNING)
    now = run(guard, 0.0, 3.0, P)
    there = (0.021, -0.031, 0.011, 1.5e-4, -1e-4)
    decision = guard.step(now + 0.1, there)
    parts = [(a - p) / (t - p) for a, p, t in zip(decision.correction, P, there, strict=True)]
    assert parts == pytest.approx([0.25] * 5)  # C may turn by 5e-5 of 2e-4
    assert decision.rate_limited


@pytest.mark.parametrize("limits", [LIMITS, TURNING])
def test_what_a_person_changes_is_no_step(limits: GuardLimits) -> None:
    before, after = P[: len(limits.directions)], tuple(-0.5 * p for p in P)
    after = after[: len(limits.directions)]
    guard = Guard(limits)
    now = run(guard, 0.0, 3.0, before)
    guard.change()
    began = now
    decision = guard.step(now + 0.01, after)
    assert decision.correction == pytest.approx(before, abs=1e-15)
    assert set(decision.states) == {GuardState.RISING}
    assert not decision.compensating
    now = run(guard, now + 0.01, limits.ramp / 2, after)
    half = guard.step(now, after).correction
    left = 1.0 - (now - began - 0.01) / limits.ramp
    assert half == pytest.approx(
        [a + left * (b - a) for a, b in zip(after, before, strict=True)], abs=1e-12
    )
    guard.change()  # back in the middle of it
    again = guard.step(now + 0.01, before).correction
    assert again == pytest.approx(half, abs=2e-4 * limits.ramp)
    now = run(guard, now + 0.01, limits.ramp + 0.05, before)
    decision = guard.step(now, before)
    assert decision.correction == before
    assert decision.compensating


def test_a_change_that_concerns_some_directions_leaves_the_others_alone() -> None:
    guard = Guard(LIMITS)
    now = run(guard, 0.0, 3.0, C)
    guard.change()
    decision = guard.step(now + 0.01, (0.0, C[1], C[2]))
    assert [s.value for s in decision.states] == ["rising", "active", "active"]
    assert decision.correction == pytest.approx(C, abs=1e-15)


writing = st.tuples(
    st.floats(0.001, 0.1),  # s from the end of one write to the next step
    st.floats(0.0, 0.1),  # s that writing takes
    st.floats(0.0, 1.0),  # share of that after which the controller has it
    st.tuples(*[st.floats(-0.3, 0.3)] * 3),
    st.integers(0, ALL),
)


@given(st.lists(writing, max_size=60))
def test_the_rate_holds_where_the_controller_takes_it(
    steps: list[tuple[float, float, float, Vec3, int]],
) -> None:
    """However late within its write the controller takes one correction, and how soon the next."""
    guard = Guard(LIMITS)
    now, before, since = 100.0, (0.0, 0.0, 0.0), -math.inf
    for wait, takes, share, value, faulty in steps:
        now += wait
        after = guard.step(now, value, faulty).correction
        taken = now + share * takes
        now += takes
        guard.taken(now)
        reach = LIMITS.max_rate * min(taken - since, LIMITS.longest_step)
        assert all(abs(a - b) <= reach + TINY for a, b in zip(after, before, strict=True))
        before, since = after, taken


@given(
    st.lists(st.tuples(st.floats(0.001, 0.1), st.tuples(*[st.floats(-0.3, 0.3)] * 3)), min_size=5),
    st.integers(0, 2),
    st.data(),
)
def test_a_missing_signal_leaves_the_other_directions_as_they_were(
    steps: list[tuple[float, Vec3]], lost: int, data: st.DataObject
) -> None:
    """Side by side with a guard to which nothing happens: equal to the last bit."""
    cut = data.draw(st.integers(0, len(steps)))
    sound, hurt = Guard(ROOMY), Guard(ROOMY)
    now = 0.0
    for i, (dt, value) in enumerate(steps):
        now += dt
        expected = sound.step(now, value)
        found = hurt.step(now, value, 1 << lost if i >= cut else 0)
        for d in range(3):
            if d != lost:
                assert found.correction[d] == expected.correction[d]
                assert found.states[d] is expected.states[d]


@given(
    any_step,
    st.tuples(*[st.floats(-0.045, 0.045)] * 3, st.floats(-2e-4, 2e-4), st.floats(-4e-4, 4e-4)),
)
def test_whatever_happened_it_comes_down_to_zero_in_the_stated_time_and_returns(
    case: tuple[GuardLimits, list[tuple[float, Correction | None, int, str]]], value: Correction
) -> None:
    limits, steps = case
    count = len(limits.directions)
    value = value[:count]
    guard = Guard(limits)
    now = 0.0
    for dt, earlier, faulty, what in steps:
        now += dt
        if what == "change":
            guard.change()
        guard.step(now, earlier, faulty)
    start = now
    while now < start + limits.hold + limits.ramp + 0.05:
        now += 0.05
        last = guard.step(now, None)
    if limits.turning:  # all together, with what the slowest of them needs
        while now < start + limits.hold + limits.ramp + 1.05:
            now += 0.05
            last = guard.step(now, None)
    assert last.correction == (0.0,) * count
    assert last.states == (GuardState.OFF,) * count
    back = now
    while now < back + 2.0 * limits.ramp + 1.0:
        now += 0.05
        last = guard.step(now, value)
    small = all(abs(v) <= m for v, m in zip(value, limits.most, strict=True))
    if small and math.hypot(*value[:3]) <= limits.max_norm:
        assert last.states == (GuardState.ACTIVE,) * count
        assert last.correction == value


@given(
    st.lists(st.tuples(st.floats(0.001, 0.4), computed, st.sampled_from([0, 0, 0, 5])), max_size=80)
)
def test_the_short_way_of_a_steady_step_comes_to_the_same(
    steps: list[tuple[float, Vec3 | None, int]],
) -> None:
    usual, long = Guard(LIMITS), Guard(LIMITS)
    now = run(usual, 0.0, 3.0, C)
    run(long, 0.0, 3.0, C)
    for dt, value, faulty in steps:
        now += dt
        long._steady = False
        assert usual.step(now, value, faulty) == long.step(now, value, faulty)


def run(
    guard: Guard, start: float, seconds: float, value: Correction | None, faulty: int = 0
) -> float:
    for _ in range(round(seconds / 0.01)):
        start += 0.01
        guard.step(start, value, faulty)
    return start


def test_it_begins_at_zero_and_ramps_in() -> None:
    guard = Guard(LIMITS)
    first = guard.step(0.0, C)
    assert first.correction == (0.0, 0.0, 0.0)
    assert first.states == (GuardState.RISING,) * 3
    assert not first.compensating
    now = run(guard, 0.0, 1.0, C)
    half = guard.step(now, C)
    assert half.correction == pytest.approx([c / 2 for c in C])
    now = run(guard, now, 1.01, C)
    assert guard.step(now, C).correction == C
    assert guard.step(now, C).compensating


def test_a_missing_position_holds_then_ramps_in_the_stated_times() -> None:
    guard = Guard(LIMITS)
    now = run(guard, 0.0, 3.0, C)
    lost = now
    now = run(guard, now, LIMITS.hold, None)
    held = guard.step(now, None)
    assert held.correction == C
    assert held.states == (GuardState.HOLDING,) * 3
    now = run(guard, now, LIMITS.ramp / 2, None)
    # the fault began with the first step that lacked a position, 0.01 s after the last good one
    share = 1.0 - (now - (lost + 0.01) - LIMITS.hold) / LIMITS.ramp
    falling = guard.step(now, None)
    assert falling.correction == pytest.approx([share * c for c in C])
    assert falling.states == (GuardState.FALLING,) * 3
    now = run(guard, now, LIMITS.ramp / 2 + 0.02, None)
    assert guard.step(now, None).correction == (0.0, 0.0, 0.0)


def test_a_short_fault_is_held_and_costs_nothing() -> None:
    guard = Guard(LIMITS)
    now = run(guard, 0.0, 3.0, C)
    now = run(guard, now, 0.5, None)
    assert guard.step(now + 0.01, C).compensating


def test_a_signals_correction_follows_the_position_while_it_is_held() -> None:
    guard = Guard(LIMITS)
    now = run(guard, 0.0, 3.0, C)
    now = run(guard, now, 0.5, C, faulty=0b001)
    elsewhere: Vec3 = (0.025, -0.03, 0.01)
    now = run(guard, now, 0.3, elsewhere, faulty=0b001)
    assert guard.step(now, elsewhere, 0b001).correction == elsewhere


def test_a_correction_beyond_the_limits_is_cut_and_said() -> None:
    guard = Guard(LIMITS)
    huge: Vec3 = (9.0, -9.0, 0.0)
    now = run(guard, 0.0, 3.0, (0.05, -0.08, 0.0))
    now = run(guard, now, 0.5, huge)
    decision = guard.step(now, huge)
    assert decision.size_limited
    assert not decision.compensating
    assert decision.correction == (0.05, -0.08, 0.0)


def test_a_jump_is_followed_at_the_stated_rate_and_said() -> None:
    guard = Guard(LIMITS)
    now = run(guard, 0.0, 3.0, (0.0, 0.0, 0.0))
    decision = guard.step(now + 0.1, (0.04, 0.0, 0.0))
    assert decision.rate_limited
    assert decision.correction == pytest.approx((0.02, 0.0, 0.0))


def test_release_ramps_without_holding() -> None:
    guard = Guard(LIMITS)
    now = run(guard, 0.0, 3.0, C)
    guard.release()
    assert not guard.released
    now = run(guard, now, LIMITS.ramp + 0.03, C)
    assert guard.released


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"max_rate": 0.01}, "expected at least 0.05 mm/s"),
        ({"max_norm": 0.0}, "max_norm"),
        ({"hold": -1.0}, "hold"),
        ({"ramp": math.nan}, "ramp"),
        ({"max_correction": (0.1, math.inf, 0.1)}, "max_correction Y"),
        ({"turning": ("C",), "max_turn": (0.0,), "max_turn_rate": 1.0}, "max_turn C"),
        (
            {"turning": ("C",), "max_turn": (1e-3,), "max_turn_rate": 1e-5},
            r"expected at least 0.0286479 deg/s",
        ),
    ],
)
def test_limits_that_make_no_sense_are_refused(change: dict[str, object], word: str) -> None:
    values: dict[str, object] = {
        "max_correction": (0.05, 0.08, 0.1),
        "max_norm": 0.11,
        "max_rate": 0.2,
        "hold": 1.0,
        "ramp": 2.0,
    }
    with pytest.raises(ValueError, match=word):
        GuardLimits(**{**values, **change})  # type: ignore[arg-type]


taken = st.sampled_from(["taken", "untouched", "unknown, taken", "unknown, not taken"])


@given(any_step, st.data())
def test_what_the_controller_has_never_steps_further_than_stated(
    case: tuple[GuardLimits, list[tuple[float, Correction | None, int, str]]], data: st.DataObject
) -> None:
    """A controller that takes, refuses and leaves one guessing, kept apart from the guard."""
    limits, steps = case
    count = len(limits.directions)
    guard = Guard(limits)
    now, has = 100.0, [0.0] * count
    for dt, value, faulty, what in steps:
        now += dt
        do(guard, what)
        handed = guard.step(now, value, faulty).correction
        outcomes = data.draw(st.tuples(*[taken] * count))
        for i, outcome in enumerate(outcomes):
            if outcome in ("taken", "unknown, taken"):
                assert abs(handed[i] - has[i]) <= limits.rates[i] * limits.longest_step + TINY
                assert abs(handed[i]) <= limits.most[i] + TINY
                has[i] = handed[i]
        guard.not_taken(
            sum(1 << i for i, o in enumerate(outcomes) if o == "untouched"),
            sum(1 << i for i, o in enumerate(outcomes) if o.startswith("unknown")),
        )


def test_after_refusals_it_goes_on_from_what_the_controller_has() -> None:
    guard = Guard(ROOMY)
    now = 0.0
    for _ in range(400):
        now += 0.02
        guard.step(now, C)
    moved = (C[0] + 0.3, C[1], C[2])
    for _ in range(400):
        now += 0.02
        guard.step(now, moved)
        guard.not_taken(0b001)
    now += 0.02
    decision = guard.step(now, moved)
    assert decision.correction[0] - C[0] == pytest.approx(ROOMY.max_rate * 0.02)
    assert decision.limited == 0b001
    assert not decision.compensating


def test_the_end_is_not_reached_before_the_controller_has_zero() -> None:
    guard = Guard(LIMITS)
    now = 0.0
    for _ in range(200):
        now += 0.05
        guard.step(now, C)
    guard.release()
    for _ in range(200):
        now += 0.05
        guard.step(now, C)
        guard.not_taken(0, ALL)
    assert not guard.released
    for _ in range(10):
        now += 0.05
        guard.step(now, C)
    assert guard.released


@pytest.mark.parametrize("value", [(0.3, 0.0, 0.0), (0.04, 0.07, 0.09)])
def test_too_large_for_longer_than_the_hold_time_is_a_fault(value: Vec3) -> None:
    """One direction beyond its own limit, and three that are too long together."""
    guard = Guard(LIMITS)
    now, states = 0.0, set()
    while now < LIMITS.hold:
        now += 0.05
        decision = guard.step(now, value)
        assert decision.size_limited
    while now < LIMITS.hold + LIMITS.ramp + 1.0:
        now += 0.05
        decision = guard.step(now, value)
        states.add(decision.states)
    falls = [v != 0.0 for v in value]
    for i in range(3):
        assert (decision.correction[i] == 0.0) == (falls[i] or value[i] == 0.0)
        assert (decision.states[i] is GuardState.OFF) == falls[i]
    while now < 10.0:
        now += 0.05
        decision = guard.step(now, C)
    assert decision.states == (GuardState.ACTIVE,) * 3
    assert decision.correction == C


def test_too_large_for_less_than_that_is_cut() -> None:
    guard = Guard(LIMITS)
    now = 0.0
    for k in range(400):
        now += 0.05
        decision = guard.step(now, C if k % 10 else (0.3, -0.03, 0.01))
        if k > 100:
            assert decision.states == (GuardState.ACTIVE,) * 3
            assert decision.size_limited == (k % 10 == 0)
            assert decision.limited & 1 == decision.size_limited or decision.rate_limited
