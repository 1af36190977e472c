"""A file that another command reads is answered with that command, in the same one line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from abbe.compcore.files.recognised import recognised
from tests.compcore.files.test_importers import RTL
from tests.support.daemon.command_line import abbe

DATA = Path(__file__).parents[3] / "data"
CAMPAIGN, MODEL = DATA / "p01-mill" / "fit.csv", DATA / "p01-mill" / "model.toml"
MAP = DATA / "bridge-map.txt"
STRUCTURE = ("--structure", "w b Y X Z t")


@pytest.fixture
def files(tmp_path):
    made = {
        "rtl": RTL,
        "runs.csv": "position,run,direction,deviation\n0,1,up,0\n100,1,up,3\n",
        "wide.csv": "target,1+,1-\n0,0,1\n100,3,4\n",
        "circle.csv": "angle,ccw,cw\n0,1,2\n90,2,3\n",
        "points.csv": "X_off,Y_off,Z_off,X_on,Y_on,Z_on\n1,2,3,1,2,3\n",
        "config.toml": 'format = "abbe-config/1"\nmodel = "m.toml"\n',
        "grid.csv": '# format = "abbe-grid/1"\nX [mm]\n',
    }
    for name, text in made.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    return {name: tmp_path / name for name in made} | {
        "campaign": CAMPAIGN, "model": MODEL, "map": MAP
    }  # fmt: skip


@pytest.mark.parametrize(
    ("command", "words", "answer"),
    [
        ("fit", ("{model}", "{rtl}", "-o", "{out}"), "abbe import-campaign rtl --as rtl"),
        ("compare", ("{model}", "{runs.csv}"), "abbe import-campaign runs.csv --as iso230-2"),
        ("compare", ("{model}", "{wide.csv}"), "abbe import-campaign wide.csv --as iso230-2"),
        ("diagnose", ("{model}", "{circle.csv}"), "abbe import-campaign circle.csv --as ballbar"),
        ("fit", ("{model}", "{map}", "-o", "{out}"), "abbe import-map bridge-map.txt"),
        ("fit", ("{map}", "{campaign}", "-o", "{out}"), "abbe import-map bridge-map.txt"),
        ("compare", ("{campaign}", "{model}"), "abbe compare MODEL.toml fit.csv"),
        ("correct", ("{campaign}", "X=1"), "abbe compare MODEL.toml fit.csv"),
        ("correct", ("{config.toml}", "X=1"), "abbe check config.toml"),
        ("compare", ("{model}", "{points.csv}"), "abbe identify-convention MAP.txt points.csv"),
        ("compare", ("{model}", "{grid.csv}"), "abbe import-grid grid.csv"),
        ("run", ("{model}",), "abbe correct model.toml"),
        ("check", ("{campaign}",), "abbe compare MODEL.toml fit.csv"),
        ("import-map", ("{campaign}", *STRUCTURE, "-o", "{out}"), "abbe compare MODEL.toml"),
        ("import-map", ("{rtl}", *STRUCTURE, "-o", "{out}"), "abbe import-campaign rtl --as rtl"),
        ("import-campaign", ("{campaign}", "--as", "rtl", "-o", "{out}"), "abbe compare MODEL"),
        (
            "import-campaign",
            ("{rtl}", "--as", "iso230-2", "--axis", "X", "-o", "{out}"),
            "abbe import-campaign rtl --as rtl",
        ),
    ],
)
def test_the_command_that_reads_it_is_named(files, tmp_path, command, words, answer):
    out = tmp_path / "out.toml"
    typed = [re.sub(r"\{(.+)\}", lambda m: str(files.get(m[1], out)), w) for w in words]
    done = abbe(command, *typed)
    assert done.status in (1, 2), done
    assert answer in done.err
    assert done.err.count("\n") == 1
    assert not out.exists()


def test_a_flaw_of_the_right_file_is_reported_without_it(tmp_path):
    """A campaign with a bad row, a model with a bad key: the message is about the flaw alone."""
    lines = CAMPAIGN.read_text(encoding="utf-8").splitlines()
    bad = tmp_path / "bad.csv"
    bad.write_text("\n".join([*lines, lines[-1].replace(",-1,", ",one,", 1)]), encoding="utf-8")
    done = abbe("compare", MODEL, bad)
    assert done.status == 1
    assert "this is" not in done.err
    model = tmp_path / "bad.toml"
    model.write_text(MODEL.read_text(encoding="utf-8") + "\n[[effects]\n", encoding="utf-8")
    done = abbe("compare", model, CAMPAIGN)
    assert done.status == 1
    assert "this is" not in done.err


def test_what_ships_is_recognised(files):
    found = {name: recognised(path) for name, path in files.items()}
    assert all(found.values()), [name for name, kind in found.items() if kind is None]
    assert recognised(DATA / "README.md") is None
    assert recognised(DATA) is None
