"""Held out is only what was not fitted; and printed commands do what is printed beside them."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

from tests.support.compcore.lathe_days import LATHE, lathe_days
from tests.support.daemon.command_line import abbe

DATA = Path(__file__).parents[3] / "data" / "p01-mill"
MODEL, FIT, CHECK = DATA / "model.toml", DATA / "fit.csv", DATA / "check.csv"
SPEC = ("thermal_tilt", "axis=Y", "about=X", "signals=T_col_front,T_col_rear")


def parts(path):
    """A campaign's metadata with the header, and its rows, as text."""
    lines = path.read_text(encoding="utf-8").splitlines()
    top = next(i for i, line in enumerate(lines) if not line.startswith("#")) + 1
    return lines[:top], lines[top:]


def written(path, head, rows):
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    return path


def add(out, holdout, *more):
    return abbe("add", MODEL, *SPEC, "--campaign", FIT, "--holdout", holdout, "-o", out, *more)


def test_the_fitted_file_is_refused_as_held_out(tmp_path):
    out = tmp_path / "next.toml"
    done = add(out, FIT)
    assert (done.status, done.out) == (1, "")
    assert "fit.csv, field '--holdout': this campaign is fitted and cannot be held out" in done.err
    assert not out.exists()


def test_the_same_rows_in_another_file_are_refused(tmp_path):
    """Another name, another order, other blanks: the SHA-256 differs, the rows do not."""
    head, rows = parts(FIT)
    copy = written(tmp_path / "copy.csv", [*head[:-1], "# [other]", head[-1]], rows[::-1])
    done = add(tmp_path / "next.toml", copy)
    assert done.status == 1
    assert f"{len(rows)} of its {len(rows)} rows are among those of --campaign" in done.err


def with_own_points(path, out):
    """The set-ups of a campaign that have points of their own: not the repeated masters."""
    head, rows = parts(path)
    column = head[-1].split(",").index("setup")
    return written(out, head, [r for r in rows if not r.split(",")[column].startswith("master")])


def test_other_set_ups_are_held_out_without_a_word(tmp_path):
    """Diagonals beside lines along the axes; that names are alike in two files means nothing."""
    other = with_own_points(CHECK, tmp_path / "other.csv")
    done = add(tmp_path / "next.toml", other)
    assert done.status == 0, done.err
    assert "NOT HELD OUT" not in done.out
    assert "repeats points that were fitted" not in done.out
    found = json.loads(add(tmp_path / "next.toml", other, "--json", "--force").out)
    assert found["holdout_shares"] == {"rows": 0, "setups": []}


def test_shared_rows_are_said(tmp_path):
    head, rows = parts(FIT)
    other_head, other = parts(with_own_points(CHECK, tmp_path / "other.csv"))
    assert head[-1] == other_head[-1], "the same columns, or this would make no sense"
    mixed = written(tmp_path / "mixed.csv", other_head, [*other, *rows[:40]])
    done = add(tmp_path / "next.toml", mixed)
    assert done.status == 0, done.err
    assert f"NOT HELD OUT: 40 of {len(other) + 40} rows of mixed.csv" in " ".join(done.out.split())
    found = json.loads(add(tmp_path / "next.toml", mixed, "--json", "--force").out)
    assert found["holdout_shares"]["rows"] == 40


def test_points_and_placings_that_were_fitted_are_said(tmp_path):
    """The masters stand where they stood; every second row of a file is of the same placings."""
    done = add(tmp_path / "next.toml", CHECK)
    assert (
        "check.csv repeats points that were fitted (its set-ups master_x, master_y, master_z)"
        in done.out
    )
    head, rows = parts(FIT)
    half, rest = tmp_path / "half.csv", tmp_path / "rest.csv"
    written(half, head, rows[::2])
    written(rest, head, rows[1::2])
    command = ("add", MODEL, *SPEC, "--campaign", half, "--holdout", rest, "--json")
    found = json.loads(abbe(*command, "-o", tmp_path / "next.toml", "--force").out)
    column = head[-1].split(",").index("setup")
    assert set(found["holdout_shares"]["setups"]) == {r.split(",")[column] for r in rows[1::2]}
    assert found["holdout_shares"]["rows"] == 0


def test_compare_says_when_a_campaign_was_fitted(tmp_path):
    fitted = tmp_path / "fitted.toml"
    assert abbe("fit", MODEL, FIT, "-o", fitted).status == 0
    mine = abbe("compare", fitted, FIT)
    assert mine.out.startswith("FITTED: ")
    assert "fit.csv is a campaign that this model was fitted to" in mine.out
    found = json.loads(abbe("compare", fitted, FIT, CHECK, "--json").out)
    assert [Path(name).name for name in found["fitted_to"]] == ["fit.csv"]
    other = abbe("compare", fitted, CHECK)
    assert "FITTED" not in other.out
    report = tmp_path / "page.html"
    abbe("compare", fitted, FIT, "--report", report)
    assert "that this model was fitted to" in report.read_text(encoding="utf-8")


