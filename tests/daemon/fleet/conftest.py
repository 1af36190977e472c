"""One PostgreSQL for all tests of the store: each makes a database of its own in it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.support.daemon.postgres import PostgreSQL, postgresql


@pytest.fixture(scope="session")
def server() -> Iterator[PostgreSQL]:
    with postgresql() as found:
        yield found
