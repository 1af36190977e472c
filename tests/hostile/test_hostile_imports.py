"""Bad files of other programs, compensation maps, points of a display, and numbers typed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.hostile import mutate
from tests.support.hostile.forked import Case, faults, run
from tests.support.hostile.good import model

RTL = """\
HEADER::
File type: Linear
Owner: Renishaw plc
TARGET DATA::
Target-count:3
Targets :
 0.000000  100.000000
 200.000000
USER-TEXT::
Machine:Bridge
Axis:X
RUNS::
Run-count:2
DEVIATIONS::
Run Target Data:
 1 1 0.0
 1 2 1.5
 1 3 2.5
 2 3 3.0
 2 2 2.0
 2 1 1.0
"""
LONG = "position,run,direction,deviation_um\n" + "".join(
    f"{100 * i},{r},{d},{i + r}\n" for r in (1, 2) for d in "+-" for i in range(4)
)
BY_TARGET = "target,1+,1-,2+,2-\n" + "".join(
    f"{100 * i},{i},{i + 1},{i},{i + 2}\n" for i in range(5)
)
BY_RUN = "run,direction,0,100,200\n1,+,0,1,2\n1,-,1,2,3\n2,+,0,1,2\n2,-,1,2,3\n"
BALL = "# plane = XY\n# centre = 350, 450\n# radius = 100\nangle,ccw,cw\n" + "".join(
    f"{10 * i},{0.1 * i:.1f},{0.2 * i:.1f}\n" for i in range(36)
)
MAP = "".join(
    f"{axis} Axis\n\nPosition\tLx\tLy\tLz\tRx\tRy\tRz\n"
    + "".join(f"{100.0 * i:.4f}\t0.00{i}\t0\t0\t0\t0.00{i}\t0\n" for i in range(4))
    + "\n"
    for axis in "XYZ"
)
SWITCHED = '# unit = "um"\nX,Y,Z,dX,dY,dZ\n' + "".join(
    f"{90 * i},{80 * i % 290},{-40 * i % 290},0.{i}1,-0.2,0.{i}\n" for i in range(4)
)

LENGTHS = "# expansion = 11.5\nposition,calibrated,sd,temperature,x1,y1,z1,x2,y2,z2\n" + "".join(
    f"P{i},100,0.1,20.{i},0,0,{10 * i},100.001,0,{10 * i}\n" for i in range(5)
)
PLATE = "placing,ball,cx,cy,cz,x,y,z\n" + "".join(
    f"A,{i},{100 * (i % 3)},{80 * (i // 3)},0,{100 * (i % 3)}.001,{80 * (i // 3)},5\n"
    for i in range(6)
)

FIVE = """\
format = "abbe-model/1"
[machine]
name = "M"
structure = "w C' b X Y Z t"
""" + "".join(f"[machine.axes.{a}]\ntravel = [-400.0, 400.0]\n" for a in "XYZC")
RTEST = "# nest = spindle\n# sphere = 90, 40, 60\nC,dX [um],dY,dZ\n" + "".join(
    f"{30 * i},{i % 3}.5,{i % 4}.25,-{i % 2}.125\n" for i in range(12)
)

BRIDGE = FIVE.replace("C' ", "").replace("[machine.axes.C]\ntravel = [-400.0, 400.0]\n", "")

PROBED = "X,Y,Z,C\n" + "".join(
    f"{40 + x + 14.5 * i:.3f},{20 + 14.5 * j:.3f},{14.5 * k:.3f},{c}\n"
    for c, x in ((0, 0.0), (90, 1.0))
    for i, j, k in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1))
)

AT = ("--at", "Y=450,Z=-180", "-o", "out.csv", "--force")


def command(layout: str) -> tuple[str, ...]:
    """What imports a file of that layout."""
    more = ("--axis", "X", *AT) if layout == "iso230-2" else AT
    if layout == "ballbar":
        more = ("--at", "Z=-180", *AT[2:])
    if layout in ("lengths", "plate"):
        more = AT[2:]
    if layout == "map":
        more = ("--structure", "w b Y X Z t", *AT[2:])
    return ("import-campaign", "f.txt", "--as", layout, *more)


MAPPED = ("import-map", "f.txt", "--structure", "w b Y X Z t", "-o", "out.toml", "--force")
IDENTIFY = ("identify-convention", "m.txt", "f.txt", "--structure", "w b Y X Z t")
READ: dict[str, tuple[str, tuple[str, ...], str]] = {
    "rtl": (RTL, command("rtl"), "out.csv"),
    "long": (LONG, command("iso230-2"), "out.csv"),
    "by target": (BY_TARGET, command("iso230-2"), "out.csv"),
    "by run": (BY_RUN, command("iso230-2"), "out.csv"),
    "ball bar": (BALL, command("ballbar"), "out.csv"),
    "lengths": (LENGTHS, command("lengths"), "out.csv"),
    "plate": (PLATE, command("plate"), "out.csv"),
    "rotary test": (RTEST, ("iso10791", "m.toml", "f.txt", "-o", "out.csv", "--force"), "out.csv"),
    "probed": (PROBED, ("import-campaign", "f.txt", "--as", "probed", "--model", "m.toml", *AT[2:]),
               "out.csv"),
    "errors of length": (
        "position,calibrated,error 1 [um],error 2\nX,100,1,2\nY,300,1,2\n",
        ("iso10360", "f.txt", "--mpe", "3+L/300"), "",
    ),
    "map rows": (MAP, command("map"), "out.csv"),
    "map": (MAP, MAPPED, "out.toml"),
    "points": (SWITCHED, IDENTIFY, ""),
}  # fmt: skip


def files(kind: str, text: str | bytes) -> dict[str, str | bytes]:
    """The bad file and what is needed beside it."""
    beside = {"points": {"m.txt": MAP}, "rotary test": {"m.toml": FIVE}, "probed": {"m.toml": FIVE}}
    return {"f.txt": text, **beside.get(kind, {})}


def named() -> Iterator[Case]:
    """Faults by name."""
    for kind, before, after in (
        ("rtl", "Target-count:3", "Target-count:4"), ("rtl", "Target-count:3", "Target-count:x"),
        ("rtl", "1 3 2.5", "1 9 2.5"), ("rtl", "1 3 2.5", "1 0 2.5"),
        ("rtl", "1 3 2.5", "1 3 1e308"),
        ("rtl", "1 3 2.5", "1 3 nan"), ("rtl", "1 3 2.5", "1 3"), ("rtl", "200.000000", "1e308"),
        ("rtl", "200.000000", "2e9"), ("rtl", "Axis:X", "Axis:Q"), ("rtl", "1 3 2.5", "1 2 2.5"),
        ("rtl", "Run-count:2", "Run-count:" + "9" * 5000), ("rtl", "1 3 2.5", "9" * 400 + " 3 2.5"),
        ("long", "300,1,+,4", "300,1,+,1e308"), ("long", "300,1,+,4", "300,1,?,4"),
        ("long", "300,1,+,4", "1e308,1,+,4"), ("long", "300,1,+,4", "300,1e308,+,4"),
        ("long", "300,1,+,4", "300,nan,+,4"), ("long", "300,1,+,4", "300,1,+,"),
        ("long", "300,1,+,4", "300,1,+,4,5"), ("long", "deviation_um", "deviation_furlong"),
        ("by target", "100,1,2,1,3", "100,1,2,1,1e300"),
        ("by target", "100,1,2,1,3", "1e300,1,2,1,3"),
        ("by target", "1+,1-", "1+,1+x"), ("by target", "2-", "9" * 5000 + "-"),
        ("by run", "200\n", "2e300\n"), ("by run", "1,-,1,2,3", "1,-,1,2,1e18"),
        ("by run", "1,-,1,2,3", "1e308,-,1,2,3"),
        ("ball bar", "centre = 350, 450", "centre = 1e308, 4"),
        ("ball bar", "radius = 100", "radius = 1e308"), ("ball bar", "radius = 100", "radius = -1"),
        ("ball bar", "radius = 100", "radius = nan"), ("ball bar", "plane = XY", "plane = XX"),
        ("ball bar", "50,0.5,1.0", "1e308,0.5,1.0"), ("ball bar", "50,0.5,1.0", "50,1e300,1.0"),
        ("lengths", "P1,100,", "P1,1e300,"), ("lengths", "P1,100,", "P1,nan,"),
        ("lengths", "P1,100,0.1,20.1", "P1,100,0.1,1e9"), ("lengths", "x1,y1", "x1,x1"),
        ("lengths", "expansion = 11.5", "expansion = 1e9"), ("lengths", "P2,100,0.1", "P2,100,-1"),
        ("lengths", "100.001,0,20", "0,0,20"), ("lengths", "100.001,0,20", "100.001,0"),
        ("plate", "A,2,200", "A,2,1e300"), ("plate", "A,2,200,0,0,200.001", "A,2,200,0,0,nan"),
        ("plate", "A,2,200,0,0,200.001", "A,2,200,0,0,300"), ("plate", "cx,cy", "cx,cx"),
        ("errors of length", "X,100,1,2", "X,100,1e300,2"),
        ("rotary test", "60,2.5", "60,1e300"), ("rotary test", "60,2.5", "1e300,2.5"),
        ("rotary test", "60,2.5", "nan,2.5"), ("rotary test", "90, 40, 60", "90, 40"),
        ("rotary test", "90, 40, 60", "90, 40, 1e300"), ("rotary test", "spindle", "wall"),
        ("rotary test", "dX [um]", "dX [furlong]"), ("rotary test", "C,dX", "Q,dX"),
        ("probed", "54.500", "1e300"), ("probed", "54.500", "nan"), ("probed", "54.500", "55.500"),
        ("probed", "X,Y", "X,X"), ("probed", ",C", ",Q"), ("probed", "14.500,90", "9.500,90"),
        ("errors of length", "[um]", "[furlong]"), ("errors of length", "X,100", "X,0"),
        ("map rows", "100.0000\t0.001", "100.0000\t1e300"),
        ("map", "100.0000\t0.001", "1e300\t0.001"),
        ("map", "100.0000\t0.001", "100.0000\t1e300"), ("map", "100.0000\t0.001", "nan\t0.001"),
        ("map", "100.0000\t0.001", "0.0000\t0.001"), ("map", "Y Axis", "X Axis"),
        ("map", "Y Axis", "Q Axis"), ("map", "Lx\tLy", "Ly\tLx"), ("map", "0.002\t0\n", "\n"),
        ("map", "200.0000", "1e-300"), ("points", "90,80", "1e308,80"), ("points", "0.11", "1e300"),
        ("points", "0.11", "nan"), ("points", "dX", "qX"),
    ):  # fmt: skip
        good, arguments, out = READ[kind]
        assert before in good, (kind, before)
        text = good.replace(before, after, 1)
        kept = (out,) if out else ()
        yield Case(f"{kind}: {after[:24]!r}", files(kind, text), arguments, ("f.txt",), kept=kept)


def certificates() -> Iterator[Case]:
    """Certificates of ball plates, by name."""
    good = "# diameter = 22\n# sd = 0.3\nball,cx,cy,cz\n1,0,0,0\n2,90,0,0\n3,0,80,0\n4,90,80,0\n"
    plan = ("plan", "m.toml", "--instruments", "ball-plate", "--plate", "f.txt", "-o", "out.toml",
            "--force")  # fmt: skip
    for before, after in (
        ("# diameter = 22\n", ""), ("22", "1e300"), ("22", "nan"), ("22", "-22"), ("0.3", "-1"),
        ("2,90", "2,1e300"), ("2,90,0,0", "2,90,0"), ("2,90", "2,nan"), ("2,90", "1,90"),
        ("cx,cy", "cx,cx"), ("cz", "z"), ("3,0,80,0\n4,90,80,0\n", ""), ("2,90", "\x00"),
        ("3,0,80,0\n4,90,80,0", "3,45,0,0"), (good[2:], ""),
    ):  # fmt: skip
        text = good.replace(before, after, 1)
        assert text != good, before
        files = {"f.txt": text, "m.toml": BRIDGE}
        yield Case(f"certificate: {after[:24]!r} {before[:9]!r}", files, plan, ("f.txt",),
                   kept=("out.toml",))  # fmt: skip


def gauges() -> Iterator[Case]:
    """Certificates of gauge blocks and step gauges, by name."""
    good = "# width = 9\n# height = 35\n# sd = 0.1\nface,at\n1,0\n2,20\n3,40\n4,60\n"
    plan = ("plan", "m.toml", "--instruments", "step-gauge", "--gauge", "f.txt", "-o", "out.toml",
            "--force")  # fmt: skip
    for before, after in (
        ("# width = 9\n", ""), ("# height = 35\n", ""), ("35", "1e300"), ("9", "-9"), ("0.1", "-1"),
        ("2,20", "2,1e300"), ("2,20", "2,nan"), ("2,20", "2"), ("2,20", "1,20"), ("1,0", "1,5"),
        ("3,40", "3,20.5"), ("3,40", "3,-40"), ("4,60\n", ""), ("face,at", "face,face"),
        ("at", "where"), ("2,20", "\x00"), ("1,0\n2,20\n3,40\n4,60\n", ""),
    ):  # fmt: skip
        text = good.replace(before, after, 1)
        assert text != good, before
        files = {"f.txt": text, "m.toml": BRIDGE}
        yield Case(f"gauge: {after[:24]!r} {before[:9]!r}", files, plan, ("f.txt",),
                   kept=("out.toml",))  # fmt: skip


def mutated() -> Iterator[Case]:
    """Good files damaged by a machine."""
    for seed, (kind, (text, arguments, out)) in enumerate(READ.items()):
        good = text.encode()
        damaged = [
            *list(mutate.whole(good))[seed % 3 :: 3], *mutate.flipped(good, 7, 100 + seed),
            *mutate.cut(good, 3, 200 + seed), *mutate.lines_mixed(good, 3, 300 + seed),
            *mutate.numbers_replaced(good, 8, 400 + seed), *mutate.harmless(good),
        ]  # fmt: skip
        for name, content in damaged:
            kept = (out,) if out else ()
            yield Case(f"{kind}: {name}", files(kind, content), arguments, (), True, kept, cpu=8.0)


def typed() -> Iterator[Case]:
    """Numbers on the command line that are none, or absurd."""
    point = ("correct", "m.toml", "Y=200", "Z=-30")
    table = ("table", "m.toml", "--controller", "csv", "-o", "tables", "--at", "T_x=20")
    rtl = ("import-campaign", "f.txt", "--as", "rtl", "-o", "out.csv", "--force")
    for arguments, says in (
        ((*point, "X=1e308", "T_x=21"), "'X'"), ((*point, "X=1e6", "T_x=21"), "'X'"),
        ((*point, "X=nan", "T_x=21"), "'X'"), ((*point, "X=100", "T_x=293"), "'T_x'"),
        ((*point, "X=100", "T_x=1e300"), "'T_x'"),
        ((*point, "X=1", "T_x=21", "tool=0,0,1e5"), "'tool'"),
        ((*point, "X=1", "T_x=21", "tool=0,0"), "'tool'"),
        ((*point, "X=1", "T_x=21", "X_dir=2"), "'X_dir'"),
        ((*point, "X=1", "T_x=21", "time=1e300"), "'time'"),
        ((*point, "X=1", "X=2", "T_x=21"), "twice"),
        ((*table[:-1], "T_x=293"), "'T_x'"), ((*table, "--tool", "0,0,1e300"), "'tool'"),
        ((*table, "--volume", "X=0,1e300"), "volume X"),
        ((*table, "--volume", "X=nan,1"), "volume X"),
        ((*table, "--tolerance", "nan"), "--tolerance"),
        ((*table, "--tolerance", "inf"), "--tolerance"),
        ((*table, "--tolerance", "-1"), "--tolerance"), ((*table, "--points", "-1"), "--points"),
        ((*table, "--points", "1000000000"), "--points"), ((*table, "--change", "inf"), "--change"),
        ((*table, "--idle", "nan"), "--idle"), ((*table, "--duration", "inf"), "--duration"),
        (("upload", "c.toml", "t", "--max-change", "inf"), "--max-change"),
        (("upload", "c.toml", "t", "--max-change", "nan"), "--max-change"),
        (("upload", "c.toml", "t", "--max-change", "0"), "--max-change"),
        (("run", "c.toml", "--duration", "inf"), "--duration"),
        (("run", "c.toml", "--duration", "nan"), "--duration"),
        (("demo", "--duration", "1e300"), "--duration"), (("demo", "--seed", "-1"), "--seed"),
        ((*rtl, *AT[:2], "--sd", "-1"), "--sd"), ((*rtl, *AT[:2], "--sd", "inf"), "--sd"),
        ((*rtl, *AT[:2], "--sd", "0"), "--sd"), ((*rtl, *AT[:2], "--sd", "1e300"), "--sd"),
        ((*rtl, *AT[:2], "--sign", "7"), "--sign"), ((*rtl, "--at", "Y=1e300,Z=0"), "'Y'"),
        ((*rtl, "--at", "Y=inf,Z=0"), "'Y'"), ((*rtl, *AT[:2], "--tool", "0,0,1e300"), "'tool'"),
        ((*rtl, *AT[:2], "--signal", "T=1e300"), "'T'"), ((*rtl, *AT[:2], "--unit", "kg"), "unit"),
        (("identify-convention", "m.txt", "p.csv", "--tolerance", "inf"), "--tolerance"),
    ):  # fmt: skip
        beside = {"m.toml": model(), "f.txt": RTL, "m.txt": MAP, "p.csv": SWITCHED}
        kept = ("out.csv",) if "out.csv" in arguments else ()
        title = " ".join(arguments[-2:])
        yield Case(f"typed: {arguments[0]} {title}", beside, arguments, (says,), kept=kept)


CASES = [*named(), *certificates(), *gauges(), *mutated(), *typed()]


@pytest.mark.one_in(24)
@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_bad_file_of_others_is_reported_in_one_line(case: Case, tmp_path: Path) -> None:
    outcome = run(case, tmp_path)
    assert not faults(case, outcome, tmp_path)


@pytest.mark.parametrize("kind", READ)
def test_the_good_one_is_read(kind: str, tmp_path: Path) -> None:
    text, arguments, _ = READ[kind]
    outcome = run(Case(kind, files(kind, text), arguments), tmp_path)
    assert outcome.status == 0, outcome.err
