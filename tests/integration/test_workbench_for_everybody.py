"""Every view for everybody: WCAG 2.2 AA by axe-core, light and dark, narrow and wide; on paper."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.support.daemon.browser import INK, assert_for_everybody, assert_quiet, chromium, visit
from tests.support.daemon.live_run import compensating, live_run, machine
from tests.support.daemon.some_setups import some_setups
from tests.support.daemon.workbench import opened
from tests.support.pdf_text import pages_of

pytestmark = [pytest.mark.integration, pytest.mark.timeout(900)]

IN_FULL = {"en-GB": "corrected in full", "de-DE": "voll korrigiert"}
BRIDGE = Path(__file__).parents[1] / "data" / "p03-bridge"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


@pytest.mark.thorough
@pytest.mark.parametrize(("scheme", "locale"), [("light", "en-GB"), ("dark", "de-DE")])
def test_the_live_view(browser: Browser, tmp_path: Path, scheme: str, locale: str) -> None:
    with machine(tmp_path) as (_, config):
        config.write_text(config.read_text() + "\n[records]\nevery = 0.1\n\n[http]\n")
        with opened(config) as bench:
            live = "#view[data-tab=live]"
            seen = visit(
                browser,
                bench,
                until=live,
                color_scheme=scheme,
                locale=locale,
                reduced_motion="reduce",
            )
            page = seen.page
            page.wait_for_selector(".live[data-seen=lost]")
            assert_for_everybody(page)
            with live_run(config) as run:
                run.until(compensating)
                expect(page.locator("#state")).to_have_text(IN_FULL[locale])
                page.wait_for_selector("#volume canvas")
                page.wait_for_selector("#history[data-ready]")
                assert_for_everybody(page)
                page.set_viewport_size({"width": 360, "height": 800})
                assert_for_everybody(page)
                page.set_viewport_size({"width": 3840, "height": 2160})
            page.wait_for_selector(".live[data-seen=lost]")
            assert_for_everybody(page)
            assert [e for e in seen.errors if "409" not in e] == []


@pytest.mark.thorough
def test_compare_learn_and_watch(browser: Browser, tmp_path: Path) -> None:
    """English, light, 4K; German and dark on a smaller screen in `test_workbench_german.py`."""
    campaign = some_setups(BRIDGE / "fit.csv", tmp_path / "some.csv", every=3)
    files = (BRIDGE / "model.toml", campaign, "--versions", tmp_path / "versions")
    with opened(*files) as bench:
        seen = visit(browser, bench, 3840, color_scheme="light", reduced_motion="reduce")
        page = seen.page
        page.wait_for_selector("h1.bad")
        assert_for_everybody(page)
        page.click("#tab-learn")
        page.wait_for_selector("#what-if[data-ready]")
        page.wait_for_selector("#advice li")
        expect(page.locator("#task")).to_be_hidden()
        assert_for_everybody(page)
        page.locator("button.add").first.click()
        page.wait_for_selector(".course")
        expect(page.locator("#task")).to_be_hidden()
        page.wait_for_selector(".course .main-svg")
        assert_for_everybody(page)
        assert_quiet(seen, bench)


WEIGH = """() => performance.getEntriesByType("resource").concat(
  performance.getEntriesByType("navigation")).reduce((sum, e) => sum + e.transferSize, 0)"""
FILES = """() => performance.getEntriesByType("resource")
  .map((e) => [e.name, e.transferSize]).filter(([name]) => name.includes("/files-"))"""


def test_with_the_keyboard_alone_and_little_travels(browser: Browser, tmp_path: Path) -> None:
    """Views by arrow keys, rows by a table's button, sliders by keys; the focus is always seen.

    The first sight is small, and what the browser has is not sent again.
    """
    campaign = some_setups(BRIDGE / "fit.csv", tmp_path / "some.csv", every=6)
    with opened(BRIDGE / "model.toml", campaign) as bench:
        seen = visit(browser, bench)
        page = seen.page
        page.wait_for_selector("#view[data-tab=compare] h1")
        page.keyboard.press("Tab")
        expect(page.locator("#tab-compare")).to_be_focused()
        page.keyboard.press("ArrowRight")
        expect(page.locator("#tab-learn")).to_be_focused()
        page.wait_for_selector("#what-if[data-ready]")
        slider = page.locator("#what-if input[type=range]").first
        before = page.locator("#what-if").get_attribute("data-rms")
        page.wait_for_selector(".plot .main-svg")
        # with Plotly, once
        assert 500_000 < page.evaluate(WEIGH) < 2_500_000
        slider.focus()
        outline = slider.evaluate("e => getComputedStyle(e).outlineStyle")
        assert outline == "solid"
        for _ in range(30):
            page.keyboard.press("ArrowLeft")
        page.wait_for_function(
            "was => document.querySelector('#what-if').dataset.rms !== was", arg=before
        )
        page.locator("#tab-learn").focus()
        page.keyboard.press("ArrowLeft")
        page.wait_for_selector("#view[data-tab=compare] h1")
        show = page.locator("button", has_text="Show").first
        show.focus()
        page.keyboard.press("Enter")
        expect(page.locator("#selection")).to_be_visible()
        page.reload()
        page.wait_for_selector("h1.bad")
        assert 0 < page.evaluate(WEIGH) < 300_000
        # of files nothing is asked for again, and Plotly not before a picture needs it
        asked = page.evaluate(FILES)
        assert len(asked) > 20
        assert [name for name, size in asked if size or "plotly" in name] == []
        assert_quiet(seen, bench)


@pytest.mark.thorough
def test_on_paper_the_volume_is_there(browser: Browser, tmp_path: Path) -> None:
    campaign = some_setups(BRIDGE / "fit.csv", tmp_path / "some.csv", every=6)
    with opened(BRIDGE / "model.toml", campaign) as bench:
        seen = visit(browser, bench, color_scheme="dark")
        page = seen.page
        page.wait_for_selector(".volume canvas")
        canvas = page.locator(".volume canvas").first
        canvas.evaluate(
            "drawn => drawn.scrollIntoView({block: 'center'})"
        )  # may be drawn anew meanwhile
        assert canvas.evaluate(INK) > 300
        # what stands on paper is black on white, also where the screen is dark
        dark = page.evaluate("getComputedStyle(document.body).backgroundColor")
        page.evaluate("dispatchEvent(new Event('beforeprint'))")
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") != dark
        assert canvas.evaluate(INK) > 300
        page.evaluate("dispatchEvent(new Event('afterprint'))")
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == dark
        # the first sheet says what it is of, and is no heading alone
        paper_file = tmp_path / "compare.pdf"
        page.pdf(path=paper_file, format="A4")
        first = pages_of(paper_file)[0].text
        digest = hashlib.sha256(campaign.read_bytes()).hexdigest()
        for words in ("Operator", "Environment", "Serialnumber", digest, "THEMODELDOESNOTHOLD"):
            assert words in first, words
        assert page.locator("#facts").get_attribute("open") is None
        # and the file that a printer gets has a drawing for each
        drawings = re.compile(rb"/Subtype\s*/(?:Form|Image)")
        paper = drawings.findall(page.pdf(print_background=False))
        pictures = page.locator("canvas").count()
        assert pictures >= 5
        page.evaluate("document.querySelectorAll('canvas').forEach((c) => c.remove())")
        assert len(paper) - len(drawings.findall(page.pdf(print_background=False))) >= pictures
        assert_quiet(seen, bench)
