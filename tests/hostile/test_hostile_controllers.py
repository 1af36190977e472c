"""Bad tables of controllers, as `abbe table --on` reads them, and bad INI files of LinuxCNC."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.daemon.arguments.tables.arguments import MOST_BYTES, present_files
from abbe.drivers.controllers import make_controller
from abbe.drivers.link import LinkConfigError
from abbe.drivers.stores.linuxcnc.ini import read_layout
from tests.support.hostile import mutate
from tests.support.hostile.forked import Case, Content, faults, run
from tests.support.hostile.good import MODEL, model

DATA = Path(__file__).parents[1] / "data" / "controllers"
READ: dict[str, tuple[str, dict[str, str]]] = {
    "linuxcnc/x.comp": ("linuxcnc", {}),
    "linuxcnc-trims/x.comp": ("linuxcnc", {"type": "1"}),
    "fanuc/pitch.txt": ("fanuc", {}),
    "weihong/axeserr.dat": ("weihong", {}),
    "pmac/comp.pmc": ("pmac", {}),
    "heidenhain-nd/nd-x.txt": ("heidenhain-nd", {}),
    "heidenhain-tnc/y.com": ("heidenhain-tnc", {}),
    "aerotech-2d/calibration.cal": ("aerotech-2d", {}),
    "siemens-840d/nc_cec.ini": ("siemens-840d", {}),
    "siemens-840d/ax_eec.ini": ("siemens-840d", {}),
    "siemens-840d-products/nc_cec.ini": ("siemens-840d", {"products": "mirrored"}),
    "twincat-isg/volcomp1.lis": ("twincat-isg", {}),
    "twincat-isg-axes/achskw1.lis": ("twincat-isg", {"form": "axes"}),
    "etalon-exchange/volcomp.txt": ("etalon-exchange", {}),
    "cmm-map/map.txt": ("cmm-map", {}),
    "csv/x.csv": ("csv", {}),
    "grid-csv/grid-xyz.csv": ("grid-csv", {}),
}
"""Good file → its dialect and options."""
KINDS = sorted({kind for kind, _ in READ.values()})
TRAVELS = {"X": (-100.0, 100.0), "Y": (0.0, 100.0), "Z": (-50.0, 0.0)}
SMALL = MODEL.replace("[0.0, 700.0]", "[-100.0, 100.0]").replace("[0.0, 900.0]", "[0.0, 100.0]")
SMALL = model(SMALL.replace("[-360.0, 0.0]", "[-50.0, 0.0]"))


def read(kind: str, path: str, options: dict[str, str]) -> None:
    """What `abbe table --on` reads."""
    structure = Structure.parse("w b X Y Z t")
    machine = Machine("golden", structure, {a: Axis(a, TRAVELS[a]) for a in structure.axes})
    controller = make_controller(kind, machine, options)
    for table in controller.read(present_files(Path(path), kind)):
        values = np.concatenate([n.ravel() for n in (*table.nodes, table.forward, table.downward)])
        assert np.isfinite(values).all()


def command(kind: str, options: dict[str, str], on: str) -> tuple[str, ...]:
    """The whole command."""
    settings = [word for k, v in options.items() for word in ("--set", f"{k}={v}")]
    return ("table", "m.toml", "--controller", kind, "-o", "made", "--at", "T_x=20", "--on", on,
            *settings)  # fmt: skip


def good(name: str) -> bytes:
    return (DATA / name).read_bytes()


def too_large(path: Path) -> None:
    """A file without content that is larger than any table, and takes no room on the disk."""
    with path.open("wb") as stream:
        stream.truncate(MOST_BYTES + 1)


DIGITS = b"9" * 5000


def named() -> Iterator[Case]:
    """Faults by name, through the whole command."""
    changes: tuple[tuple[str, bytes, bytes], ...] = (
        ("linuxcnc/x.comp", b"100.015", b"1e308"), ("linuxcnc/x.comp", b"-100.0", b"-1e300"),
        ("linuxcnc/x.comp", b"100.0", DIGITS), ("fanuc/pitch.txt", b"N03620", b"N" + DIGITS),
        ("fanuc/pitch.txt", b"A1P", b"A" + DIGITS + b"P"),
        ("fanuc/pitch.txt", b"P", b"P" + DIGITS), ("fanuc/pitch.txt", b"%", b"%%"),
        ("pmac/comp.pmc", b"COMP 11", b"COMP " + DIGITS),
        ("pmac/comp.pmc", b"110000", b"0"), ("pmac/comp.pmc", b"110000", DIGITS),
        ("pmac/comp.pmc", b"110000", b"9" * 12), ("pmac/comp.pmc", b"#2D", b"#" + DIGITS + b"D"),
        ("pmac/comp.pmc", b"-16", b"-" + DIGITS), ("pmac/comp.pmc", b"-16", b"-" + b"9" * 300),
        ("siemens-840d/nc_cec.ini", b"CEC[0,0", b"CEC[0," + DIGITS),
        ("siemens-840d/nc_cec.ini", b"CEC[0,0", b"CEC[" + DIGITS + b",0"),
        ("siemens-840d/nc_cec.ini", b"CEC[0,0", "CEC[٣,0".encode()),
        ("siemens-840d/nc_cec.ini", b"STEP[0]=", b"STEP[0]=1e-308;"),
        ("siemens-840d/nc_cec.ini", b"MAX[0]=", b"MAX[0]=1e308;"),
        ("siemens-840d/nc_cec.ini", b"STEP[0]=", b"STEP[0]=nan;"),
        ("grid-csv/grid-xyz.csv", b"50", b"1e308"), ("csv/x.csv", b"0.0015", b"1e308"),
    )  # fmt: skip
    for name, before, after in changes:
        kind, options = READ[name]
        text = good(name)
        assert before in text, (name, before)
        file = name.partition("/")[2]
        files: dict[str, Content] = {"m.toml": SMALL, file: text.replace(before, after, 1)}
        title = f"{name}: {after[:24].decode()!r}"
        yield Case(title, files, command(kind, options, file), (file,))
    head, _ = good("grid-csv/grid-xyz.csv").decode().split("dC [deg]\n")
    loose = "".join(f"{i / 100},{i / 100},{i / 100},0,0,0,0,0,0\n" for i in range(2000))
    contents: tuple[tuple[str, str, Content, str], ...] = (
        ("points in no grid", "grid-csv", head + "dC [deg]\n" + loose, "full grid"),
        ("an empty folder", "linuxcnc", Path.mkdir, "no files"),
        ("a link to itself", "pmac", lambda path: path.symlink_to(path), "on.txt"),
        *((("larger than any table", kind, too_large, "too large")) for kind in KINDS),
    )
    for title, kind, content, says in contents:
        files = {"m.toml": SMALL, "on.txt": content}
        yield Case(f"{kind}: {title}", files, command(kind, {}, "on.txt"), (says,))
    for name in ("pmac/comp.pmc", "cmm-map/map.txt", "fanuc/pitch.txt", "weihong/axeserr.dat"):
        two: dict[str, Content] = {"on/1": good(name), "on/2": good(name)}
        order = command(READ[name][0], {}, "on")
        yield Case(f"{name}: two", {"m.toml": SMALL, **two}, order, ("more than one file",))


def mutated() -> Iterator[Case]:
    """Good files damaged by a machine."""
    for seed, (name, (kind, options)) in enumerate(READ.items()):
        data = good(name)
        damaged = [
            *list(mutate.whole(data))[seed % 4 :: 4], *mutate.flipped(data, 1, 100 + seed),
            *mutate.cut(data, 1, 200 + seed), *mutate.lines_mixed(data, 1, 300 + seed),
            *mutate.numbers_replaced(data, 4, 400 + seed), *mutate.harmless(data),
        ]  # fmt: skip
        file = name.partition("/")[2]
        for title, content in damaged:
            reader = partial(read, kind, file, options)
            yield Case(f"{name}: {title}", {file: content}, reader, (), may_succeed=True)


INI = (Path(__file__).parents[2] / "examples" / "linuxcnc" / "mill.ini").read_bytes()
for _axis, _joint in zip(b"xyz", b"012", strict=True):
    _head = b"[JOINT_%c]\n" % _joint
    INI = INI.replace(_head, _head + b"COMP_FILE = comp/current/%c.comp\n" % _axis)


def layout(path: str) -> None:
    """What a store asks of an INI file; of the lines that mend it the first will do."""
    try:
        asyncio.run(read_layout("/usr/bin/python3", Path(path)))
    except LinkConfigError as error:
        raise LinkConfigError(str(error).splitlines()[0]) from None


def bad_ini() -> Iterator[Case]:
    """An INI file that LinuxCNC's own parser makes something of."""
    for before, after in (
        (b"JOINTS = 3", b"JOINTS = 1000000000"), (b"JOINTS = 3", b"JOINTS = -1"),
        (b"JOINTS = 3", b"JOINTS = " + DIGITS), (b"JOINTS = 3", b"JOINTS = three"),
        (b"JOINTS = 3", b"JOINTS = 0"),
        (b"current/x.comp", b"current/" + b"x" * 3000), (b"current/x.comp", b"\xff\xfe"),
        (b"current/x.comp", b"other/x.comp"), (b"current/x.comp", b"current/q.comp"),
        (b"COMP_FILE =", b"COMP_FILE_TYPE = nan\nCOMP_FILE ="),
    ):  # fmt: skip
        assert before in INI
        files: dict[str, Content] = {"mill.ini": INI.replace(before, after, 1)}
        yield Case(f"INI: {after[:30]!r}", files, partial(layout, "mill.ini"), ("mill.ini",))
    for title, content in (("a folder", Path.mkdir), ("too large", too_large)):
        yield Case(f"INI: {title}", {"mill.ini": content}, partial(layout, "mill.ini"))
    for title, bad in (
        *mutate.whole(INI), *mutate.harmless(INI), *mutate.flipped(INI, 4, 1),
        *mutate.cut(INI, 3, 2), *mutate.numbers_replaced(INI, 3, 3),
    ):  # fmt: skip
        reader = partial(layout, "mill.ini")
        yield Case(f"INI: {title}", {"mill.ini": bad}, reader, may_succeed=True)


CASES = [*named(), *mutated(), *bad_ini()]


@pytest.mark.one_in(12)
@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_bad_table_is_reported_in_one_line(case: Case, tmp_path: Path) -> None:
    outcome = run(case, tmp_path)
    assert not faults(case, outcome, tmp_path)


@pytest.mark.one_in(9)
@pytest.mark.parametrize("name", READ)
def test_the_good_one_is_read(name: str, tmp_path: Path) -> None:
    kind, options = READ[name]
    file = name.partition("/")[2]
    whole = command(kind, options, file)
    # as PMAC is set there are fewer owners of tables than a new set needs beside this one
    reader = partial(read, kind, file, options) if kind == "pmac" else whole
    outcome = run(Case(name, {"m.toml": SMALL, file: good(name)}, reader), tmp_path)
    assert outcome.status == 0, outcome.err


def test_the_good_ini_file_is_read(tmp_path: Path) -> None:
    outcome = run(Case("", {"mill.ini": INI}, partial(layout, "mill.ini")), tmp_path)
    assert outcome.status == 0, outcome.err
