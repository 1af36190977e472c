"""Bad configurations, plugin packages and journals of uploads: told in one line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.hostile import mutate
from tests.support.hostile.forked import Case, faults, run

EXAMPLES = Path(__file__).parents[2] / "examples"
CONFIG = (EXAMPLES / "bridge-cmm" / "config.toml").read_text(encoding="utf-8")
MODEL = (EXAMPLES / "bridge-cmm" / "model.toml").read_text(encoding="utf-8")
MILL = (EXAMPLES / "upload" / "mill.toml").read_text(encoding="utf-8")
MILL_MODEL = (EXAMPLES / "upload" / "model.toml").read_text(encoding="utf-8")
CHECK = ("check", "c.toml")

NUMBERS = ("1e300", "-1.0", "nan", "inf", "true", '"1"', "[1.0]")


def changed(before: str, after: str, *says: str) -> Case:
    """The bridge's configuration with one thing changed."""
    assert before in CONFIG, before
    text = CONFIG.replace(before, after, 1)
    return Case(f"{after[:50]}", {"c.toml": text, "model.toml": MODEL}, CHECK, ("c.toml", *says))


def mill(before: str, after: str, *says: str) -> Case:
    """The mill's configuration, with an upload, with one thing changed."""
    assert before in MILL, before
    text = MILL.replace(before, after, 1)
    files = {"c.toml": text, "model.toml": MILL_MODEL}
    return Case(f"mill: {after[:50]}", files, CHECK, ("c.toml", *says))


def numbers() -> Iterator[Case]:
    """Numbers that are none, or beyond all sense."""
    for section, key, value in (
        ("guard", "max_correction", "0.1"), ("guard", "max_rate", "0.5"), ("guard", "hold", "1.0"),
        ("guard", "ramp", "2.0"), ("guard", "stale_after", "0.3"),
        ("guard", "signals_stale_after", "5.0"), ("cycle", "period", "0.02"),
        ("cycle", "signals_every", "0.25"), ("controller", "heartbeat_within", "1.0"),
    ):  # fmt: skip
        for number in NUMBERS:
            yield changed(f"{key} = {value}", f"{key} = {number}", "line", f"{section}.{key}")
    for key in ("max_turn", "max_turn_rate"):
        for number in (*NUMBERS, "{ C = -1.0 }", "{ C = 1e300 }"):
            yield changed("hold = 1.0", f"{key} = {number}\nhold = 1.0", "line", f"guard.{key}")
    yield changed("hold = 1.0", "max_turn = { C = 0.1 }\nhold = 1.0", "line", "guard.max_turn.C")
    for number in ("0", "-1.0", "nan", "inf", "true", '"1"', "1e300"):
        yield changed(
            'source = "cmm.R_T_x1"\n', f"entered_for = {number}\n#", "line", "signals.T_x1"
        )
    for number in ("0", "-1.0", "nan", "inf", "true", '"1"', "1e300"):
        for key in ("look_every", "false_alarm_every"):
            line = f"[checks]\n{key} = {number}\n[journal]"
            yield changed("[journal]", line, "line", f"checks.{key}")
        point = f'[checks.points.a]\ntrigger = "cmm.sample"\nreference = "X"\nsd = {number}\n'
        if number != "1e300":
            yield changed("[journal]", f"{point}[journal]", "line", "checks.points.a.sd")
    for number in ("-1", "65536", "4.0", "true", '"4"', "1e300"):
        yield changed("require = 4", f"require = {number}", "line", "controller.require")
    for number in ("0", "-1.0", "1e300", "nan", "inf", "true"):
        yield changed("timeout = 0.3", f"timeout = {number}", "links.cmm")
    for number in ("0", "-1", "65536", "1e300", "nan", "true"):
        yield changed("port = 5020\nunit", f"port = {number}\nunit", "links.cmm")
    for number in ("0", "nan", "inf", "true", '"1"'):
        yield changed("counts_per_mm = 10000", f"counts_per_mm = {number}", "axes.X")
        yield changed("scale = 0.1", f"scale = {number}", "links.cmm")
    for number in ("nan", "inf", "true", "[700, 0]", "[0, nan]", "[0, true]", "[0]"):
        yield changed("travel = [0, 700]", f"travel = {number}", "axes.X")
    for number in ("nan", "inf", "true", "-1e-3", '"a"'):
        yield changed("a = 1.032e-3", f"a = {number}", "signals.T_x1")
    for number in ("-1", "70000", "1.5", "true", '"x"'):
        yield changed("address = 0, type", f"address = {number}, type", "links.cmm")
    for key, value in (
        ("max_entry_um", "40.0"), ("max_change_um", "20.0"), ("effect_tolerance_um", "0.5"),
    ):  # fmt: skip
        for number in NUMBERS:
            yield mill(f"{key} = {value}", f"{key} = {number}", "line", f"upload.{key}")


