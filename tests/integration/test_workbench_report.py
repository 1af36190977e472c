"""Reports of the workbench: a page that stands alone, and what a printer gets of it."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.support.daemon.browser import WIDTHS, assert_quiet, chromium, visit, watched
from tests.support.daemon.paper import COLOURED, assert_on_paper, report_of
from tests.support.daemon.some_setups import some_setups
from tests.support.daemon.workbench import opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

BRIDGE = Path(__file__).parents[1] / "data" / "p03-bridge"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


@pytest.mark.thorough
def test_a_view_as_a_page_that_stands_alone_and_on_paper(browser: Browser, tmp_path: Path) -> None:
    campaign = some_setups(BRIDGE / "fit.csv", tmp_path / "some.csv", every=6)
    said = '# operator = "R. Meier"\n# date = "2026-03-02"\n'
    campaign.write_text(said + campaign.read_text())
    with opened(BRIDGE / "model.toml", campaign) as bench:
        seen = visit(browser, bench, color_scheme="dark")
        page = seen.page
        page.wait_for_selector(".volume canvas")
        dark = page.evaluate("getComputedStyle(document.body).backgroundColor")
        drawn = page.locator("canvas:visible").count()
        made = report_of(page)
        # the view is as it was before
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == dark
        assert page.locator("canvas:visible").count() == drawn
        text = made.locator("#paper").inner_text()
        for part in ("R. Meier", "2026-03-02", "not stated", page.locator("h1").inner_text()):
            assert part in text
        for file in (BRIDGE / "model.toml", campaign):
            assert hashlib.sha256(file.read_bytes()).hexdigest() in text
        for width in WIDTHS:
            made.set_viewport_size({"width": width, "height": 900})
            made.wait_for_function(
                "width => document.documentElement.scrollWidth <= width", arg=width
            )
        # every picture that was drawn, the volume too; no control is left
        images = made.locator("#paper img")
        assert images.count() == drawn >= 5
        assert made.locator("#paper button, #paper canvas, #paper input").count() == 0
        for image in (images.first, made.locator("#paper .volume img").first):
            assert image.evaluate(COLOURED) > 300
        # saved it stands alone: no script, no request, the same text
        with made.expect_download() as saved:
            made.click("#save")
        alone = tmp_path / "report.html"
        saved.value.save_as(alone)
        assert "<script" not in alone.read_text()
        offline = watched(browser)
        offline.page.goto(alone.as_uri())
        assert offline.page.locator("#paper").inner_text() == text
        assert offline.page.evaluate("document.querySelectorAll('img').length") == drawn
        assert offline.errors == []
        assert [u for u in offline.requests if not u.startswith(("data:", alone.as_uri()))] == []
        # what a printer gets
        paper = tmp_path / "report.pdf"
        made.pdf(path=paper, format="A4")
        assert len(re.findall(rb"/Subtype\s*/Image", paper.read_bytes())) >= drawn
        # learn has Plotly's pictures
        page.click("#tab-learn")
        page.wait_for_selector("#what-if[data-ready]")
        page.wait_for_selector(".cause .js-plotly-plot .scatterlayer path")
        learned = report_of(page)
        image = learned.locator(".cause img").first
        assert image.evaluate(COLOURED) > 100
        assert (
            page.locator(".cause h2").first.inner_text() in learned.locator("#paper").inner_text()
        )
        # every view of it on paper
        files = (BRIDGE / "model.toml", campaign)
        assert_on_paper(page, tmp_path, 3, files)
        page.click("#tab-compare")
        page.wait_for_selector(".volume canvas")
        assert_on_paper(page, tmp_path, drawn, files)
        page.click("#tab-watch")
        page.wait_for_selector("#view[data-tab=watch] h1")
        assert_on_paper(page, tmp_path, 0, files)
        # views that were gone to and left again leave nothing behind
        devtools = page.context.new_cdp_session(page)

        def held() -> tuple[int, int]:
            for tab in ("compare", "learn", "watch"):
                page.click(f"#tab-{tab}")
                page.locator(f"#view[data-tab={tab}] h1").wait_for()  # a handle would hold it
                if tab == "learn":
                    page.locator("#what-if[data-ready]").wait_for()
            for _ in range(3):  # what is let go of in one is collected in the next
                devtools.send("HeapProfiler.collectGarbage")
            found = devtools.send("Memory.getDOMCounters")
            return int(found["nodes"]), int(found["jsEventListeners"])

        held()
        nodes, listeners = held()
        for _ in range(5):
            more = held()
        assert more[0] < 1.1 * nodes
        assert more[1] <= 1.1 * listeners
        assert_quiet(seen, bench)
