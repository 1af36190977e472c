"""Two events in one direction are two events; one amid a wander is one."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.effects.catalogue.events import Event
from tests.compcore.diagnosis.test_sudden import EVERY, N, record


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_two_steps_are_found_where_they_were(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = int(rng.integers(20, 60)), int(rng.integers(80, 130))
    row = np.arange(N)
    values = 8.0 * (row >= first) + 5.0 * (row >= second) + rng.normal(0.0, 0.7, N)
    last = to_the_verdict(*record(values, rng)).last.result
    events = [e for e in last.model.effects if isinstance(e, Event)]
    assert [e.kind for e in last.model.effects if e.kind != "setup_zero"] == ["event", "event"]
    assert [e.number for e in events] == [None, 2]
    terms = [t for t in last.model.terms if isinstance(t.effect, Event)]
    moments = sorted(t.nonlinear(last.model.machine)["t0"] / EVERY for t in terms)
    np.testing.assert_allclose(moments, [first, second], atol=1.0)


@pytest.mark.parametrize("seed", range(6))
def test_the_wander_beside_one_step_is_no_second(seed: int) -> None:
    rng = np.random.default_rng(seed)
    at = int(rng.integers(30, 120))
    drift = np.cumsum(rng.normal(0.0, 0.3, N))
    values = drift + 15.0 * (np.arange(N) >= at) + rng.normal(0.0, 0.5, N)
    model = to_the_verdict(*record(values, rng)).last.result.model
    assert len([e for e in model.effects if e.kind == "event"]) <= 1


def test_a_third_follows_a_second_and_none_a_ninth() -> None:
    second = Event(direction="X", number=2)
    assert second.spec == "event direction=X number=2"
    assert second.next_one() == Event(direction="X", number=3)
    assert Event(direction="X", number=9).next_one() is None
