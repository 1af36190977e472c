"""The head of every page: machine, serial number, date, operator, environment, files' SHA-256."""

from __future__ import annotations

import hashlib
import json
import re
from html import unescape
from pathlib import Path

import pytest

from tests.support.daemon.command_line import abbe
from tests.support.daemon.small_line import SAID, write_campaign, write_model

WARM = ("T_x=25", "T_hall=20.5")


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def facts(page: Path) -> dict[str, str]:
    found = re.findall(r"<dt>([^<]*)</dt><dd[^>]*>([^<]*)</dd>", page.read_text("utf-8"))
    return {unescape(name): unescape(text).replace("\u00a0", " ") for name, text in found}


def files(page: Path) -> list[tuple[str, str, str, str]]:
    """What it is, name, SHA-256 as shown, SHA-256 whole."""
    row = r'<tr><td>([^<]*)</td><td>([^<]*)</td><td><code[^>]*title="(\w+)">(\w+)<span>(\w+)</span>'
    found = re.findall(row, page.read_text("utf-8"))
    assert all(whole == short + rest for _, _, whole, short, rest in found)
    return [(unescape(part), unescape(name), short, whole) for part, name, whole, short, _ in found]


@pytest.fixture(scope="module")
def shop(tmp_path_factory) -> Path:
    """A model, fitted to two campaigns and laid beside a third, with every page."""
    folder = tmp_path_factory.mktemp("head")
    model = write_model(folder)
    one = write_campaign(folder / "one.csv", seed=1)
    two = write_campaign(
        folder / "two.csv", seed=2, operator="A. Roth", date="2026-03-04", hall=21.9
    )
    check = write_campaign(folder / "check.csv", seed=3, operator="", environment="", hall=23.0)
    fitted, grown = folder / "fitted.toml", folder / "grown.toml"

    def page(name: str) -> tuple[str, Path]:
        return "--report", folder / f"{name}.html"

    for words in (
        ("fit", model, one, two, "-o", fitted, *page("fit")),
        ("compare", fitted, check, *page("compare")),
        ("diagnose", fitted, check, *page("diagnose"), "--no-measure-next"),
        ("add", fitted, "scale", "axis=X", "--campaign", one, "--holdout", check, "-o", grown,
         *page("add")),
        ("history", grown, *page("history")),
        ("correct", fitted, "X=300", "Y=120", "Z=-80", *WARM, *page("correct")),
        ("table", fitted, "--controller", "csv", "--at", "reference", "-o", folder / "tables",
         *page("table")),
        ("iso230", one, *page("iso230")),
    ):  # fmt: skip
        done = abbe(*words)
        assert done.status == 0, done.err
    return folder


PAGES = ("fit", "compare", "diagnose", "add", "history", "correct", "table", "iso230")


@pytest.mark.parametrize("name", PAGES)
def test_every_page_has_its_head(shop, name):
    stated = facts(shop / f"{name}.html")
    for key in ("Date", "Machine", "Serial number", "Operator", "Instrument", "Environment"):
        assert key in stated, key
    assert stated["Machine"] == "Small"
    assert stated["Serial number"] == "4711"
    assert stated["Instrument"] == SAID["instrument"]
    assert re.search(r"Made by Abbe \S+, 20\d\d-", (shop / f"{name}.html").read_text("utf-8"))
    for part, file, short, whole in files(shop / f"{name}.html"):
        assert part
        assert whole == sha256(shop / file), file
        assert whole.startswith(short)
        assert len(short) == 12


@pytest.mark.parametrize(
    ("name", "rests_on"),
    [
        ("fit", [("model, as it was", "small.toml"), ("campaign", "one.csv"),
                 ("campaign", "two.csv")]),
        ("compare", [("model", "fitted.toml"), ("campaign", "check.csv")]),
        ("diagnose", [("model", "fitted.toml"), ("campaign", "check.csv")]),
        ("history", [("model", "grown.toml"), ("campaign, fitted", "one.csv"),
                     ("campaign, held out", "check.csv")]),
        ("correct", [("model", "fitted.toml"), ("campaign, fitted", "one.csv"),
                     ("campaign, fitted", "two.csv")]),
        ("table", [("model", "fitted.toml"), ("campaign, fitted", "one.csv"),
                   ("campaign, fitted", "two.csv")]),
        ("iso230", [("campaign", "one.csv")]),
    ],
)  # fmt: skip
def test_what_a_page_rests_on(shop, name, rests_on):
    assert [(part, file) for part, file, _, _ in files(shop / f"{name}.html")] == rests_on


