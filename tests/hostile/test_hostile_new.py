"""``abbe new`` with what cannot be: structure codes, travels, lines, sensors, shapes, outputs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.compcore.files.model_file import load_model
from tests.support.hostile.forked import Case, faults, run

MILL = ("--structure", "w C' b Y X Z t")
ENDS = tuple(w for e in ("C=0,360", "Y=0,400", "X=0,500", "Z=-300,0") for w in ("--travel", e))
MILL_ENDS = (*MILL, *ENDS)
DIGITS = "9" * 5000
BINARY = "\udcff\udcfe"
"""Bytes of an argument that are no UTF-8, as Python hands them over."""


def axes(*names: str) -> tuple[str, ...]:
    return tuple(word for name in names for word in ("--travel", f"{name}=0,500"))


def codes() -> Iterator[tuple[str, tuple[str, ...], tuple[str, ...]]]:
    """Structure codes; what is wrong is named, and what is expected."""
    for code, says in (
        ("", "w b t missing"),
        (" \t", "w b t missing"),
        ("w b t", "no axes"),
        ("w b X", "t missing"),
        ("X Y Z", "axis X stands outside w"),
        ("b w X t", "'b' stands in the wrong place"),
        ("w b X t t", "'t' stands in the wrong place"),
        ("w b X t Y", "axis Y stands outside"),
        ("w X b Y t", "axis X is on the workpiece side"),
        ("w b X' Y t", "axis X' is on the tool side"),
        ("w b X Y X t", "axis X occurs twice"),
        ("w X' b X t", "axis X occurs twice"),
        ("w b Q t", "cannot read"),
        ("w b x y z t", "cannot read"),
        ("w b X10 t", "cannot read"),
        ("w b Х t", "cannot read"),
        ("w b X (Y) t", "(Y) is a linear axis"),
        ("w b X (C) (A) t", "more than one spindle"),
        ("w b (C) X t", "between the spindle and the tool"),
        ("w b X (C t", "cannot read"),
        ("w; b; X; t", "cannot read"),
        ("w b X t # mine", "cannot read"),
        ("w b X t\nname = 'x'", "cannot read"),
        ("[w b X t", "cannot read"),
        ("brigde", "bridge"),
        ("w b X \x00 t", "cannot read"),
        ("w b X \x1b[31m t", "cannot read"),
        (f"w b {BINARY} t", "cannot read"),
        ("🙂" * 50, "cannot read"),
        ("X" * 100_000, ""),
        ("w b " + "Q" * 100_000 + " t", "cannot read"),
        ("w b " + "X " * 50_000 + "t", "occurs twice"),
        ("w" * 20_000, "wrong place"),
        ("w b " + "(" * 20_000 + " t", "cannot read"),
        (DIGITS, ""),
    ):
        yield f"code {code[:24]!r}", ("--structure", code, *axes("X", "Y")), ("structure", says)
    yield "no code", (*ENDS,), ("expected --structure CODE",)
    yield "no code, only a sensor", ("--sensor", "T=scale,X"), ("expected --structure CODE",)
    yield "nobody to ask", (), ("no terminal to ask on", "--structure CODE")


def travels() -> Iterator[tuple[str, tuple[str, ...], tuple[str, ...]]]:
    """Ends of travels."""
    for text, says in (
        ("0", "LOW,HIGH in mm"),
        ("", "LOW,HIGH in mm"),
        ("0,1,2", "LOW,HIGH in mm"),
        ("0;500", "LOW,HIGH in mm"),
        ("0..500", "LOW,HIGH in mm"),
        ("0,500mm", "found '500mm'"),
        ("0,long", "found 'long'"),
        ("nan,500", "found 'nan'"),
        ("0,inf", "found 'inf'"),
        ("-inf,0", "found '-inf'"),
        ("0,1e300", "-100000 to 100000 mm"),
        ("500,0", "LOW < HIGH"),
        ("0,0", "LOW < HIGH"),
        ("0,1e-9", "LOW < HIGH"),
        ("0," + DIGITS, "X"),
        ("0,1e5x", "'1e5x'"),
        ("0x0,0x10", "found '0x0'"),
        (BINARY, "LOW,HIGH in mm"),
        ("0,\x00", "X"),
        ("0,\x1b[31m", "X"),
        ("," * 20_000, "LOW,HIGH in mm"),
        ("0," + "7" * 400, "X"),
    ):
        yield f"travel {text[:24]!r}", ("--structure", "w b X t", "--travel", f"X={text}"), (says,)
    for name, words, says in (
        ("none", (), "expected --travel X=LOW,HIGH"),
        ("twice", axes("X", "X"), "X is given twice"),
        ("of an axis too many", axes("X", "Y"), "the structure has no such axis"),
        ("in lower case", axes("x"), "the structure has no such axis"),
        ("of nothing", ("--travel", "=0,500"), "expected KEY=VALUE"),
        ("without =", ("--travel", "X 0,500"), "expected KEY=VALUE"),
        ("of a long name", axes("X" * 20_000), "the structure has no such axis"),
    ):
        yield f"travel {name}", ("--structure", "w b X t", *words), (says,)
    for text, says in (("0,1e9", "-36000 to 36000 degrees"), ("360,0", "LOW < HIGH")):
        words = (*MILL, "--travel", f"C={text}", *ENDS[2:])
        yield f"travel of C {text}", words, ("travel C", says)


def lines() -> Iterator[tuple[str, tuple[str, ...], tuple[str, ...]]]:
    """Places of rotary axes' lines."""
    for text, says in (
        ("C=1,2", "expected x,y,z in mm"),
        ("C=", "expected x,y,z in mm"),
        ("C=1,2,3,4", "x,y,z in mm"),
        ("C=1,2,nan", "found 'nan'"),
        ("C=1,2,1e300", "-200000 to 200000 mm"),
        ("C=1,2,x", "found 'x'"),
        ("X=1,2,3", "only a rotary axis has a line"),
        ("A=1,2,3", "the structure has no such axis"),
        ("C", "expected KEY=VALUE"),
        (f"C=1,2,{DIGITS}", "location C"),
        (f"C={BINARY},1,2", "location C"),
    ):
        yield f"line {text[:24]!r}", (*MILL_ENDS, "--location", text), (says,)
    twice = ("--location", "C=1,2,3", "--location", "C=1,2,3")
    yield "line twice", (*MILL_ENDS, *twice), ("C is given twice",)