def words() -> Iterator[Case]:
    """Names that lead nowhere, keys that nobody knows, sections of another kind."""
    for before, after, says in (
        ('driver = "modbus"', 'driver = "modbusx"', "modbusx"),
        ('driver = "modbus"', "driver = 1", "driver"),
        ('driver = "modbus"', 'driver = ""', "driver"),
        ('model = "model.toml"', 'model = "none.toml"', "model"),
        ('model = "model.toml"', "model = 1", "model"),
        ('model = "model.toml"', 'model = "."', "model"),
        ('format = "abbe-config/1"', 'format = "abbe-model/1"', "format"),
        ('source = "cmm.count_X"', 'source = "cmm.count_Q"', "axes.X"),
        ('source = "cmm.count_X"', 'source = "q.count_X"', "axes.X"),
        ('source = "cmm.count_X"', 'source = "cmm"', "axes.X"),
        ('source = "cmm.count_X"', "source = 1", "axes.X"),
        ("[axes.X]", "[axes.Q]", "axes"), ("[signals.T_x1]", "[signals.T_q]", "signals"),
        ("[cycle]", "[cyle]", "cyle"), ("period = 0.02", "perid = 0.02", "perid"),
        ("[cycle]", "cycle = 1\n[guard2]", ""), ('type = "encoder"', 'type = "tacho"', "axes.X"),
        ('type = "encoder", counts', 'typ = "encoder", counts', "axes.X"),
        ('target = "cmm.corrected_X"', 'target = "cmm.count_X"', "output"),
        ('target = "cmm.corrected_X"', 'target = "cmm.corrected_Y"', "output"),
        ('file = "journal.log"', "file = 1", "journal"), ("[links.cmm]", '[links."a.b"]', "links"),
        ('host = "127.0.0.1"', "host = 1", "links.cmm"),
        ('transport = "tcp"', 'transport = "pigeon"', "links.cmm"),
        ('type = "uint16" }', 'type = "uint17" }', "links.cmm"),
        ('table = "input"', 'table = "output"', "links.cmm"),
        ('source = "cmm.count_X"', 'source = "cmm.count_X"\ndatum = "yes"', "axes.X"),
        ('source = "cmm.count_X"', 'source = "cmm.count_X"\ndatum = true', "[control]"),
        ('source = "cmm.R_T_x1"', 'source = "cmm.R_T_x1"\nentered_for = 9.0', "signals.T_x1"),
        ("[journal]", "[control]\nsocket = 1\n[journal]", "control"),
        ("[output]", "[output]\nplus_minus = 1", "output.plus_minus"),
        ("[output]", '[output]\nplus_minus.X = "cmm.count_X"', "output.plus_minus.X"),
        ("[output]", '[output]\nplus_minus.Q = "cmm.abbe_status"', "output.plus_minus.Q"),
        ("[output]", "[output]\noutside = 1", "output.outside"),
        ("[output]", '[output]\noutside = "cmm.corrected_X"', "output.outside"),
        ("[journal]", "[checks]\npoints = 1\n[journal]", "checks.points"),
        ("[journal]", "[checks.points.a]\n[journal]", "checks.points.a"),
        ("[journal]", "[checks.points.a]\ntrigger = 1\n[journal]", "checks.points.a"),
        ("[journal]", "[control]\nsocket = ''\n[journal]", "control"),
        ("[journal]", "[control]\nsocket = 'model.toml'\n[journal]", "no socket"),
        ("[journal]", "[control]\nsocket = '" + "x" * 200 + "'\n[journal]", "too long"),
    ):  # fmt: skip
        yield changed(before, after, says)
    for before, after, says in (
        ('controller = "csv"', 'controller = "abacus"', "upload"),
        ('controller = "csv"', "controller = 1", "upload"),
        ('options = { holds = "moves" }', "options = 1", "upload.options"),
        ('options = { holds = "moves" }', 'options = { hold = "moves" }', "upload.options"),
        ('identity = "ABBE', "identity = 1 # ", "upload.identity"),
        ("[upload.store]", "[upload.shop]", "upload"),
    ):  # fmt: skip
        yield mill(before, after, says)


def mutated() -> Iterator[Case]:
    """The good configuration damaged by a machine; and its model beside it."""
    good = CONFIG.encode()
    for name, content in (
        *mutate.whole(good), *mutate.flipped(good, 25, 51), *mutate.cut(good, 8, 52),
        *mutate.lines_mixed(good, 12, 53), *mutate.numbers_replaced(good, 30, 54),
        *mutate.harmless(good),
    ):  # fmt: skip
        yield Case(f"config: {name}", {"c.toml": content, "model.toml": MODEL}, CHECK, (), True)
    for name, content in mutate.flipped(MODEL.encode(), 8, 55):
        yield Case(f"its model: {name}", {"c.toml": CONFIG, "model.toml": content}, CHECK, (), True)


