"""Commands start fast: what takes long to import is not imported before it is needed."""

from __future__ import annotations

import subprocess
import sys

import pytest

MODULES = {
    "correct": "abbe.daemon.answers.correct",
    "fit": "abbe.daemon.answers.model.fit, abbe.compcore.fitting.fit",
    "compare": "abbe.daemon.answers.model.compare",
    "diagnose": "abbe.daemon.answers.model.diagnose, abbe.daemon.answers.model.apply",
    "table": "abbe.daemon.answers.tables.make, abbe.daemon.answers.tables.words",
}


@pytest.mark.parametrize("command", MODULES)
def test_a_command_starts_without_scipy_and_plotly(command: str) -> None:
    script = (
        "import sys, abbe.daemon.application, abbe.daemon.answers.inputs\n"
        f"import {MODULES[command]}\n"
        "print(*{m.partition('.')[0] for m in sys.modules} & {'scipy', 'plotly', 'pandas'})"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.split() == []
