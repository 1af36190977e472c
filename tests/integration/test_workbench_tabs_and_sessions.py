"""Two tabs of one person, and a session that ends while tables are written, in Chromium."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from abbe.daemon.config.tokens import add_token
from tests.support.daemon.browser import chromium, visit
from tests.support.daemon.some_setups import some_setups
from tests.support.daemon.upload_cases import patient_place, sums
from tests.support.daemon.workbench import opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

BRIDGE = Path(__file__).parents[1] / "data" / "p03-bridge"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


@pytest.mark.thorough
def test_two_tabs_of_one_person(browser: Browser, tmp_path: Path) -> None:
    campaign = some_setups(BRIDGE / "fit.csv", tmp_path / "some.csv", every=6)
    with opened(BRIDGE / "model.toml", campaign, "--versions", tmp_path / "v") as bench:
        one = visit(browser, bench).page
        # the same cookie: another tab needs no address of its own
        two = one.context.new_page()
        two.goto(bench.origin)
        two.wait_for_selector("#view[data-tab=compare]")
        one.click("#tab-learn")
        one.wait_for_selector("#what-if[data-ready]")
        one.fill("#any-cause", "backlash axis=X")
        two.click("#tab-learn")
        two.locator(".cause .add").first.click()
        two.wait_for_selector("tr.current:has-text('backlash axis=Z')")
        expect(one.locator("#version")).to_have_text("model-2.toml")
        expect(one.locator("#trouble")).to_contain_text("changed in another window")
        one.click("#tab-watch")
        one.wait_for_selector("tr.current:has-text('backlash axis=Z')")
        # closed, the other tab goes on
        two.close()
        expect(one.locator("#task")).to_be_hidden()
        # while the server is at work for the tab that is gone, it refuses, and says so
        while True:
            one.locator("button.back").first.click()
            one.wait_for_function(
                """() => document.querySelector("#version").textContent === "model.toml"
                || !document.querySelector("#trouble").hidden"""
            )
            if one.locator("#version").text_content() == "model.toml":
                break
            one.wait_for_timeout(500)


@pytest.mark.thorough
def test_a_session_that_ends_while_tables_are_written(browser: Browser, tmp_path: Path) -> None:
    with patient_place(tmp_path) as place:
        secret = add_token(place.folder / "http-tokens.toml", "cell-3", "operate")
        with opened(place.config, "--tables", place.folder / "new", "--session", "0.003") as bench:
            page = visit(browser, bench, until=".tables[data-ready]").page
            page.locator("#controller button").first.click()
            page.wait_for_selector("#write")
            page.fill("#write-machine", "mill")
            page.fill("#write-token", secret)
            page.fill("#write-by", "A. Vogel")
            # the control hangs where the tables are made active, for as long as the session lives
            place.control.order("fault", kind="hang", at="commit")
            page.click("#write")
            expect(page.locator("#trouble")).to_contain_text("not let in any more")
            place.control.order("clear")
            place.control.order("wake")
            assert bench.process.stdout is not None
            again = next(
                line.split()[-1]
                for line in bench.process.stdout
                if line.startswith("for another browser")
            )
            tab = page.context.new_page()
            tab.goto(again)
            tab.wait_for_selector("#view[data-tab]")
            # nobody cut it off: it is done once, whole or not at all, and the window says which
            page.wait_for_selector("#said[data-kind=write]:not([data-ended=''])")
            ended = page.locator("#said").get_attribute("data-ended")
            names = {e["upload"] for e in place.entries()}
            assert len(names) == 1
            old, new = sums(place.folder / "old"), sums(place.folder / "new")
            assert place.truth()["active"] == (new if ended == "good" else old)
