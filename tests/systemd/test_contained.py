"""The package and its services on a real systemd in a container."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.systemd.image import CannotPrepareError
from tests.support.systemd.stage import stage
from tests.systemd.proofs import EVERY_TIME, Row, prove

pytestmark = [pytest.mark.integration, pytest.mark.timeout(1200)]


@pytest.mark.thorough
def test_the_package_installed_run_frozen_killed_restarted_and_removed(tmp_path: Path) -> None:
    rows: list[Row] = []
    try:
        with stage(tmp_path, container=True) as made:
            rows.extend(prove(made, EVERY_TIME))
    except CannotPrepareError as error:
        if rows:
            raise
        pytest.skip(f"no container with a systemd of its own can be made here: {error}")
    assert [row.words() for row in rows if not row.held] == []
    assert len(rows) == len(EVERY_TIME)
