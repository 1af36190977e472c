"""``abbe table`` and ``abbe controllers``, as a user runs them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.files.table_set import TableSet
from abbe.compcore.tables.field import ErrorField, table_state
from abbe.drivers.controllers import controller_kinds, make_controller
from tests.support.compcore.table_models import (
    FIVE_AXES,
    FOUR_AXES,
    TRAVELS,
    rigid,
    thermal,
    turning,
    with_backlash,
)
from tests.support.daemon.command_line import abbe
from tests.support.daemon.pages import packed


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("model") / "model.toml"
    save_model(thermal(with_backlash(rigid())), path)
    return path


AT = ("--at", "T_x=23.5,T_y=21", "--tool", "0,0,-120")


def test_tables_for_linuxcnc_do_what_they_say(model, tmp_path):
    """The files, laid on the model by a reader of their own: what is left is what was printed."""
    done = abbe("table", model, "--controller", "linuxcnc", "-o", tmp_path / "t", *AT, "--json")
    assert done.status == 0, done.err
    answer = json.loads(done.out)
    loaded = load_model(model)
    field = ErrorField(
        loaded, table_state(loaded, {"T_x": 23.5, "T_y": 21.0}, tool=(0.0, 0.0, -120.0)), "command"
    )
    rng = np.random.default_rng(1)
    n = 3000
    where = {a: rng.uniform(*TRAVELS[a], n) for a in "XYZ"}
    facing = {a: rng.choice([-1.0, 1.0], n) for a in "XYZ"}
    error = field(where, facing)
    for k, axis in enumerate("XYZ"):
        rows = np.loadtxt(tmp_path / "t" / f"{axis.lower()}.comp")
        trims = [np.interp(where[axis], rows[:, 0], rows[:, 0] - rows[:, c]) for c in (1, 2)]
        error[:, k] += np.where(facing[axis] > 0, *trims)
    error -= error.mean(axis=0)
    rms = np.sqrt((error**2).sum(axis=1).mean()) * 1e3
    assert answer["remaining"]["linuxcnc"]["rms"] == pytest.approx(rms, rel=0.03)
    assert answer["remaining"]["linuxcnc"]["rms"] < answer["remaining"]["no compensation"]["rms"]
    assert answer["remaining"]["L-VOL"]["max"] < 1.0
    assert answer["types"] == ["L-POS"], "R-POS is nothing on a bridge"
    assert answer["sign"].startswith("type 0: the measured actual position")


def test_the_record_goes_with_the_table(model, tmp_path):
    folder = tmp_path / "set"
    done = abbe(
        "table", model, "--controller", "csv", "-o", folder, *AT, "--by", "Erika", "--note",
        "after two hours", "--volume", "X=0,400", "--set", "sign=compensation",
    )  # fmt: skip
    assert done.status == 0, done.err
    record = json.loads((folder / "abbe-tables.json").read_text(encoding="utf-8"))
    assert record["format"] == "abbe-tables/1"
    assert record["by"] == "Erika"
    assert "after two hours" in record["notes"]
    assert record["conditions"]["signals"]["T_x"] == {"value": 23.5, "unit": "degC"}
    assert record["conditions"]["tool_mm"] == [0.0, 0.0, -120.0]
    assert record["conditions"]["volume"]["X"] == {"from": 0.0, "to": 400.0, "unit": "mm"}
    assert record["model"]["structure"] == "w b Y X Z t"
    assert len(record["model"]["sha256"]) == 64
    assert record["options"] == {"sign": "compensation"}
    assert record["controller"] == "csv"
    again = TableSet.load(folder)
    assert set(again.files) == {"x.csv", "y.csv", "z.csv"}
    assert again.checksums == record["files"]
    (folder / "x.csv").write_text("changed", encoding="utf-8")
    refused = abbe("table", model, "--controller", "csv", "-o", tmp_path / "o", *AT, "--on", folder)
    assert refused.status == 1
    assert "changed after it was made" in refused.err


def test_the_screen_says_sign_and_confidence(model, tmp_path):
    done = abbe("table", model, "--controller", "siemens-840d", "-o", tmp_path, *AT)
    assert done.status == 0, done.err
    for words in (
        "sign of the numbers: ENC_COMP: error (actual − indicated)",
        "how sure: syntax documented, sign unverified",
        "WARNING: not all of this has been tried",
        "no compensation",
        "siemens-840d, L-POS+L-STR",
        "L-VOL (a controller with levers)",
        "At the controller:",
        "MD32700",
        "written:",
    ):
        assert words in done.out, words
    tried = abbe("table", model, "--controller", "linuxcnc", "-o", tmp_path / "l", *AT)
    assert "WARNING" not in tried.out


def test_products_are_reported_beside_what_single_axes_leave(model, tmp_path):
    order = ("table", model, "--controller", "siemens-840d", *AT, "--set", "products=mirrored")
    done = abbe(*order, "-o", tmp_path / "a", "--report", tmp_path / "r.html")
    assert done.status == 0, done.err
    for words in (
        "holds L-POS, L-STR, L-SQU, L-ANG;",
        "siemens-840d, L-POS+L-STR  ",
        "siemens-840d, L-POS+L-STR with products  ",
        "E_XY·Z",
        "µm/m",
        "nor have products",
        "make the trial of docs/tables.md",
    ):
        assert words in done.out, words
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "µm per m of the lever" in packed(page, "figures")
    # on themselves: angles and their levers twice, the same left
    twice = abbe(*order, "-o", tmp_path / "b", "--on", tmp_path / "a", "--json")
    assert twice.status == 0, twice.err
    left = json.loads(twice.out)["remaining"]
    record = json.loads((tmp_path / "a" / "abbe-tables.json").read_text(encoding="utf-8"))
    first = record["remaining"]["siemens-840d"]["rms"]
    assert left["siemens-840d"]["rms"] == pytest.approx(first, rel=0.01)
    assert first < left["without products"]["rms"] < left["no compensation"]["rms"]
    read = make_controller("siemens-840d", load_model(model).machine).read
    one, two = (
        {t.name: t for t in read({"c": (tmp_path / f / "nc_cec.ini").read_text()})} for f in "ab"
    )
    assert two["E_XY·Z"].difference(one["E_XY·Z"].scaled(2.0)) * 175.0 < 2e-4


def test_superposed_on_what_the_controller_holds(model, tmp_path):
    """Tables for the bare machine, put on themselves, are twice as large."""
    first, second = tmp_path / "a", tmp_path / "b"
    abbe("table", model, "--controller", "weihong", "-o", first, *AT)
    weihong = ("table", model, "--controller", "weihong", "-o", second, *AT)
    done = abbe(*weihong, "--on", first, "--json")
    assert done.status == 0, done.err
    answer = json.loads(done.out)
    assert list(answer["active_while_measured"]) == ["axeserr.dat"]
    owner = load_model(model).machine
    read = make_controller("weihong", owner).read
    once, twice = (read({"axeserr.dat": (f / "axeserr.dat").read_text()}) for f in (first, second))
    for one, two in zip(once, twice, strict=True):
        assert one.scaled(2.0).difference(two) < 4e-4
    plain = json.loads((first / "abbe-tables.json").read_text(encoding="utf-8"))
    assert answer["remaining"]["weihong"]["rms"] == pytest.approx(
        plain["remaining"]["weihong"]["rms"], rel=0.02
    )
    alone = abbe(*weihong, "--on", first / "axeserr.dat")
    assert alone.status == 0, alone.err
    other = abbe("table", model, "--controller", "pmac", "-o", second, *AT, "--on", first)
    assert other.status == 1
    assert "another controller" in other.err


def test_a_report_has_the_pictures(model, tmp_path):
    page = tmp_path / "r.html"
    done = abbe(
        "table", model, "--controller", "twincat-isg", "-o", tmp_path / "t", *AT, "--report", page
    )
    assert done.status == 0, done.err
    text = page.read_text(encoding="utf-8")
    for words in ("What remains", "Record (ISO/TR 16907, 9.1)", "E_CY", "VOLCOMP", "Plotly"):
        assert words in text


@pytest.mark.one_in(6)
@pytest.mark.parametrize(
    ("name", "code"),
    [*((name, FOUR_AXES) for name in controller_kinds()), ("siemens-840d", FIVE_AXES)],
)
def test_every_dialect_makes_tables_of_a_machine_with_rotary_axes(name, code, tmp_path_factory):
    folder = tmp_path_factory.mktemp(name)
    save_model(turning(code), folder / "m.toml")
    done = abbe("table", folder / "m.toml", "--controller", name, "-o", folder / "t", "--json",
                "--points", "9" if name != "heidenhain-nd" else "60")  # fmt: skip
    assert done.status == 0, done.err
    answer = json.loads(done.out)
    left = answer["remaining"]
    assert left[name]["rms"] < left["no compensation"]["rms"]
    assert set(answer["files"]) == {Path(p).name for p in answer["written"]} - {"abbe-tables.json"}


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("--controller", "linuxcnc", "-o", "T"), 1, "T_x (degC), T_y (degC)"),
        (("--controller", "heidenhain", "-o", "T", "--at", "reference"), 1, "heidenhain-nd"),
        (("--controller", "linuxcnc", "-o", "T", "--at", "T_q=1,reference"), 1, "no such signal"),
        (("--controller", "linuxcnc", "-o", "T", "--at", "T_x=warm"), 1, "a number in degC"),
        (("--controller", "linuxcnc", "-o", "T", "--at", "T_x"), 1, "KEY=VALUE"),
        (("--controller", "linuxcnc", "-o", "T", "--at", "reference", "--tool", "1,2"), 1, "x,y,z"),
        (("--controller", "linuxcnc", "-o", "T", "--at", "reference", "--volume", "X=5"), 1,
         "low,high in mm"),
        (("--controller", "linuxcnc", "-o", "T", "--at", "reference", "--volume", "X=0,9999"), 1,
         "-400 to 800 mm"),
        (("--controller", "linuxcnc", "-o", "T", "--at", "reference", "--set", "typ=1"), 1,
         "no such option"),
        (("--controller", "linuxcnc", "-o", "T", "--at", "reference", "--points", "300"), 1,
         "2 to 256"),
        (("--controller", "linuxcnc", "-o", "T", "--at", "reference", "--on", "nothing"), 1,
         "no such file"),
        (("-o", "T"), 2, "--controller"),
        (("--controller", "linuxcnc"), 2, "-o"),
    ],
)  # fmt: skip
def test_mistakes_are_reported_in_a_line(model, tmp_path, monkeypatch, arguments, status, words):
    monkeypatch.chdir(tmp_path)
    done = abbe("table", model, *arguments)
    assert done.status == status
    assert words in done.err
    assert "Traceback" not in done.err
    assert done.out == ""
    assert not (tmp_path / "T").exists()


def test_controllers_are_listed_with_what_they_hold_and_how_sure_abbe_is():
    done = abbe("controllers")
    assert done.status == 0
    for name, cls in controller_kinds().items():
        (row,) = [line for line in done.out.splitlines() if line.startswith(name + " ")]
        assert str(cls.trust.least) in row
    answer = json.loads(abbe("controllers", "--json").out)["controllers"]
    assert set(answer) == set(controller_kinds())
    assert answer["linuxcnc"]["tables"][0]["points"] == 256
    assert answer["fanuc"]["tables"][0]["incremental"] is True
    page = abbe("controllers", "pmac").out
    for words in ("DEFINE COMP", "Sign: error", "How sure", "counts", "owners = 8", "unverified"):
        assert words in page
    assert abbe("controllers", "none").status == 1


def test_a_steep_model_is_refused_with_its_reason(model, tmp_path):
    loaded = load_model(model)
    terms = tuple(
        replace(t, values={n: replace(v, value=4e4 * v.value) for n, v in t.values.items()})
        for t in loaded.terms
    )
    steep = tmp_path / "steep.toml"
    save_model(replace(loaded, terms=terms), steep)
    done = abbe("table", steep, "--controller", "linuxcnc", "-o", tmp_path / "t", *AT)
    assert done.status == 1
    assert "no command reaches some positions" in done.err


@pytest.mark.thorough
def test_the_tool_s_direction_is_held_where_that_is_asked_for(tmp_path):
    path = tmp_path / "model.toml"
    save_model(turning(FIVE_AXES), path)

    def left(*more: str) -> dict[str, dict[str, float]]:
        done = abbe("table", path, "--controller", "heidenhain-tnc", "-o", tmp_path / "t",
                    "--tool", "0,0,-120", "--json", "--force", *more)  # fmt: skip
        assert done.status == 0, done.err
        found = json.loads(done.out)["remaining"]
        return {name: row["lean"] for name, row in found.items() if "lean" in row}

    plain, turned = left(), left("--orientation")
    assert plain["no compensation"] == turned["no compensation"]
    assert turned["heidenhain-tnc"]["rms"] < 0.3 * plain["heidenhain-tnc"]["rms"]
    shown = abbe("table", path, "--controller", "heidenhain-tnc", "-o", tmp_path / "t", "--force",
                 "--tool", "0,0,-120", "--orientation").out  # fmt: skip
    rms = (turned["no compensation"]["rms"], turned["heidenhain-tnc"]["rms"])
    assert f"by {rms[0]:.1f} µrad (rms) without compensation, by {rms[1]:.1f} µrad" in shown
    refused = abbe("table", path, "--controller", "etalon-exchange", "-o", tmp_path / "e",
                   "--orientation")  # fmt: skip
    assert refused.status == 1
    assert "no tables that correct a rotary axis by a position" in refused.err