def sensors() -> Iterator[tuple[str, tuple[str, ...], tuple[str, ...]]]:
    """Signals."""
    for text, says in (
        ("T", "expected KEY=VALUE"),
        ("T=", "unknown role"),
        ("=scale,X", "expected KEY=VALUE"),
        ("T=warm", "unknown role"),
        ("T=Scale,X", "unknown role"),
        ("T=scale,Q", "no such axis"),
        ("T=scale,x", "no such axis"),
        ("T=scale,XY", "no such axis"),
        ("value=scale,X", "column"),
        ("time=scale,X", "column"),
        ("X=scale,X", "column"),
        ("X_dir=scale,X", "column"),
        ("B7=scale,X", "column"),
        ("tool_z=scale,X", "column"),
        ("ux=scale,X", "column"),
        ("T\n1=scale,X", "column"),
        ("T\x00=scale,X", "column"),
        ("T\x1b[31m=scale,X", "column"),
        (f"{BINARY}=scale,X", ""),
        ("T,1=scale,X", "column"),
        ('"T=scale,X', "column"),
        (" T=scale,X", "column"),
        ("#T=scale,X", "column"),
        (f"T={DIGITS}", "unknown role"),
        (f"T=scale,{DIGITS}", "no such axis"),
        (f"{'T' * 20_000}=warm", "unknown role"),
        ("T=scale,X,furlong", "found 'furlong'"),
        ("T=scale,X,mm", "is a thermometer"),
        ("T=speed,,°C", "a unit such as rpm"),
        ("T=load,,K", "a unit such as kg"),
    ):
        yield f"sensor {text[:24]!r}", (*MILL_ENDS, "--sensor", text), (says,)
    twice = ("--sensor", "T=scale,X", "--sensor", "T=scale,Y")
    yield "sensor twice", (*MILL_ENDS, *twice), ("T is given twice",)


