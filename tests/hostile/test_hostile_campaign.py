"""Bad campaigns, files of points, and fits of them: told in one line, no model lost."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support.hostile import mutate
from tests.support.hostile.forked import CPU, Case, faults, run
from tests.support.hostile.good import CAMPAIGN, POINTS, UNFITTED, model

HEADER = CAMPAIGN.splitlines().index(next(r for r in CAMPAIGN.splitlines() if r[:4] == "time")) + 1
COLUMNS = CAMPAIGN.splitlines()[HEADER - 1].split(",")
FIT = ("fit", "m.toml", "c.csv", "-o", "out.toml", "--report", "out.html", "--force")
CORRECT = ("correct", "m.toml", "--points", "p.csv", "-o", "out.csv", "--force")
READ = (
    FIT,
    ("compare", "m.toml", "c.csv", "--json"),
    ("iso230", "c.csv", "--model", "m.toml", "--json"),
    FIT,
    ("iso230", "c.csv"),
)


def fit(name: str, text: str | bytes, *says: str, command: tuple[str, ...] = FIT) -> Case:
    """A fit of a bad campaign; what was at its outputs stays."""
    files = {"m.toml": UNFITTED, "c.csv": text}
    kept = ("out.toml", "out.html") if command is FIT else ()
    return Case(name, files, command, ("c.csv", *says), kept=kept)


def cell(column: str, text: str, *says: str, row: int = 5) -> Case:
    """The good campaign with one cell changed; row and column are named."""
    lines = CAMPAIGN.splitlines()
    cells = lines[HEADER + row].split(",")
    cells[COLUMNS.index(column)] = text
    lines[HEADER + row] = ",".join(cells)
    where = (f"line {HEADER + row + 1}", f"field '{column}'")
    return fit(f"{column} = {text[:12]}", "\n".join(lines) + "\n", *where, *says)


def cells() -> Iterator[Case]:
    """One cell wrong."""
    huge = ("1e308", "-1e308", "1e300", "1e18")
    for column in ("time", "X", "Y", "tool_z", "value", "T_x"):
        for text in huge:
            yield cell(column, text, f"found '{text}'", "expected")
        for text in ("nan", "inf", "1,5", "abc", "1e999", "9" * 400, "0x10", "٣", "1_000", "--1"):
            if text != "1,5":
                yield cell(column, text, "not a number")
    for text in ("1e-300", "1e300", "0", "-1", "1e-30", "nan"):
        yield cell("sd", text)
    yield cell("X", "1e6", "axis X travels from 0 to 700")
    yield cell("T_x", "293.15", "-30 to 100 degC")
    yield cell("tool_x", "1e5", "-5000 to 5000 mm")
    for text in ("2", "32767", "0.5", "-32768"):
        yield cell("X_dir", text, "1, -1, or 0")
    yield cell("kind", "speed", "displacement")
    yield cell("setup", "", "a name")
    yield cell("tool", "T9", "T1")
    for text in ("2", "1e300", "0"):
        lines = CAMPAIGN.replace(",1,0,0,", f",{text},0,0,", 1)
        yield fit(f"ux = {text}", lines, "unit vector" if text != "1e300" else "-1 to 1")


def head() -> Iterator[Case]:
    """Metadata and header wrong."""
    first = '# format = "abbe-campaign/1"'
    for name, text in (
        ("no format", CAMPAIGN.replace(first + "\n", "")),
        ("another format", CAMPAIGN.replace(first, '# format = "abbe-campaign/9"')),
        ("format a number", CAMPAIGN.replace(first, "# format = 1")),
        ("metadata no TOML", CAMPAIGN.replace("# [setups.x1]", "# [setups.x1")),
        ("free unknown", CAMPAIGN.replace('["zero"]', '["nil"]')),
        ("free twice", CAMPAIGN.replace('["zero"]', '["zero", "zero"]')),
        ("free a text", CAMPAIGN.replace('["zero"]', '"zero"')),
        ("zeros unordered", CAMPAIGN.replace('["zero"]', '["zero"]\n# zeros_at = [2.0, 1.0]')),
        ("zeros of a known zero", CAMPAIGN.replace('["zero"]', "[]\n# zeros_at = [2.0]")),
        ("zeros NaN", CAMPAIGN.replace('["zero"]', '["zero"]\n# zeros_at = [nan]')),
        ("zeros a number", CAMPAIGN.replace('["zero"]', '["zero"]\n# zeros_at = 2.0')),
        (
            "zeros without a clock",
            CAMPAIGN.replace('["zero"]', '["zero"]\n# zeros_at = [2.0]').replace("time,", "T_z,"),
        ),
        ("setups a number", CAMPAIGN.replace("# [setups.x1]\n# free = ", "# setups = ")),
        ("base of two", CAMPAIGN.replace("[10.0, 20.0, -400.0]", "[10.0, 20.0]")),
        ("base of texts", CAMPAIGN.replace("[10.0, 20.0, -400.0]", '["a", "b", "c"]')),
        ("base far away", CAMPAIGN.replace("[10.0, 20.0, -400.0]", "[10.0, 20.0, 1e300]")),
        ("base NaN", CAMPAIGN.replace("[10.0, 20.0, -400.0]", "[10.0, 20.0, nan]")),
        ("base true", CAMPAIGN.replace("[10.0, 20.0, -400.0]", "[10.0, 20.0, true]")),
        ("tool far away", CAMPAIGN.replace("[0.0, 0.0, -150.0]", "[0.0, 0.0, -1e9]")),
        ("tool's free unknown", CAMPAIGN.replace('["z"]', '["q"]')),
        ("key unknown", CAMPAIGN.replace("# [setups.x1]", "# [setups.x1]\n# colour = 1")),
        ("deep metadata", "# x = " + "[" * 9000 + "\n" + CAMPAIGN),
        ("a column twice", CAMPAIGN.replace(",ux,uy,", ",ux,ux,")),
        ("a column of no name", CAMPAIGN.replace(",ux,uy,", ",ux,,")),
        ("an axis too many", CAMPAIGN.replace(",T_x,", ",W,")),
        ("no signal", CAMPAIGN.replace(",T_x,", ",T_y,")),
        ("no axis", CAMPAIGN.replace(",Z,", ",zz,")),
        ("semicolons", CAMPAIGN.replace(",", ";")),
        ("a quoted header cut off", CAMPAIGN.replace("time,", '"time,')),
        ("header only", "\n".join(CAMPAIGN.splitlines()[:HEADER]) + "\n"),
        ("metadata only", "\n".join(CAMPAIGN.splitlines()[: HEADER - 1]) + "\n"),
        ("ten thousand columns", CAMPAIGN.replace(",T_x,", ",T_x," + "," * 10_000)),
        ("metadata below", CAMPAIGN + "# more = 1\n"),
    ):
        assert text != CAMPAIGN, name
        yield fit(name, text)


def gauges() -> Iterator[Case]:
    """What rows were measured against."""

    def with_columns(names: str, cells: Callable[[int], str]) -> str:
        lines = CAMPAIGN.splitlines()
        lines[HEADER - 1] += names
        for i in range(HEADER, len(lines)):
            lines[i] += cells(i)
        return "\n".join(lines) + "\n"

    yield fit("gauges without uncertainty", with_columns(",gauge", lambda i: ",a"), "'gauge_sd'")
    yield fit("uncertainties of no gauge", with_columns(",gauge_sd", lambda i: ",1"), "'gauge'")
    for text in ("0", "-1", "nan", "inf", "1e308", "abc", "", "1e-300"):
        bad = with_columns(",gauge,gauge_sd", lambda i, text=text: f",a,{text}")
        yield fit(f"gauge_sd = {text}", bad, "field 'gauge_sd'")
    yield fit(
        "a thousand gauges and more",
        with_columns(",gauge,gauge_sd", lambda i: f",g{i},0.1").rstrip("\n")
        + "".join(f"\n{CAMPAIGN.splitlines()[-1]},h{i},0.1" for i in range(1000)),
        "too many gauges",
    )


def large() -> Iterator[Case]:
    """Files that are large, or not files."""

    def sparse(path: Path) -> None:
        with path.open("wb") as stream:
            stream.truncate(600_000_000)

    def one_line(path: Path) -> None:
        path.write_bytes(b"a," * 20_000_000)

    def comments(path: Path) -> None:
        path.write_bytes(b"# x\n" * 4_000_000)

    def long_cell(path: Path) -> None:
        path.write_text(CAMPAIGN + '"' + "x" * 30_000_000 + '"\n')

    def folder(path: Path) -> None:
        path.mkdir()

    for name, make in (
        ("600 MB of zero bytes", sparse), ("one line of 40 MB", one_line),
        ("metadata without end", comments), ("a cell of 30 MB", long_cell), ("a folder", folder),
    ):  # fmt: skip
        for command, file in ((FIT, "c.csv"), (CORRECT, "p.csv")):
            kept = tuple(a for a in command if a.startswith("out."))
            files = {"m.toml": UNFITTED if file == "c.csv" else model(), file: make}
            yield Case(f"{name}: {command[0]}", files, command, (file,), kept=kept)


def values() -> Iterator[Case]:
    """Campaigns that are read, and of which nothing, or nothing much, can be fitted."""
    rows = CAMPAIGN.splitlines()[HEADER:]
    top = "\n".join(CAMPAIGN.splitlines()[:HEADER]) + "\n"
    at = COLUMNS.index

    def every(column: str, text: str) -> str:
        made = []
        for row in rows:
            parts = row.split(",")
            parts[at(column)] = text
            made.append(",".join(parts))
        return top + "\n".join(made) + "\n"

    apart = [r.replace(",x", f",s{i}", 1) for i, r in enumerate(rows)]
    at_base = [f"{i},d,distance,10,20,-250,0,0,0,-150,,,,0.1,0.001,20,,B1" for i in range(9)]
    for name, text in (
        ("all values 0", every("value", "0")),
        ("all at one place", every("X", "100")),
        ("all at one temperature", every("T_x", "20")),
        ("all at one time", every("time", "0")),
        ("one row", top + rows[0] + "\n"),
        ("two rows", top + "\n".join(rows[:2]) + "\n"),
        ("the least uncertainties", every("sd", "1e-6")),
        ("the greatest uncertainties", every("sd", "1e5")),
        ("no uncertainties", every("sd", "")),
        ("the greatest values", every("value", "99999")),
        ("across the axis", top + "\n".join(rows).replace(",1,0,0,", ",0,1,0,") + "\n"),
        ("each row a set-up", top + "\n".join(apart) + "\n"),
        ("distances to a base in the point", top + "\n".join(at_base) + "\n"),
    ):  # fmt: skip
        for command in (FIT, READ[1], READ[2], ("diagnose", "m.toml", "c.csv")):
            files = {"m.toml": UNFITTED, "c.csv": text}
            kept = ("out.toml", "out.html") if command is FIT else ()
            cpu = 12.0 if command[0] == "diagnose" else CPU  # a good campaign takes 1.5 s
            yield Case(f"{name}: {command[0]}", files, command, (), True, kept, cpu)


def points() -> Iterator[Case]:
    """Bad files of points for ``abbe correct``."""

    def case(name: str, text: str | bytes, *says: str, may: bool = False) -> Case:
        files = {"m.toml": model(), "p.csv": text}
        return Case(f"points: {name}", files, CORRECT, ("p.csv", *says), may, ("out.csv",))

    for before, after, says in (
        ("600,20", "1e308,20", "line 3"), ("600,20", "nan,20", "line 3"),
        ("600,20", ",20", "line 3"),
        ("600,20", "1e6,20", "axis X travels"), ("600,20", "abc,20", "not a number"),
        ("21.5", "293.15", "degC"), ("21.5", "-1e300", "degC"), ("21.5", "", "line 3"),
        ("-1,0,0,-80", "2,0,0,-80", "1, -1, or 0"), ("-1,0,0,-80", "32767,0,0,-80", "1, -1, or 0"),
        ("-1,0,0,-80", "-1,0,0,-1e5", "5000 mm"), ("-1,0,0,-80", "-1,0,0,1e300", "5000 mm"),
        ("X_dir", "X", "twice"), ("T_x", "T_y", "T_x"), (",Y,", ",V,", "line 1"),
        ('"second, quoted"', '"second, quoted', "line 3"), ("remark", "X_corrected", "line 1"),
        ("first", "first,more", "line 2"), ("name,X", "name;X", ""),
    ):  # fmt: skip
        assert before in POINTS, before
        yield case(f"{before} → {after}", POINTS.replace(before, after, 1), says)
    yield case("header only", POINTS.splitlines()[0] + "\n", "no points")
    good = POINTS.encode()
    for name, content in (
        *mutate.whole(good), *mutate.flipped(good, 15, 11), *mutate.cut(good, 5, 12),
        *mutate.numbers_replaced(good, 15, 14),
    ):  # fmt: skip
        yield case(name, content, may=True)


def mutated() -> Iterator[Case]:
    """The good campaign damaged by a machine."""
    good = CAMPAIGN.encode()
    damaged = [
        *mutate.whole(good), *mutate.flipped(good, 40, 21), *mutate.cut(good, 12, 22),
        *mutate.lines_mixed(good, 12, 23), *mutate.numbers_replaced(good, 50, 24),
    ]  # fmt: skip
    for i, (name, content) in enumerate(damaged):
        command = READ[i % len(READ)]
        kept = ("out.toml", "out.html") if command is FIT else ()
        files = {"m.toml": UNFITTED, "c.csv": content}
        yield Case(name, files, command, ("c.csv",), True, kept)


CASES = [*cells(), *head(), *gauges(), *large(), *values(), *points(), *mutated()]


@pytest.mark.one_in(12)
@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_bad_campaign_is_reported_in_one_line(case: Case, tmp_path: Path) -> None:
    outcome = run(case, tmp_path)
    assert not faults(case, outcome, tmp_path)
    if outcome.status == 0 and "out.toml" in case.kept:
        from abbe.compcore.files.model_file import load_model

        load_model(tmp_path / "work" / "out.toml")
