"""One server for the tests of a file; each begins with what it said at first."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.support.drivers.opcua.mill import Mill, mill

_FIRST = {
    "x": 1.5, "y": 2.5, "z": 3.5, "T": 20.25, "inch": 1.0, "arr": [1.0, 2.0, 3.0], "flag": True,
    "text": "no", "n": -7, "big": [0, 12],
}  # fmt: skip


@pytest.fixture(scope="module")
def process(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mill]:
    with mill(tmp_path_factory.mktemp("mill")) as made:
        yield made


@pytest.fixture
def server(process: Mill) -> Mill:
    process.say(0, **{name: {"value": value} for name, value in _FIRST.items()})
    return process