def shapes() -> Iterator[tuple[str, tuple[str, ...], tuple[str, ...]]]:
    """Shapes of error motions."""
    for text in (
        "",
        "wavy:3",
        "spline",
        "spline:",
        "spline:0",
        "spline:-4",
        "spline:4.5",
        "spline:x",
        "spline:1e9",
        "spline:1000000",
        f"spline:{DIGITS}",
        "polynomial:-1",
        "polynomial:5000",
        "polynomial:nan",
        "spline:8:8",
        "SPLINE:8",
        BINARY,
        "spline:8\x00",
        "table",
        "table:3",
        "constant:2",
        "x" * 20_000,
    ):
        yield f"shape {text[:24]!r}", (*MILL_ENDS, "--shape", text), ("shape",)


CASES = [
    Case(name, {}, ("new", *words, "-o", "m.toml", *more), says, kept=kept)
    for number, (name, words, says) in enumerate(
        [*codes(), *travels(), *lines(), *sensors(), *shapes()]
    )
    # every other time over a model that is there already: it stays
    for more, kept in ([((), ()), (("--force",), ("m.toml",))][number % 2],)
]


@pytest.mark.one_in(6)
@pytest.mark.parametrize("case", CASES, ids=str)
def test_what_cannot_be_is_refused_in_one_line(case: Case, tmp_path: Path) -> None:
    outcome = run(case, tmp_path)
    assert not faults(case, outcome, tmp_path)
    assert outcome.status == 1


def test_options_that_do_not_exist_are_refused(tmp_path: Path) -> None:
    case = Case("option", {}, ("new", *MILL_ENDS, "-o", "m.toml", "--sensors", "T=scale,X"))
    outcome = run(case, tmp_path)
    assert not faults(case, outcome, tmp_path)
    assert outcome.status == 2


@pytest.mark.parametrize(
    ("out", "says"),
    [
        ("there", "there"),
        ("missing/m.toml", "missing"),
        ("", ""),
        ("n" * 300 + ".toml", "nnn"),
        ("a\x00b.toml", ""),
        ("file.txt/m.toml", "file.txt"),
        ("m.toml", "--force"),
    ],
)
def test_where_nothing_can_be_written_nothing_is(out: str, says: str, tmp_path: Path) -> None:
    files = {"there/note": "mine", "file.txt": "mine", "m.toml": "mine"}
    case = Case("out", files, ("new", *MILL_ENDS, "-o", out), (says,))
    outcome = run(case, tmp_path)
    assert not faults(case, outcome, tmp_path)
    assert all((tmp_path / "work" / name).read_text() == "mine" for name in files)


@pytest.mark.parametrize(
    "words",
    [
        ("--name", f"Fräse {BINARY}"),
        ("--name", "\x00\x1b[31m\n\r\t\"'\\#]" * 20),
        ("--name", "N" * 100_000),
        ("--sensor", "T (links) [°C] = 3=other"),
    ],
    ids=["binary", "control", "long", "odd"],
)
def test_odd_names_are_refused_or_come_back(words: tuple[str, str], tmp_path: Path) -> None:
    case = Case("odd", {}, ("new", *MILL_ENDS, *words, "-o", "m.toml"), may_succeed=True)
    outcome = run(case, tmp_path)
    assert not faults(case, outcome, tmp_path)
    if outcome.status == 0:
        load_model(tmp_path / "work" / "m.toml")


def test_the_good_one_is_taken(tmp_path: Path) -> None:
    sensors = ("--sensor", "T=scale,X", "--location", "C=200,250,0", "--shape", "spline:8")
    outcome = run(Case("good", {}, ("new", *MILL_ENDS, *sensors, "-o", "m.toml")), tmp_path)
    assert outcome.status == 0, outcome.err
    model = load_model(tmp_path / "work" / "m.toml")
    assert str(model.machine.structure) == "w C' b Y X Z t"
