"""Which tables where there are few: against all subsets."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from abbe.compcore.tables.capability import Capability, Holds
from abbe.compcore.tables.projection.choice import chosen
from abbe.compcore.tables.projection.curves.curve import Curve
from abbe.compcore.tables.table import Table, move
from abbe.compcore.tables.volume import Volume

WHERE = np.linspace(0.0, 100.0, 11)
KINDS = (
    Holds("axis", ("L-POS",), takes=(0, 0)),
    Holds("cross", ("L-STR",), takes=(1, 2), directional=True),
    Holds("product", ("L-ANG",), takes=(4, 4)),
)


def curve(kind: int, output: str, size: float, reverses: bool) -> Curve:
    up = size * np.where(np.arange(11) % 2, 1.0, -1.0)
    values = np.stack([up, up * (0.5 if reverses else 1.0)])
    lever = ("Z", 0.0) if kind == 2 else None
    return Curve(KINDS[kind], move(output), "X", WHERE, values, lever=lever)


drawn = st.lists(
    st.builds(
        curve,
        st.integers(0, 2),
        st.sampled_from("XYZ"),
        st.floats(1e-4, 1.0),
        st.booleans(),
    ),
    max_size=7,
)


def taken_off(kept: list[Curve]) -> float:
    """Mean square of tables at ±1 × size; a lever spread evenly over ±1 has a third."""
    return sum(
        float(np.square(c.values - c.values.mean()).mean()) / (3.0 if c.lever else 1.0)
        for c in kept
    )


def taken_up(kept: list[Curve]) -> int:
    own = {"axis": (0, 0), "cross": (1, 2), "product": (4, 4)}
    return sum(
        own[c.holds.form][int(c.holds.directional and bool(np.ptp(c.values, axis=0).any()))]
        for c in kept
    )


@settings(max_examples=150)
@given(drawn, st.integers(0, 12), st.sampled_from([None, 1, 2]))
def test_no_other_choice_takes_more_off(curves, most, per_output):
    capability = Capability(KINDS, most_tables=most, per_output=per_output)

    def fits(some) -> bool:
        outputs = [c.output for c in some]
        return taken_up(some) <= most and (
            per_output is None or all(outputs.count(o) <= per_output for o in outputs)
        )

    kept, left_out = chosen(curves, capability)
    assert {id(c) for c in kept + left_out} == {id(c) for c in curves}
    assert fits(kept)
    best = max(
        taken_off(list(some))
        for n in range(len(curves) + 1)
        for some in combinations(curves, n)
        if fits(some)
    )
    assert taken_off(kept) >= best * (1.0 - 1e-12)


@given(drawn)
def test_where_there_are_enough_nothing_is_left_out(curves):
    assert chosen(curves, Capability(KINDS)) == (curves, [])


def test_those_that_are_taken_in_any_case_count():
    curves = [curve(1, "X", 1e-3, False), curve(1, "Y", 2e-3, False)]
    kept, left_out = chosen(curves, Capability(KINDS, most_tables=3), [curve(1, "Z", 1.0, True)])
    assert (kept, left_out) == (curves[1:], curves[:1])


def test_a_range_knows_what_is_in_it_and_a_lever_how_far_it_reaches():
    volume = Volume({"X": (10.0, 30.0)})
    assert volume.inside("X", WHERE).tolist() == [False, *[True] * 3, *[False] * 7]
    table = Table(move("X"), ("Y",), (WHERE,), WHERE * 1e-7, lever=("Z", -20.0))
    assert table.reach((-100.0, 40.0)) == 80.0
    assert Table(move("X"), ("Y",), (WHERE,), WHERE).reach((-100.0, 40.0)) == 1.0
