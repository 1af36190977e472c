"""Bad part programs for ``abbe uncertainty``: one line, no page, bounded time and memory."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pytest

from tests.support.hostile import mutate
from tests.support.hostile.forked import Case, faults, run
from tests.support.hostile.good import model

HEAD = """\
format = "abbe-part/1"
[styli.1]
offset = [0, 0, -100]
radius = 1.5
[probe]
repeatability = 0.3
[signals]
T_x = { value = 21.0, sd = 0.05, varies = 1.0 }
[part]
expansion = 11.5
origin = [150, 200, -150]
x = [1, 0, 0]
"""
PART = (
    HEAD
    + """\
[[features]]
name = "A"
kind = "plane"
at = [200, 150, 0]
size = [380, 280]
grid = [4, 3]
[[features]]
name = "B"
kind = "circle"
at = [40, 40, -10]
diameter = 40
count = 8
[[features]]
name = "P"
kind = "point"
points = [[100, 100, 0]]
normals = [[0, 0, 1]]
[[characteristics]]
name = "bore B"
what = "diameter"
of = ["B"]
tolerance = 16
"""
)
TABLE = (
    "".join(f"# {line}\n" for line in HEAD.splitlines())
    + """\
feature,kind,x,y,z,nx,ny,nz
A,plane,200,150,0,0,0,1
A,plane,300,150,0,0,0,1
A,plane,300,250,0,0,0,1
A,plane,200,250,0,0,0,1
P,point,100,100,0,0,0,1
"""
)


def case(
    name: str, text: str | bytes, *says: str, file: str = "p.toml", maybe: bool = False
) -> Case:
    """A bad part beside a good model; the page that was there stays."""
    command = ("uncertainty", "m.toml", file, "--draws", "1000", "--workers", "1",
               "--report", "out.html", "--force")  # fmt: skip
    return Case(name, {"m.toml": model(), file: text}, command, says, maybe, ("out.html",))


def changed(old: str, new: str, *says: str) -> Case:
    """The good part with one thing changed."""
    assert old in PART
    return case(f"{old} -> {new[:20]}", PART.replace(old, new, 1), "p.toml", *says)


def row(old: str, new: str, *says: str) -> Case:
    """The good table with one thing changed."""
    assert old in TABLE
    text = TABLE.replace(old, new, 1)
    return case(f"table: {old} -> {new[:20]}", text, "p.csv", *says, file="p.csv")


def named() -> Iterator[Case]:
    """One thing wrong, by name."""
    digits = "9" * 5000
    yield changed("abbe-part/1", "abbe-part/2", "format")
    yield changed("radius = 1.5", "radius = nan", "radius")
    yield changed("radius = 1.5", "radius = -1.5", "radius")
    yield changed("radius = 1.5", f"radius = {digits}")
    yield changed("[styli.1]", '[styli."\\u0000"]', "styli")
    yield changed("repeatability = 0.3", "repeatability = inf", "repeatability")
    yield changed("repeatability = 0.3", "repeatibility = 0.3", "repeatibility")
    yield changed("value = 21.0", "value = 1e300", "T_x")
    yield changed("value = 21.0", "value = 900", "T_x", "not believable")
    yield changed("T_x = {", "T_y = {", "T_y", "one of T_x")
    yield changed("x = [1, 0, 0]", "x = [0, 0, 1]", "part.x")
    yield changed("origin = [150, 200, -150]", "origin = [1500, 0, 0]", "does not reach")
    yield changed("grid = [4, 3]", "grid = [100, 100]", "too many points")
    yield changed("grid = [4, 3]", "grid = [1, 1]", "features")
    yield changed("count = 8", "count = 1000000000", "count")
    yield changed("count = 8", "count = 2", "features")
    yield changed("diameter = 40", "diameter = 0", "diameter")
    yield changed('kind = "circle"', 'kind = "torus"', "kind")
    yield changed('name = "B"', 'name = "A"', "'A'")
    yield changed('name = "B"', 'name = "\\u001b[2J"', "name")
    yield changed('name = "B"', f'name = "{"B" * 100_000}"', "name")
    yield changed('kind = "circle"', 'kind = "circle"\nstylus = "9"', "9")
    yield changed("normals = [[0, 0, 1]]", "normals = []", "normals")
    yield changed('of = ["B"]', 'of = ["Z"]', "Z")
    yield changed('of = ["B"]', 'of = ["B"]\ndatums = ["B", "B", "B"]', "datum")
    yield changed('what = "diameter"', 'what = "flatness"', "characteristics[0].of")
    yield changed('of = ["B"]', 'of = ["B"]\nalong = [0, 0, 0]', "along")
    yield changed("tolerance = 16", "tolerance = 0", "tolerance")
    yield case("many features", HEAD + '[[features]]\nname="a"\nkind="point"\n' * 9000)
    yield case("nested", PART + "x = " + "[" * 20000)
    yield changed("T_x = { value = 21.0, sd = 0.05, varies = 1.0 }", "", "T_x")
    yield changed("size = [380, 280]", "size = [0, 0]", "features[0].size")
    yield changed("count = 8", "count = 8\nspan = 1e-300", "features[1].span")
    yield changed("diameter = 40", "diameter = 1e-300", "features[1].diameter")
    yield changed("normals = [[0, 0, 1]]", "normals = [[0, 0, 0]]", "features[2].normals", "[0.0")
    yield row("100,100,0", "100,100,", "line 18")
    yield row("100,100,0", "nan,100,0", "line 18", "x")
    yield row("P,point", "P,torus", "line 18", "torus")
    yield row("100,100,0,0,0,1", "100,100,0,0,0,0", "line 18", "not a direction")
    yield row("0,0,1\nP", "0,0,1,7\nP", "line 17")
    yield row("P,point", "A,point", "line 18")
    yield row("kind,x", "kind,kind", "kind")
    yield row("feature,kind,x,y,z", "feature,kind,x,y", "z")
    yield case("table without rows", TABLE[: TABLE.index("A,plane")], "p.csv", file="p.csv")
    many = TABLE + "A,plane,200,150,0,0,0,1\n" * 100_000
    yield case("table of many rows", many, "p.csv", "line 2014", "100005", file="p.csv")


def damaged() -> Iterator[Case]:
    """Damage by machine; a comment or a digit that does not matter may be hit."""
    for name, bad in chain(mutate.whole(PART.encode()), mutate.cut(PART.encode(), 4, 1)):
        yield case(f"damaged: {name}", bad, maybe=True)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("bad", [*named(), *damaged()], ids=str)
def test_a_bad_part_is_one_line_and_no_page(bad: Case, tmp_path: Path) -> None:
    outcome = run(bad, tmp_path)
    assert not faults(bad, outcome, tmp_path)


@pytest.mark.parametrize(("file", "text"), [("p.toml", PART), ("p.csv", TABLE)])
def test_the_good_ones_are_taken(file: str, text: str, tmp_path: Path) -> None:
    good = case("good", text, file=file)
    outcome = run(good, tmp_path)
    assert outcome.status == 0, outcome.err
    assert "<html" in (tmp_path / "work" / "out.html").read_text("utf-8")
