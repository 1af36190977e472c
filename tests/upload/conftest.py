"""What the tests of uploads share: the tables that are uploaded, made once."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.daemon.upload_cases import fill


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model, and the tables ``old`` and ``new`` of it; only read."""
    folder = tmp_path_factory.mktemp("tables")
    fill(folder)
    return folder
