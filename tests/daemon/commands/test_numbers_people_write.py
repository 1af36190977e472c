"""What commands print, and their pages, hold numbers as people write them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.daemon.command_line import abbe
from tests.support.daemon.numbers import seen_of, unreadable
from tests.support.daemon.some_setups import some_setups

DATA = Path(__file__).parents[2] / "data"
EXAMPLES = Path(__file__).parents[3] / "examples"


def readable(*words: object, page: Path | None = None) -> str:
    """Run a command; its page is scanned as well, where it makes one."""
    done = abbe(*words, *([] if page is None else ["--report", page]))
    assert done.status == 0, done.err
    assert unreadable(done.out) == [], words
    if page is not None:
        assert unreadable(seen_of(page)) == [], words
    return done.out


@pytest.mark.parametrize("text", ["+5.18e-16 µm", "4664 ± 6.5e+02 s", "0.5 ± 0.123 µm", "1E5 K"])
def test_what_nobody_writes_is_found(text: str) -> None:
    assert len(unreadable(f"left: {text}, and 3.2 ± 0.1 µm")) == 1


def test_of_a_model_beside_measurements(tmp_path: Path) -> None:
    """With time constants, offsets near nothing, and values far from one."""
    model, page = DATA / "p03-bridge" / "model.toml", tmp_path / "page.html"
    some = some_setups(DATA / "p03-bridge" / "fit.csv", tmp_path / "some.csv", every=4)
    fitted, added = tmp_path / "fitted.toml", tmp_path / "added.toml"
    readable("fit", model, some, "-o", fitted, page=page)
    readable("compare", fitted, some, page=page)
    readable("diagnose", fitted, some, page=page)
    # a warm-up's time constant in thousands of seconds, and what it leaves of nothing
    cause = ["warm_up", "direction=X"]
    readable("add", fitted, *cause, "--campaign", some, "-o", added, page=page)
    readable("history", added, page=page)
    readable("iso230", some)
    readable("effects")


def test_of_values_in_the_wrong_unit(tmp_path: Path) -> None:
    """Thousands of what a machine errs by: every digit before the point is written."""
    model = DATA / "p03-bridge" / "model.toml"
    some = some_setups(DATA / "p03-bridge" / "fit.csv", tmp_path / "some.csv", every=8)
    lines, far = some.read_text("utf-8").splitlines(), tmp_path / "far.csv"
    head = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    column = lines[head].split(",").index("value")
    for i in range(head + 1, len(lines)):
        cells = lines[i].split(",")
        cells[column] = repr(1000.0 * float(cells[column]))
        lines[i] = ",".join(cells)
    far.write_text("\n".join(lines) + "\n", "utf-8")
    said = readable("compare", model, far) + readable("fit", model, far, "-o", tmp_path / "x.toml")
    assert "no machine errs that much" in said


def test_of_a_machine_that_is_corrected(tmp_path: Path) -> None:
    model = EXAMPLES / "bridge-cmm" / "model.toml"
    warm = [f"{name}=21.5" for name in ("T_x1", "T_x2", "T_y1", "T_y2", "T_z1", "T_z2", "T_amb")]
    readable("correct", model, "X=100", "Y=200", "Z=-150", *warm)
    readable("table", model, "--controller", "linuxcnc", "--at", "reference",
             "-o", tmp_path / "tables")  # fmt: skip
    readable("plan", model)
