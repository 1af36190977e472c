"""Every view in German, walked through: no English text is seen; and in English it would be."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from abbe.daemon.config.tokens import add_token
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.browser import assert_for_everybody, assert_quiet, chromium, visit
from tests.support.daemon.german import as_pattern, english_of, english_on
from tests.support.daemon.live_run import MODEL
from tests.support.daemon.measuring import configuration
from tests.support.daemon.some_setups import some_setups
from tests.support.daemon.upload_cases import patient_place
from tests.support.daemon.workbench import opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

BRIDGE = Path(__file__).parents[1] / "data" / "p03-bridge"
STATIC = Path(__file__).parents[2] / "daemon" / "workbench" / "static"
OWN = frozenset({"held-out", "no load; feed 1500 mm/min", "error (Fehler)"})
"""What people wrote into files, and words of a file that are explained."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


def assert_german(page: Page) -> None:
    """Nothing that is seen, or that can be opened, is English."""
    page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    assert list(english_on(page, OWN)) == []


def assert_found_in_english(page: Page) -> None:
    """The same look finds English where it is."""
    page.select_option("#language", "en")
    expect(page.locator("#tab-live")).to_have_text("Live")
    expect(page.locator("#end")).to_have_text("End")
    page.wait_for_selector("h1")
    page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    assert len(list(english_on(page, OWN))) > 10


def test_words_that_are_found() -> None:
    assert english_of("Die Z-Achse steht the whole 5 µm woanders") == ["the"]
    assert english_of("Ursache: backlash axis=Z; Datei the_axis.csv, --of, 3 mm") == []


@pytest.mark.thorough
def test_the_model(browser: Browser, tmp_path: Path) -> None:
    """In the dark, too; and for everybody as each view stands."""
    words = json.loads((STATIC / "words" / "de.json").read_text("utf-8"))
    known = [
        as_pattern(own) for own in ((words | words["_labels"]).values()) if isinstance(own, str)
    ]
    campaign = some_setups(BRIDGE / "fit.csv", tmp_path / "some.csv", every=6)
    with opened(BRIDGE / "model.toml", campaign, "--versions", tmp_path / "versions") as bench:
        seen = visit(
            browser, bench, until="h1.bad", locale="de-DE", color_scheme="dark",
            reduced_motion="reduce",
        )  # fmt: skip
        page = seen.page
        page.wait_for_selector(".volume canvas")
        expect(page.locator("#tab-compare")).to_have_text("1 Vergleichen")
        expect(page.locator("h1")).to_have_text("Das Modell stimmt nicht")
        expect(page.locator(".verdict p").first).to_contain_text("DAS MODELL STIMMT NICHT")
        assert_german(page)
        assert_for_everybody(page)
        # every heading and name has its word, whoever gave it
        named = page.locator("main th, main summary, dl dt, .scatter figcaption")
        for text in named.all_text_contents():
            assert any(p.fullmatch(text.strip()) for p in known), text
        page.click("#tab-learn")
        page.wait_for_selector("#what-if[data-ready]")
        page.wait_for_selector("#advice li")
        expect(page.locator("#task")).to_be_hidden()
        expect(page.locator(".verdict p").first).to_contain_text("Residuen: Effektivwert")
        assert_german(page)
        assert_for_everybody(page)
        page.locator(".cause .add").first.click()
        page.wait_for_selector("tr.current td:has-text('backlash')")
        expect(page.locator("#task")).to_be_hidden()
        page.click("#look-beside")
        page.wait_for_selector("#beside[data-ready]")
        # a note changes what was done, not what lies side by side
        page.fill("#note-text", "Kette geschmiert")
        page.click("#keep-note")
        page.wait_for_selector("#done td:has-text('geschmiert')")
        expect(page.locator("#beside[data-ready] .pair")).to_be_visible()
        page.wait_for_selector(".course .main-svg")
        assert_german(page)
        assert_for_everybody(page)
        with page.expect_popup() as found:
            page.click("#report")
        found.value.wait_for_selector("#paper[data-ready]")
        assert_german(found.value)
        assert_for_everybody(found.value)
        page.bring_to_front()
        assert_found_in_english(page)
        # switched, it stays switched, and shows the view that it showed
        expect(page.locator("#tab-watch")).to_have_attribute("aria-selected", "true")
        page.reload()
        expect(page.locator("#tab-compare")).to_have_text("1 Compare")
        assert_quiet(seen, bench)


@pytest.mark.thorough
def test_the_controller(browser: Browser, tmp_path: Path) -> None:
    with patient_place(tmp_path) as place:
        secret = add_token(place.folder / "http-tokens.toml", "cell-3", "operate")
        with opened(place.config, "--tables", place.folder / "new") as bench:
            page = visit(browser, bench, until=".tables[data-ready]", locale="de-DE").page
            page.wait_for_selector(".plot .scatterlayer path")
            assert_german(page)
            page.locator("#controller button").first.click()
            page.wait_for_selector("#said[data-kind=preflight][data-ended=good]")
            assert_german(page)
            for machine, token, why in (("mill", "", "Rolle"), ("lathe", secret, "Maschine")):
                page.fill("#write-machine", machine)
                page.fill("#write-token", token)
                page.click("#write")
                expect(page.locator("#said [role=alert]")).to_contain_text(why)
                assert_german(page)
            page.fill("#write-machine", "mill")
            page.fill("#write-token", secret)
            page.fill("#write-by", "A. Vogel")
            page.click("#write")
            page.wait_for_selector("#said[data-kind=write][data-ended=good]")
            expect(page.locator("#journal tbody tr")).to_have_count(1)
            assert_german(page)
            # nothing runs, and nothing was measured
            page.click("#tab-live")
            page.wait_for_selector(".live[data-seen]")
            assert_german(page)
            page.click("#tab-compare")
            page.wait_for_selector("#campaigns .note")
            assert_german(page)
            page.click("#tab-tables")
            page.wait_for_selector(".plot .scatterlayer path")
            assert_found_in_english(page)


@pytest.mark.thorough
def test_the_guide(browser: Browser, tmp_path: Path) -> None:
    text = MODEL.read_text("utf-8")
    (tmp_path / "model.toml").write_text(re.sub(r"(?m)^name = .*$", 'name = "KMG"', text, count=1))
    with SimulatedProcess("bench", "--seed", "1") as machine:
        config = configuration(machine.ready, tmp_path)
        config.write_text(config.read_text() + "\n[http]\n")
        with opened(config, "--calibration", tmp_path / "c") as bench:
            page = visit(browser, bench, until=".calibration[data-ready]", locale="de-DE").page
            assert_german(page)
            page.fill("#ask-time", "20min")
            page.fill("#ask-tools", "P=0,0,-150")
            page.fill("#ask-controller", "linuxcnc")
            page.click("#ask")
            for step in ("start", "plan", "program"):
                page.wait_for_selector(f'div[data-step="{step}"] #go')
                page.click("#go")
                page.wait_for_selector(f'li[data-step="{step}"][data-state=done]')
                assert_german(page)
            page.wait_for_selector('div[data-step="measure"] #go')
            page.click("#go")
            expect(page.locator("#doing [role=alert]")).to_contain_text("Rolle operate")
            assert_german(page)
            assert_found_in_english(page)