def test_several_campaigns_say_in_what_they_differ(shop):
    for name in ("fit", "correct", "table"):
        stated = facts(shop / f"{name}.html")
        assert stated["Operator"] == f"{SAID['operator']}; A. Roth"
        assert stated["Date"] == "2026-03-02; 2026-03-04"
        assert stated["Environment"] == "hall 3, doors shut; T_hall 20.5 … 22 °C"
        assert stated["Warm-up"] == SAID["warm_up"]
        assert stated["Positions"] == "Y 120 mm, X 50 … 450 mm, Z −80 mm"


def test_what_was_not_stated_is_shown_as_such(shop):
    stated = facts(shop / "compare.html")
    assert stated["Operator"] == "not stated"
    assert stated["Environment"] == "T_hall 23 … 23.1 °C"
    assert "Warm-up" in stated


def test_conditions_go_into_the_model_and_the_record_of_its_tables(shop):
    listed = json.loads(abbe("history", shop / "grown.toml", "--json").out)["versions"]
    assert [len(v["campaigns"]) for v in listed] == [2, 1]
    first, second = listed[0]["campaigns"]
    assert first["conditions"]["operator"] == SAID["operator"]
    assert first["conditions"]["date"] == "2026-03-02"
    assert second["conditions"]["operator"] == "A. Roth"
    assert first["conditions"]["positions"]["Y"] == [120.0, 120.0]
    assert second["conditions"]["signals"]["T_hall"] == [21.9, pytest.approx(21.96)]
    assert "operator" not in listed[1]["holdout"][0]["conditions"]
    record = json.loads((shop / "tables" / "abbe-tables.json").read_text("utf-8"))
    assert record["model"]["serial"] == "4711"
    assert record["model"]["fit"]["campaigns"] == listed[0]["campaigns"]


def test_each_campaign_has_its_own_rms_and_noise_floor(shop):
    """Closed: noise of one size in all; the check is held out, its figures its own."""
    grown = json.loads(abbe("history", shop / "grown.toml", "--json").out)["versions"][-1]
    for entry in (*grown["campaigns"], *grown["holdout"]):
        assert entry["rms"] == pytest.approx(0.396, rel=0.06), entry["file"]
        assert entry["noise_floor"] == pytest.approx(0.396, rel=0.12), entry["file"]
        assert entry["n"] == 255


@pytest.mark.parametrize(
    "line",
    ["operator = [", "operator = {name = 1}", "date = {}", "serial = [[1], {a = 1}]"],
)
def test_a_condition_that_is_no_text_is_refused(tmp_path, line):
    model, campaign = write_model(tmp_path), write_campaign(tmp_path / "c.csv", seed=1)
    text = campaign.read_text("utf-8")
    key = line.partition(" ")[0]
    text = re.sub(rf"# {key} = .*", lambda _: f"# {line}", text)
    campaign.write_text(text, encoding="utf-8")
    done = abbe("compare", model, campaign)
    assert done.status == 1
    assert "c.csv, line " in done.err
    assert len(done.err.strip().splitlines()) == 1


def test_numbers_and_dates_are_conditions_too(tmp_path):
    model, campaign = write_model(tmp_path), write_campaign(tmp_path / "c.csv", seed=1)
    text = campaign.read_text("utf-8").replace('serial = "4711"', "serial = 4711")
    text = text.replace('feed = "1500 mm/min"', "feed = 1500.0")
    text = text.replace("date = 2026-03-02", "date = 2026-03-02T10:30:00")
    campaign.write_text(text, encoding="utf-8")
    page = tmp_path / "page.html"
    assert abbe("compare", model, campaign, "--report", page).status == 0
    stated = facts(page)
    assert (stated["Feed"], stated["Date"]) == ("1500", "2026-03-02 10:30")
