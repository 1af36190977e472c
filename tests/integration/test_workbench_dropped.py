"""A campaign with a hidden effect, dropped on the page; then by keys alone to the report."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.support.daemon.browser import assert_for_everybody, assert_quiet, chromium, visit
from tests.support.daemon.some_setups import some_setups
from tests.support.daemon.workbench import opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

MILL = Path(__file__).parents[1] / "data" / "p01-mill"
DROP = """([name, text]) => {
  const carried = new DataTransfer();
  carried.items.add(new File([text], name, {type: "text/csv"}));
  const said = {dataTransfer: carried, bubbles: true, cancelable: true};
  document.body.dispatchEvent(new DragEvent("dragover", said));
  return document.body.dispatchEvent(new DragEvent("drop", said));
}"""
"""Whether the browser would go to the file instead."""
MOST = 400


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


def by_keys(page: Page, selector: str) -> None:
    """Go to an element by Tab alone; it has to be seen that it is reached."""
    for _ in range(MOST):
        if page.evaluate("s => document.activeElement.matches(s)", selector):
            break
        page.keyboard.press("Tab")
    else:
        raise AssertionError(f"no key leads to {selector}")
    seen = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
    assert seen != "none", selector
    box = page.evaluate("document.activeElement.getBoundingClientRect().toJSON()")
    assert -1 < box["y"] < page.viewport_size["height"], selector  # type: ignore[index]


def press(page: Page, selector: str) -> None:
    by_keys(page, selector)
    page.keyboard.press("Enter")


@pytest.mark.thorough
def test_from_a_dropped_campaign_to_the_report_by_keys_alone(
    browser: Browser, tmp_path: Path
) -> None:
    folder = tmp_path / "versions"
    with opened(MILL / "model.toml", "--versions", folder) as bench:
        seen = visit(browser, bench, until="#campaigns .note")
        page = seen.page
        expect(page.locator("h1")).to_have_text("Nothing has been measured here yet")
        assert_for_everybody(page)
        # what is no campaign is refused in one sentence, and nothing happens to the page
        for name, text, said in (
            ("<img src=x onerror=alert(1)>.csv", "time\n0\n", "this name cannot be taken"),
            ("day.csv", "PK\u0003\u0004", "this is packed"),
            ("day.csv", "time,setup\n1,2\n", "day.csv"),
        ):
            assert page.evaluate(DROP, [name, text]) is False
            expect(page.locator("#trouble")).to_contain_text(said)
        expect(page.locator("h1")).to_have_text("Nothing has been measured here yet")
        assert [e for e in seen.errors if "422" not in e and "415" not in e] == []
        seen.errors.clear()

        # a good one: the verdict, in one sentence
        by_keys(page, "#who")
        page.keyboard.type("Erika")
        some = some_setups(MILL / "fit.csv", tmp_path / "some.csv", every=3)
        page.evaluate(DROP, ["mill.csv", some.read_text("utf-8")])
        expect(page.locator("h1")).to_have_class("bad")
        expect(page.locator("#facts summary")).to_contain_text("mill.csv (")
        press(page, "td button.small")
        expect(page.locator("#selection")).to_be_visible()
        press(page, "#selection button")
        expect(page.locator("#selection")).to_be_hidden()
        # learn
        press(page, "#tab-compare")
        press(page, "#why")
        page.wait_for_selector("#what-if[data-ready]")
        expect(page.locator(".cause code").first).to_contain_text("thermal_tilt axis=Y about=X")
        before = page.locator("#what-if").get_attribute("data-rms")
        by_keys(page, "#what-if input[type=range]")
        for _ in range(20):
            page.keyboard.press("ArrowLeft")
        expect(page.locator("#what-if")).not_to_have_attribute("data-rms", before or "")
        # add it; nobody has to wait for what to measure next
        press(page, ".cause .add")
        page.wait_for_selector("tr.current:has-text('thermal_tilt')")
        expect(page.locator("h1")).to_contain_text("The error fell from")
        expect(page.locator("#task")).to_be_hidden()
        # a note, which stays a text
        note = "Column covered <b>since</b> Monday"
        by_keys(page, "#note-text")
        page.keyboard.type(note)
        press(page, "#keep-note")
        row = page.locator("#done tbody tr").first
        expect(row).to_contain_text("Erika, browser 1")
        expect(row).to_contain_text(note)
        # side by side
        press(page, "#look-beside")
        page.wait_for_selector("#beside[data-ready]")
        expect(page.locator("#beside h3")).to_have_text(["model.toml", "model-2.toml"])
        expect(page.locator("#beside code").first).to_contain_text("thermal_tilt axis=Y about=X")
        rms = page.locator("#beside .card dd").all_inner_texts()
        half = len(rms) // 2
        assert float(rms[0].split()[0]) > 2.0 * float(rms[half].split()[0])
        assert page.locator("#beside .scatter").count() > 3
        assert_for_everybody(page)
        # back, and the journal has who and when
        press(page, "button.back")
        expect(page.locator("#version")).to_have_text("model.toml")
        expect(page.locator("#done tbody tr").first).to_contain_text("in place of model-2.toml")
        expect(page.locator("#task")).to_be_hidden()
        with page.expect_popup() as found:
            press(page, "#report")
        found.value.wait_for_selector("#paper[data-ready]")
        assert note in found.value.locator("body").inner_text()
        page.bring_to_front()
        press(page, "#end")
        expect(page.locator("h1")).to_have_text("The workbench is closed.")
        assert bench.process.wait(60) == 0
        assert_quiet(seen, bench)
    journal = [json.loads(line) for line in (folder / "workbench.jsonl").read_bytes().splitlines()]
    assert [e["what"] for e in journal] == ["sent", "sent", "campaigns", "made", "note", "back"]
    assert {e["who"] for e in journal[1:]} == {"Erika, browser 1"}
    assert [p.name for p in (folder / "campaigns").iterdir()] == ["mill.csv"]
