"""A program stands at a target as long as `abbe measure` needs there, by the defaults of both."""

from __future__ import annotations

import pytest

from abbe.compcore.planning.instruments import INSTRUMENTS, TOUCHED
from abbe.daemon.config.sections.measure import MeasureSection


@pytest.mark.parametrize("key", sorted(set(INSTRUMENTS) - set(TOUCHED)))
def test_a_program_stands_long_enough_to_be_read(key: str) -> None:
    """A ball bar's 0.25 s, of a bar that moves while it reads, missed every target."""
    own = MeasureSection()
    assert INSTRUMENTS[key].reading >= own.still_for + own.settle + own.average
