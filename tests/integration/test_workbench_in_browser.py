"""The workbench in Debian's Chromium, by clicking: seen, understood, tried, added, gone back."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.support.daemon.browser import INK, WIDTHS, assert_quiet, chromium, visit
from tests.support.daemon.some_setups import some_setups
from tests.support.daemon.workbench import opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

BRIDGE = Path(__file__).parents[1] / "data" / "p03-bridge"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


def selected(page: Page, panel: str) -> int:
    found = page.locator(f'[data-panel="{panel}"]').get_attribute("data-selected")
    return int(found or 0)


def test_the_whole_loop_by_clicking(browser: Browser, tmp_path: Path) -> None:
    files = (BRIDGE / "model.toml", BRIDGE / "fit.csv", "--holdout", BRIDGE / "check.csv")
    with opened(*files, "--versions", tmp_path / "versions") as bench:
        seen = visit(browser, bench)
        page = seen.page
        # compare: the verdict first, and its picture first
        expect(page.locator("h1")).to_have_text(
            "Z stands 5.4 µm elsewhere when it comes from above"
        )
        summary = page.locator("#facts summary").inner_text()
        for part in ("Date: not stated", "Serial number: not stated", "model.toml (", "fit.csv (",
                     "check.csv ("):  # fmt: skip
            assert part in summary
        first = page.locator(".scatter").first
        expect(first.locator("figcaption")).to_have_text("along Z, measured in Z")
        assert first.locator("canvas").evaluate(INK) > 300

        # one brush: a lump of points of one picture is selected in all of them
        canvas = first.locator("canvas")
        canvas.evaluate(
            "drawn => drawn.scrollIntoView({block: 'center'})"
        )  # may be drawn anew meanwhile
        box = canvas.bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 50, box["y"] + 10)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.9 * box["width"], box["y"] + 82, steps=4)
        page.mouse.up()
        chosen = selected(page, "0 along Z, measured in Z")
        assert chosen > 10
        for other in ("0 by set-up", "0 over time", "0 volume"):
            assert selected(page, other) == chosen
        assert selected(page, "0 along Y, measured in Y") == 0
        assert f"{chosen} rows" in page.locator("#selection").inner_text()
        # a row of a table as well
        page.locator("#selection button").click()
        expect(page.locator("#selection")).to_be_hidden()
        page.locator("details[open] button.small", has_text="Show").first.click()
        assert selected(page, "0 by set-up") == 1
        assert selected(page, "0 volume") == 1

        # learn: the cause, and its convincing picture
        page.click("#why")
        page.wait_for_selector("#what-if[data-ready]")
        expect(page.locator(".cause h2").first).to_contain_text("Z stands 5.4 µm elsewhere")
        page.wait_for_selector(".cause .js-plotly-plot .scatterlayer path")
        expect(page.locator("#advice li").first).to_contain_text("uncertainty falls")

        # what if: at nothing the error is as it was, at the fitted value it is noise
        panel = page.locator("#what-if")
        best = float(panel.get_attribute("data-rms") or "nan")
        assert best < 0.6
        slider = panel.locator("input[data-name='amount of it']")
        slider.fill("0")
        expect(panel).not_to_have_attribute("data-rms", str(best))
        panel.and_(page.locator("[data-rms^='1.1']")).wait_for()
        expect(panel.locator(".bars-row").nth(1)).to_contain_text("1.11 µm")
        panel.locator("button", has_text="As the measurements say").click()
        expect(panel).to_have_attribute("data-rms", str(best))
        # any other cause can be tried
        page.fill("#any-cause", "backlash axis=X")
        page.keyboard.press("Enter")
        page.wait_for_selector('#what-if[data-spec="backlash axis=X"][data-ready]')
        assert float(panel.get_attribute("data-rms") or "nan") > 1.0

        # add it: the error falls, on what was fitted and on what was not
        page.locator(".cause .add").first.click()
        page.wait_for_selector("tr.current:has-text('backlash axis=Z')")
        expect(page.locator("h1")).to_contain_text("The held-out error fell from 0.99")
        expect(page.locator(".course")).to_have_count(2)
        page.wait_for_selector(".course .barlayer path")
        assert (tmp_path / "versions" / "model-2.toml").stat().st_size > 1000
        expect(page.locator("#version")).to_have_text("model-2.toml")
        expect(page.locator("#task")).to_be_hidden()
        page.click("#tab-compare")
        page.wait_for_selector("#view[data-tab=compare] h1")
        assert "Z stands" not in page.locator("h1").inner_text()

        # and back
        page.click("#tab-watch")
        page.locator("button.back").first.click()
        expect(page.locator("#version")).to_have_text("model.toml")
        # what is looked at now is not what the error fell to
        expect(page.locator("h1")).to_contain_text("Version 1 of 2 is looked at: 1.1")
        page.click("#tab-compare")
        expect(page.locator("h1")).to_contain_text("Z stands 5.4 µm elsewhere")
        assert_quiet(seen, bench)

        # a second person is told what the first one changes
        assert bench.process.stdout is not None
        bench.process.stdout.readline()
        bench.address = bench.process.stdout.readline().split()[-1]
        other = visit(browser, bench)
        other.page.click("#tab-watch")
        other.page.locator("button.back[data-version='1']").click()
        expect(page.locator("#trouble")).to_contain_text("changed in another window")
        expect(page.locator("#version")).to_have_text("model-2.toml")
        # also when what that started is over
        expect(page.locator("#task")).to_be_hidden()
        expect(other.page.locator("#task")).to_be_hidden()
        expect(page.locator("#trouble")).to_contain_text("changed in another window")
        page.click("#tab-watch")
        expect(page.locator("#trouble")).to_be_hidden()
        assert_quiet(other, bench)
        other.page.click("#end")
        expect(other.page.locator("h1")).to_have_text("The workbench is closed.")
        assert bench.process.wait(60) == 0
        # the server that is gone is said
        expect(page.locator("#trouble")).to_contain_text("does not answer")


def test_names_are_text_and_every_width_has_room(browser: Browser, tmp_path: Path) -> None:
    """Hostile names of machine, set-up, file; nothing is wider than the window."""
    hostile = "<img src=x onerror=alert(1)>"
    model = tmp_path / "<i>model.toml"
    model.write_text((BRIDGE / "model.toml").read_text().replace('"held-out"', f'"{hostile}"'))
    campaign = some_setups(BRIDGE / "fit.csv", tmp_path / "<b>day.csv", every=6)
    named = campaign.read_text().replace("[setups.master_z]", f'[setups."{hostile}"]')
    campaign.write_text(named.replace(",master_z,", f",{hostile},"))
    with opened(model, campaign) as bench:
        seen = visit(browser, bench)
        page = seen.page
        for tab in ("compare", "learn", "watch"):
            page.click(f"#tab-{tab}")
            page.wait_for_selector(f"#view[data-tab={tab}] h1")
            page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
            for width in WIDTHS:
                page.set_viewport_size({"width": width, "height": 900})
                page.wait_for_function(
                    "width => document.documentElement.scrollWidth <= width", arg=width
                )
        page.click("#tab-compare")
        page.wait_for_selector("#view[data-tab=compare] h1")
        assert hostile in (page.locator("main").text_content() or "")
        expect(page.locator("#machine")).to_have_text(hostile)
        assert page.locator("img, main i, main b:has(*)").count() == 0
        # without a folder nothing can be added, and that is said
        page.click("#tab-learn")
        page.wait_for_selector("#view[data-tab=learn] h1")
        expect(page.locator("main")).to_contain_text("--versions FOLDER")
        for add in page.locator("button.add").all():
            assert add.is_disabled()
        assert_quiet(seen, bench)