@pytest.mark.thorough
def test_the_add_that_diagnose_prints_gives_what_is_printed_beside_it(tmp_path):
    (tmp_path / "my mill.toml").write_bytes(MODEL.read_bytes())
    model = tmp_path / "my mill.toml"
    found = json.loads(abbe("diagnose", model, FIT, "--json").out)["candidates"][0]
    said = abbe("diagnose", model, FIT).out
    command = re.search(r"^   add it: (abbe add .*)$", said, re.M)[1]
    words = shlex.split(command)
    assert words[0] == "abbe"
    done = abbe(*words[1:], "--json")
    assert done.status == 0, done.err
    assert (tmp_path / "my mill-2.toml").exists()
    added = json.loads(done.out)
    assert added["rms_after"] == pytest.approx(found["rms_after"], rel=0.02)
    for name, value in found["parameters"].items():
        got = added["parameters"][name]["value"]
        assert got == pytest.approx(value["value"], abs=0.1 * value["sd"])
    again = re.search(r"^   add it: (abbe add .*)$", abbe("diagnose", model, FIT).out, re.M)[1]
    assert "my mill-3.toml" in again, "what was written is not overwritten"


def test_apply_says_what_the_held_out_campaign_refused(tmp_path: Path) -> None:
    model, fitted, other = (tmp_path / n for n in ("lathe.toml", "fit.csv", "other.csv"))
    model.write_text(LATHE, encoding="utf-8")
    fitted.write_text(lathe_days(1, alone=False), encoding="utf-8")
    other.write_text(lathe_days(2, alone=True), encoding="utf-8")
    command = ("diagnose", model, fitted, "--apply", "--no-measure-next", "--holdout")
    done = abbe(*command, other, "-o", tmp_path / "m.toml")
    assert done.status == 0
    said = "not kept, the held-out campaigns are predicted worse with it: thermal_offset"
    assert said in done.out
    assert "verify the model with another campaign" in done.out
    assert "the fitted campaigns ask for it, the held-out ones are predicted worse" in done.out
    answer = json.loads(abbe(*command, other, "-o", tmp_path / "n.toml", "--json").out)
    assert any("cabinet" in spec for specs in answer["refused_by_holdout"] for spec in specs)
    lacks = written(tmp_path / "lacks.csv", *parts(other))
    lacks.write_text(lacks.read_text().replace(",cabinet\n", ",box\n"), encoding="utf-8")
    done = abbe(*command, lacks, "-o", tmp_path / "o.toml")
    assert done.status == 1
    assert "lacks.csv, field 'cabinet'" in done.err
    assert not (tmp_path / "o.toml").exists()


def test_apply_says_what_the_campaign_does_not_show(tmp_path: Path) -> None:
    """Of a bridge only one line along Y was measured: of X, Z and squareness nothing is known."""
    bridge = DATA.parent / "p02-bridge"
    head, rows = parts(bridge / "fit.csv")
    few = written(tmp_path / "few.csv", head, rows[:60])
    command = ("diagnose", bridge / "model.toml", few, "--apply", "--no-measure-next")
    said = abbe(*command, "-o", tmp_path / "m.toml").out
    found = re.search(r"^NOT DETERMINED: (.*): this campaign does not show them", said, re.M)
    assert found is not None
    assert {"E_XX", "E_ZZ"} <= set(found[1].split(", "))
    assert "E_YY" not in found[1].split(", ")
    assert re.search(r"^  positioning axis=Z: not measured over Z ", said, re.M)
    assert "⁻¹²" not in said
    assert "convention: " not in said
    answer = json.loads(abbe(*command, "-o", tmp_path / "n.toml", "--json").out)
    assert any("E_ZZ" in one["text"] for one in answer["undetermined"] if not one["convention"])


def test_the_page_of_apply_shows_every_step(tmp_path: Path) -> None:
    model, fitted, page = (tmp_path / n for n in ("lathe.toml", "fit.csv", "page.html"))
    model.write_text(LATHE, encoding="utf-8")
    fitted.write_text(lathe_days(1, alone=False), encoding="utf-8")
    done = abbe(
        "diagnose", model, fitted, "--apply", "-o", tmp_path / "m.toml", "--report", page, "--json"
    )
    steps = json.loads(done.out)["steps"]
    text = page.read_text("utf-8")
    assert "How the error fell, step by step" in text
    assert len(steps) > 1
    for step in steps[1:]:
        assert f"added {step['spec']}" in text or f"behind a lag: {step['spec']}" in text
