"""python-can comes with Abbe; it and what stands on it are imported only where they are used."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


def test_python_can_is_a_dependency_and_the_rest_an_extra():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = [text.split(">")[0].split("=")[0] for text in project["dependencies"]]
    assert "python-can" in names
    extra = " ".join(project["optional-dependencies"]["can"])
    assert "cantools" in extra
    assert "canopen" in extra
    assert "python-can" not in extra


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    "words",
    [
        ["effects"],
        ["controllers"],
        ["compare", "tests/data/p02-bridge/model.toml", "tests/data/p02-bridge/check.csv"],
        ["check", "drivers/modbus/sample.toml"],
    ],
)
def test_commands_without_can_import_none_of_it(words):
    code = (
        "import sys\n"
        f"sys.argv = ['abbe', *{words!r}]\n"
        "from abbe.daemon.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "found = {'can', 'cantools', 'canopen', 'msgpack'} & set(sys.modules)\n"
        "print('imported:', sorted(found), file=sys.stderr)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True, text=True, check=False, timeout=100, cwd=ROOT,
    )  # fmt: skip
    assert "imported: []" in done.stderr
    assert done.stdout or words[0] == "check", done.stderr
