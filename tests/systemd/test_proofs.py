"""The short form of the proofs; ``make test-systemd`` has all of them."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.support.systemd.stage import stage
from tests.systemd.proofs import SHORT, prove

pytestmark = [
    pytest.mark.systemd,
    pytest.mark.integration,
    pytest.mark.timeout(3600),
    pytest.mark.skipif(
        not all(map(shutil.which, ("qemu-system-x86_64", "mmdebstrap"))),
        reason="apt install qemu-system-x86 mmdebstrap",
    ),
]


def test_installed_ready_confined_started_anew_ended(tmp_path: Path) -> None:
    with stage(tmp_path) as made:
        rows = list(prove(made, SHORT))
    failed = [row.words() for row in rows if not row.held]
    assert failed == [], "\n".join(failed)
