"""What happens behind a window's back in Chromium: two add at once, it is closed, files change.

Nothing is lost, nothing is done twice or half, and the person is told.
"""

from __future__ import annotations

import json
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, Route, expect

from tests.support.daemon.browser import chromium, visit, watched
from tests.support.daemon.live_run import MODEL, compensating, live_run, machine
from tests.support.daemon.some_setups import some_setups
from tests.support.daemon.workbench import OpenedWorkbench, opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

BRIDGE = Path(__file__).parents[1] / "data" / "p03-bridge"
SET_BACK = """
window.setBack = 0;
const now = Date.now;
Date.now = () => now() - window.setBack;
"""
"""A computer whose clock can be set back."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


@pytest.fixture
def files(tmp_path: Path) -> tuple[str | Path, ...]:
    """A model, a campaign, and where versions go."""
    shutil.copy(BRIDGE / "model.toml", tmp_path)
    campaign = some_setups(BRIDGE / "fit.csv", tmp_path / "some.csv", every=6)
    return (tmp_path / "model.toml", campaign, "--versions", tmp_path / "versions")


def further(bench: OpenedWorkbench) -> OpenedWorkbench:
    """With the address for another browser."""
    assert bench.process.stdout is not None
    for line in bench.process.stdout:
        if line.startswith("for another browser"):
            bench.address = line.split()[-1]
            break
    return bench


def learning(browser: Browser, bench: OpenedWorkbench) -> Page:
    page = visit(browser, bench).page
    page.click("#tab-learn")
    page.wait_for_selector("#what-if[data-ready]")
    page.wait_for_selector("#advice li")
    expect(page.locator("#task")).to_be_hidden()
    return page


def made(folder: Path) -> list[dict[str, Any]]:
    """What the journal says was made."""
    lines = (folder / "workbench.jsonl").read_bytes().splitlines()
    return [e for e in map(json.loads, lines) if e["what"] == "made"]


def test_what_was_clicked_on_another_model_is_not_done(
    browser: Browser, files: tuple[str | Path, ...], tmp_path: Path
) -> None:
    with opened(*files) as bench:
        one = learning(browser, bench)
        two = learning(browser, further(bench))
        # the second window does not hear of what the first one does
        before = json.dumps(bench_state(two))
        two.route("**/api/state", lambda route: served(route, before))
        one.locator(".cause .add").first.click()
        one.wait_for_selector("tr.current:has-text('backlash axis=Z')")
        expect(one.locator("#task")).to_be_hidden()
        two.locator(".cause .add").first.click()
        expect(two.locator("#trouble")).to_contain_text("changed in another window meanwhile")
        assert [e["version"] for e in made(tmp_path / "versions")] == ["model-2.toml"]
        two.unroute("**/api/state")
        expect(two.locator("#version")).to_have_text("model-2.toml")
        expect(two.locator("#trouble")).to_contain_text("changed in another window")


def bench_state(page: Page) -> Any:
    return page.evaluate("async () => (await fetch('/api/state')).json()")


def served(route: Route, body: str) -> None:
    route.fulfill(body=body, content_type="application/json")


@pytest.mark.thorough
def test_a_browser_that_is_closed_while_a_cause_is_added(
    browser: Browser, files: tuple[str | Path, ...], tmp_path: Path
) -> None:
    with opened(*files) as bench:
        page = learning(browser, bench)
        with page.expect_response("**/api/add") as answered:
            page.locator(".cause .add").first.click()
        assert answered.value.ok
        page.context.close()
        # whoever opens it anew sees what has become of it
        page = visit(browser, further(bench)).page
        expect(page.locator("#version")).to_have_text("model-2.toml")
        page.click("#tab-watch")
        page.wait_for_selector("tr.current:has-text('backlash axis=Z')")
        expect(page.locator("#done tbody tr").first).to_contain_text("model-2.toml made of")
        (entry,) = made(tmp_path / "versions")
        assert entry["who"] == "browser 1"


@pytest.mark.thorough
def test_a_model_that_is_replaced_on_the_disk(
    browser: Browser, files: tuple[str | Path, ...], tmp_path: Path
) -> None:
    with opened(*files) as bench:
        page = learning(browser, bench)
        facts = page.locator("#facts summary").inner_text()
        model = tmp_path / "model.toml"
        text = model.read_text("utf-8")
        model.write_text(text.replace('"held-out"', '"held-out"\nserial = "77"'), "utf-8")
        expect(page.locator("#differ")).to_contain_text("another model.toml")
        # figures of the old one stand under its own SHA-256, and nothing is made of a mixture
        assert page.locator("#facts summary").inner_text() == facts
        page.locator(".cause .add").first.click()
        expect(page.locator("#trouble")).to_contain_text("another file on the disk")
        page.click("#tab-watch")
        page.locator("#fit").click()
        expect(page.locator("#trouble")).to_contain_text("another file on the disk")
        assert not list((tmp_path / "versions").glob("*.toml"))
        # of another machine, it is not mixed with the campaigns of this one
        page.locator("#differ button").click()
        expect(page.locator("#trouble")).to_contain_text("of another machine now")
        model.write_text(f"{text}\n# looked at\n", "utf-8")
        page.locator("#differ button").click()
        expect(page.locator("#differ")).to_be_hidden()
        expect(page.locator("#facts summary")).not_to_have_text(facts)
        expect(page.locator("#task")).to_be_hidden()
        page.click("#tab-watch")
        expect(page.locator("#done tbody tr").first).to_contain_text("read again")
        # so with a campaign; put back as it was it is the one that was read
        campaign = tmp_path / "some.csv"
        kept = campaign.read_bytes()
        campaign.unlink()
        expect(page.locator("#differ")).to_contain_text("some.csv")
        campaign.write_bytes(kept)
        expect(page.locator("#differ")).to_be_hidden()


@pytest.mark.thorough
def test_live_while_the_service_is_started_anew_and_the_clock_is_set_back(
    browser: Browser, tmp_path: Path
) -> None:
    with machine(tmp_path) as (_, config):
        model = shutil.copy(MODEL, tmp_path / "model.toml")
        text = config.read_text().replace(str(MODEL), str(model))
        config.write_text(text + "\n[records]\nevery = 0.1\n\n[http]\n")
        with opened(config) as bench:
            seen = watched(browser)
            page = seen.page
            page.add_init_script(SET_BACK)
            page.goto(bench.address)
            with live_run(config) as run:
                run.until(compensating)
                page.wait_for_selector(".live[data-cycle]")
                page.wait_for_selector("#volume canvas")
            expect(page.locator("#lost")).to_be_visible()
            expect(page.locator("#age")).to_contain_text("says nothing of the present")
            with live_run(config) as run:
                run.until(compensating)
                expect(page.locator("#lost")).to_be_hidden()
                expect(page.locator("#state")).to_have_text("corrected in full")
                # the model is replaced: what runs is the old one, and no picture is of the new one
                model.write_text(model.read_text("utf-8") + "\n# another\n", "utf-8")
                expect(page.locator("#warnings")).to_contain_text("On the disk lies another")
                # nothing comes any more, and the clock is set back: nothing gets younger by that
                bench.process.send_signal(signal.SIGSTOP)
                page.evaluate("window.setBack = 3_600_000")
                expect(page.locator("#age")).to_contain_text("says nothing of the present")
                bench.process.send_signal(signal.SIGCONT)
                expect(page.locator("#age")).not_to_contain_text("says nothing of the present")
        # 409: no picture is drawn of a model that does not run
        assert [e for e in seen.errors if "ERR_" not in e and "409" not in e] == []
