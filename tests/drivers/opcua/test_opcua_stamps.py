"""How old a value is: by stamps of one answer, all by the server's own clock, right or wrong."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest
from asyncua import ua
from hypothesis import given
from hypothesis import strategies as st

from abbe.drivers.link import Quality
from abbe.drivers.opcua.config import OpcuaChannelConfig, Stamp
from abbe.drivers.opcua.values import sample_of

_CHANNEL = OpcuaChannelConfig(node="ns=1;s=x")
_CLOCKS = st.datetimes(datetime(1990, 1, 1), datetime(2090, 1, 1)).map(
    lambda at: at.replace(tzinfo=UTC)
)


def value(**stamps: datetime | None) -> ua.DataValue:
    return ua.DataValue(ua.Variant(4.5, ua.VariantType.Double), ua.StatusCode(0), **stamps)


@given(
    made_at=_CLOCKS,
    age=st.floats(0.0, 1e6),
    other=st.floats(-1e6, 1e6),
    stamp=st.sampled_from(["server", "source"]),
)
def test_only_the_chosen_stamp_counts_and_the_clock_need_not_be_right(
    made_at: datetime, age: float, other: float, stamp: Stamp
) -> None:
    own, others = made_at - timedelta(seconds=age), made_at - timedelta(seconds=other)
    both = {"server": (others, own), "source": (own, others)}[stamp]
    found = value(SourceTimestamp=both[0], ServerTimestamp=both[1])
    sample = sample_of(_CHANNEL, float, stamp, found, 5000.0, made_at)
    assert sample.value == 4.5
    assert sample.time == pytest.approx(5000.0 - age, abs=2e-6)


@given(made_at=_CLOCKS, ahead=st.floats(0.101, 1e6))
def test_a_stamp_of_the_future_is_none(made_at: datetime, ahead: float) -> None:
    found = value(SourceTimestamp=made_at + timedelta(seconds=ahead))
    sample = sample_of(_CHANNEL, float, "source", found, 5000.0, made_at)
    assert sample.quality is Quality.BAD
    assert "later than the answer" in sample.reason


@pytest.mark.parametrize("stamp", ["server", "source"])
@pytest.mark.parametrize("missing", ["value", "answer"])
def test_without_one_of_the_stamps_nobody_knows(stamp: Stamp, missing: str) -> None:
    now = datetime(2026, 11, 1, tzinfo=UTC)
    zero = datetime(1601, 1, 1, tzinfo=UTC)
    for none in (None, zero):
        at = none if missing == "value" else now
        found = value(SourceTimestamp=at, ServerTimestamp=at)
        made_at = None if missing == "answer" else now
        sample = sample_of(_CHANNEL, float, stamp, found, 5000.0, made_at)
        assert sample.quality is Quality.BAD
        assert f"its {missing} carries no {stamp} time stamp" in sample.reason


def test_without_stamps_it_is_as_old_as_its_question() -> None:
    sample = sample_of(_CHANNEL, float, "none", value(), 5000.0, None)
    assert (sample.value, sample.time) == (4.5, 5000.0)
