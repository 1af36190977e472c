"""An agent of its own for each test."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.support.drivers.mtconnect.agent import MillAgent, serving


@pytest.fixture
def agent() -> Iterator[MillAgent]:
    with serving(MillAgent()) as made:
        made.say(Xact="1.5", Yact="2.5", Zact="3.5", Stemp="20.25", Ppos="1 2 3", Cact="90")
        yield made
