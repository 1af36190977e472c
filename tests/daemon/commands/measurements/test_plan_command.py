"""abbe plan --instruments: the answer, the page, the plan file; what is refused."""

import json
import re

import pytest

from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.plan_file import read_plan
from abbe.daemon.report.page import number
from tests.support.daemon.command_line import abbe
from tests.support.daemon.german import english_of
from tests.support.daemon.pages import packed

NEW = (
    "new", "--structure", "w b Y X Z t", "--travel", "Y=0,900", "--travel", "X=0,700",
    "--travel", "Z=-500,0", "--shape", "polynomial:2", "--play",
)  # fmt: skip


@pytest.fixture
def model(tmp_path):
    assert abbe(*NEW, "-o", tmp_path / "m.toml").status == 0
    return tmp_path / "m.toml"


def test_a_plan_its_page_and_its_file_say_the_same(model, tmp_path):
    out, page = tmp_path / "plan.toml", tmp_path / "p.html"
    done = abbe(
        "plan", model, "--instruments", "laser,angle,ball-bar", "--time", "100min", "-o", out,
        "--report", page, "--keep-out", "0,0,-900:50,50,-580", "--tool", "P=0,0,-80", "--json",
    )  # fmt: skip
    assert done.status == 0, done.err
    found = json.loads(done.out)
    assert found["hours"] <= 100.0 / 60.0
    assert found["after_um"] < found["before_um"]
    work = read_plan(out, load_model(model).machine)
    assert [s.name for s in work.setups] == [s["name"] for s in found["setups"]]
    assert work.tools == {"P": (0.0, 0.0, -80.0)}
    text = page.read_text("utf-8")
    for setup in found["setups"]:
        assert setup["what"].replace("-", "−") in text
        # three digits also of what is small beside the rest
        assert f"<td>{number(setup['after_um'], 3)}</td>" in text
    assert "keep out" in packed(text, "figures")
    assert '"ticktext"' in packed(text, "figures")


@pytest.mark.parametrize(
    "how",
    [("--wave", "X=10"), ("--preset", "iso230-6", "--time", "1h"), ("--instruments", "ruler")],
)
def test_what_is_printed_is_in_the_language_that_is_asked_for(model, how):
    english, german = abbe("plan", model, *how), abbe("plan", model, *how, "--language", "de")
    assert german.status == english.status
    assert english_of(english.out + english.err)
    assert english_of(german.out + german.err) == []
    assert re.findall(r"-?\d+\.?\d*", german.out) == re.findall(r"-?\d+\.?\d*", english.out)


@pytest.mark.parametrize("how", [(), ("--preset", "iso230-6", "--time", "40min")])
def test_the_page_is_in_the_language_that_is_asked_for(model, tmp_path, how):
    pages = [tmp_path / "en.html", tmp_path / "de.html"]
    for code, page in zip(("en", "de"), pages, strict=True):
        done = abbe("plan", model, *how, "--language", code, "--report", page)
        assert done.status == 0, done.err
    english, german = (_texts(page.read_text("utf-8")) for page in pages)
    assert english_of(" ".join(english))
    assert english_of(" ".join(german)) == []
    alike = {text for text in english if text in german and re.search("[A-Za-z]{4}", text)}
    assert all(
        re.fullmatch(r"SHA-256|[0-9a-f]+|m\.toml|moving-bridge CMM|\d\d_\w+", text)
        for text in alike
    ), alike
    if how:
        assert "Reichweite der Tastkugel" in packed(pages[1].read_text("utf-8"), "figures")


def _texts(page: str) -> list[str]:
    """What is read on it."""
    seen = re.sub(r"<(style|script)\b.*?</\1>|<svg.*?</svg>", "", page, flags=re.DOTALL)
    return [text.strip() for text in re.findall(">([^<]+)<", seen) if text.strip()]


def test_a_preset_is_planned_as_it_is(model):
    done = abbe("plan", model, "--preset", "iso230-6", "--time", "3h")
    assert done.status == 0, done.err
    assert done.out.count("body diagonal") >= 4
    assert "undetermined" in done.out
    assert "NOT WHOLE" not in done.out
    short = abbe("plan", model, "--preset", "iso230-6", "--time", "40min", "--json")
    assert len(json.loads(short.out)["left_out"]) + len(json.loads(short.out)["setups"]) == 4


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--instruments", "ruler"), ("no such instrument", "ruler", "ball-bar")),
        (("--instruments", "laser", "--time", "soon"), ("not a time", "4h")),
        (("--instruments", "laser", "--time", "1e9h"), ("not a time",)),
        (("--instruments", "laser", "--time", "2min"), ("in this time",)),
        (("--instruments", "laser", "--keep-out", "1,2:3"), ("not a box", "two corners")),
        (("--instruments", "laser", "--tool", "T=1,2"), ("three numbers",)),
        (("--instruments", "laser", "--apart", "nonsense"), ("nonsense",)),
        (("--preset", "iso9000"), ("no such preset", "iso230-2")),
        (("-o", "x.toml"), ("--instruments",)),
    ],
)
def test_what_cannot_be_planned_is_said_in_one_line(model, words, says):
    done = abbe("plan", model, *words)
    assert done.status != 0
    for word in says:
        assert word in done.err
    assert "Traceback" not in done.err
