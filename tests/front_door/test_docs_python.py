"""The code of docs/python.md runs, and prints what stands beside it."""

import contextlib
import io
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BLOCKS = re.findall(
    r"^```python\n(.*?)^```$",
    (ROOT / "docs" / "python.md").read_text("utf-8"),
    re.DOTALL | re.MULTILINE,
)
LOOP = BLOCKS[0]


def test_the_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    monkeypatch.chdir(tmp_path)
    out = io.StringIO()
    space: dict[str, object] = {}
    with contextlib.redirect_stdout(out):
        exec(compile(LOOP, "docs/python.md", "exec"), space)
    stated = [line.rpartition("  # ")[2] for line in LOOP.splitlines() if line.startswith("print(")]
    assert out.getvalue().splitlines() == stated
    assert len(stated) == 7
    assert (tmp_path / "better.toml").is_file()
    # what follows on the page, without opening a browser
    more = BLOCKS[1].replace(".show()", "")
    exec(compile(more, "docs/python.md", "exec"), space)


def test_it_is_short() -> None:
    code = [line for line in LOOP.splitlines() if line.strip()]
    assert len(code) <= 32