PLUGINS = {
    "raises": "raise RuntimeError('no\\nlicence')",
    "ends the program": "import sys; sys.exit(3)",
    "ends the program with words": "raise SystemExit('no licence')",
    "imports what is not there": "import nowhere_at_all",
    "is no Python": "def (:",
    "is empty": "",
    "is a number": "Thing = 3",
    "is another class": "class Thing: kind = 'creep'; name = 'creep'",
    "recurses": "def f(): f()\nf()",
    "is not UTF-8": "x = 'caf\xe9'",
}
GROUPS = {
    "effects": ("effects", "thing"),
    "controllers": ("controllers", "thing"),
    "links": CHECK,
    "stores": CHECK,
}


def package(group: str, code: str) -> dict[str, str | bytes]:
    """A package as pip leaves it, and a configuration that names what it brings."""
    link = CONFIG.replace('driver = "modbus"', 'driver = "thing"', 1)
    at = MILL.index("[upload.store]")
    store = MILL[:at] + MILL[at:].replace('"modbus"', '"thing"', 1)
    return {
        "strange.py": code.encode("latin-1"),
        "strange-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: strange\nVersion: 1.0\n",
        "strange-1.0.dist-info/entry_points.txt": f"[abbe.{group}]\nthing = strange:Thing\n",
        "c.toml": store if group == "stores" else link,
        "model.toml": MILL_MODEL if group == "stores" else MODEL,
    }


def plugins() -> Iterator[Case]:
    """Broken packages, asked for by name."""
    for group, arguments in GROUPS.items():
        for name, code in PLUGINS.items():
            files = package(group, code)
            yield Case(f"{group}: {name}", files, beside(arguments), ("strange:Thing",))


def beside(arguments: tuple[str, ...]):  # type: ignore[no-untyped-def]
    """A command, with the packages of this folder installed."""

    def ask() -> None:
        import sys

        import abbe.drivers.controllers
        from abbe.compcore.effects import registry
        from abbe.daemon.application import app

        # the process that this one was forked from may have looked for plugins already
        registry.PLUGINS.forget()
        abbe.drivers.controllers.PLUGINS.forget()
        sys.dont_write_bytecode = True
        sys.path.insert(0, ".")
        sys.argv = ["abbe", *arguments]
        app()

    return ask


def without() -> Iterator[Case]:
    """Commands that need no plugin, beside a broken one: done, with at most a line."""
    for group in GROUPS:
        for arguments in (
            ("effects", "backlash"),
            ("controllers", "linuxcnc"),
            ("effects", "--json"),
        ):
            files = package(group, PLUGINS["ends the program"]) | {"c.toml": CONFIG}
            yield Case(
                f"{group}, {' '.join(arguments)}", files, beside(arguments), may_succeed=True
            )


def journal() -> None:
    """Read the journal in this folder."""
    from abbe.daemon.upload.history.upload_log import read_journal

    read_journal(Path("uploads.jsonl"))


def journals() -> Iterator[Case]:
    """Journals of uploads: wrong types, deep, damaged."""
    line = {
        "format": "abbe-uploads/1", "time": "2026-01-01T00:00:00.000+00:00", "upload": "u1",
        "step": "begin", "outcome": "ok", "previous": "0" * 64,
    }  # fmt: skip
    good = (json.dumps(line) + "\n").encode()
    for name, content in (
        ("deep", b"[" * 100_000 + b"\n" + good), ("deep objects", b'{"a":' * 100_000 + b"\n"),
        ("a long number", b"9" * 100_000 + b"\n"), ("a list", b"[]\n" + good), ("text", b'"x"\n'),
        ("wrong types", good.replace(b'"u1"', b"1")),
        ("a list for a step", good.replace(b'"begin"', b"[]")),
        ("torn a number", good.replace(b'"ok"', b'"ok", "torn": 1')),
        ("another seal", good.replace(b"0" * 64, b"1" * 64)), ("50 MB of zeros", bytes(50_000_000)),
        *mutate.whole(good), *mutate.flipped(good, 15, 61), *mutate.cut(good, 6, 62),
        *mutate.lines_mixed(good * 3, 6, 63),
    ):  # fmt: skip
        yield Case(f"journal: {name}", {"uploads.jsonl": content}, journal, (), True)


CASES = [*numbers(), *words(), *mutated(), *plugins(), *without(), *journals()]


@pytest.mark.one_in(24)
@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_bad_configuration_is_reported_in_one_line(case: Case, tmp_path: Path) -> None:
    outcome = run(case, tmp_path)
    assert not faults(case, outcome, tmp_path)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("case", list(without()), ids=str)
def test_what_needs_no_broken_plugin_is_done(case: Case, tmp_path: Path) -> None:
    outcome = run(case, tmp_path)
    assert outcome.status == 0, outcome.err
    lines = outcome.err.splitlines()
    assert len(lines) <= 1
    assert all("strange:Thing" in line and "left out" in line for line in lines)
