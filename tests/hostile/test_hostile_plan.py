"""Bad plans for ``abbe program``: one line, no program written, bounded time and memory."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pytest

from tests.support.hostile import mutate
from tests.support.hostile.forked import Case, faults, run
from tests.support.hostile.good import UNFITTED

COMMAND = ("program", "p.toml", "--controller", "linuxcnc", "-o", "out.ngc", "--force")
PLAN = """\
format = "abbe-plan/1"
model = "m.toml"
machine = "Bridge CMM"
structure = "w b Y X Z t"
warm_up = 60
beyond = 2
tool_radius = 5

[tools]
"T1" = [0, 0, -100]

[[keep_out]]
low = [0, 0, -900]
high = [50, 50, -800]

[[setups]]
name = "01_laser"
what = "positioning of X"
instrument = "laser"
kind = "displacement"
free = ["zero"]
axis = "X"
tool = "T1"
runs = 1
both_ways = true
axes = ["Y", "X", "Z"]
targets = [
  [450, 10, -180],
  [450, 350, -180],
  [450, 690, -180],
]
read = [
  [[1, 0, 0]],
]
sd = [0.3]
stands = { "laser stands" = [-150, 450, -280] }
"""


def case(name: str, text: str | bytes, *says: str, may_succeed: bool = False) -> Case:
    """A bad plan beside a good model; what was at the output stays."""
    files = {"m.toml": UNFITTED, "p.toml": text}
    return Case(name, files, COMMAND, says, may_succeed, ("out.ngc",))


def changed(old: str, new: str, *says: str) -> Case:
    """The good plan with one thing changed."""
    assert old in PLAN
    return case(f"{old} -> {new[:20]}", PLAN.replace(old, new, 1), "p.toml", *says)


def named() -> Iterator[Case]:
    """One thing wrong, by name."""
    digits = "9" * 5000
    yield changed("beyond = 2", "beyond = inf", "beyond")
    yield changed("runs = 1", "runs = 100000000", "runs")
    yield changed("beyond = 2", "in_one_go = 1\nbeyond = 2", "in_one_go")
    yield changed("runs = 1", f"runs = {digits}")
    yield changed("  [450, 10, -180],", "  [450, nan, -180],", "targets")
    yield changed("  [450, 10, -180],", "  [450, 1, -180],", "leave its travel")
    yield changed("  [450, 10, -180],", "  [450, 1e300, -180],", "targets")
    yield changed("  [450, 10, -180],", "  [450, 10],", "each axis")
    yield changed("low = [0, 0, -900]", "low = [60, 0, -900]", "not a box")
    yield changed("high = [50, 50, -800]", "high = [500, 500, -200]", "keep-out box 1")
    yield changed("[[1, 0, 0]]", "[[3, 0, 0]]", "directions")
    yield changed("[[1, 0, 0]]", "[]", "directions")
    yield changed('"T1" = [0, 0, -100]', '"T1" = "long"', "tools")
    yield changed('name = "01_laser"', 'name = "a\\nM30"', "name")
    yield changed('axis = "X"', 'axis = "Q"', "axis")
    yield case(
        "many targets", PLAN.replace("  [450, 350, -180],\n", "  [450, 350, -180],\n" * 9000)
    )
    yield case("nested", PLAN + "x = " + "[" * 20000)
    yield case("nothing", "")


def damaged() -> Iterator[Case]:
    """Damage by machine; a comment or a digit that does not matter may be hit."""
    data = PLAN.encode()
    made = chain(mutate.whole(data), mutate.cut(data, 6, 1), mutate.numbers_replaced(data, 12, 2))
    for name, text in made:
        yield case(name, text, may_succeed=True)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("bad", [*named(), *damaged()], ids=str)
def test_a_bad_plan_is_one_line_and_no_program(bad: Case, tmp_path: Path) -> None:
    outcome = run(bad, tmp_path)
    assert not faults(bad, outcome, tmp_path)


def test_the_good_one_is_taken(tmp_path: Path) -> None:
    outcome = run(Case("good", {"m.toml": UNFITTED, "p.toml": PLAN}, COMMAND), tmp_path)
    assert outcome.status == 0, outcome.err
    assert "(target 6)" in (tmp_path / "work" / "out.ngc").read_text("ascii")
