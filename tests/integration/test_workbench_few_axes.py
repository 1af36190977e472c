"""The workbench beside a lathe, a slit, a SCARA robot and an arm: the whole loop by clicking."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.support.daemon.browser import assert_for_everybody, assert_quiet, chromium, visit
from tests.support.daemon.few_axes import write_machine
from tests.support.daemon.few_axes_live import table_and_slide
from tests.support.daemon.live_run import compensating, live_run
from tests.support.daemon.workbench import opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

TURNED = "The tool sits elsewhere at the last joint than entered: "
"""What is the same while one tool is seen: where the last joint counts from."""
PLAY = "elsewhere when it comes from the plus side"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


def looked_at(page: Page) -> None:
    """For everybody, without what no person writes, and no table that one cannot read."""
    assert_for_everybody(page)
    text = page.locator("main").inner_text()
    assert re.findall(r"\b(?:NaN|undefined|null|None)\b|[−-]0(?:\.0+)? [µm°]", text) == []
    wide = page.evaluate("""() => [...document.querySelectorAll("main .wide")]
      .filter((t) => t.offsetWidth && t.scrollWidth > t.clientWidth + 2).map((t) => t.ariaLabel)""")
    assert wide == []


@pytest.mark.parametrize(
    ("name", "title", "cause"),
    [
        ("lathe", "X stands ", PLAY),
        pytest.param("slit", "X stands ", PLAY, marks=pytest.mark.thorough),
        pytest.param("SCARA", "The model does not hold", TURNED, marks=pytest.mark.thorough),
        pytest.param("arm", "The model does not hold", TURNED, marks=pytest.mark.thorough),
    ],
)
@pytest.mark.thorough
def test_the_loop(browser: Browser, tmp_path: Path, name: str, title: str, cause: str) -> None:
    model, fitted, held = write_machine(name, tmp_path)
    with opened(model, fitted, "--holdout", held, "--versions", tmp_path / "v") as bench:
        seen = visit(browser, bench, reduced_motion="reduce")
        page = seen.page
        page.wait_for_selector("h1.bad")
        expect(page.locator("h1")).to_contain_text(title)
        looked_at(page)
        page.click("#tab-learn")
        page.wait_for_selector("#what-if[data-ready]")
        expect(page.locator("#task")).to_be_hidden()
        first = page.locator(".cause").first
        expect(first.locator("h2")).to_contain_text(cause)
        looked_at(page)
        # tried by hand, the residuals answer
        panel = page.locator("#what-if")
        best = panel.get_attribute("data-rms") or ""
        panel.locator("input[type=range]").first.fill("0")
        expect(panel).not_to_have_attribute("data-rms", best)
        assert float(panel.get_attribute("data-rms") or "nan") > float(best)
        # added, the error falls, also on the day that was never fitted, from the first version on
        first.locator("button.add").click()
        page.wait_for_selector("tr.current")
        expect(page.locator("#task")).to_be_hidden()
        expect(page.locator("h1")).to_contain_text("The held-out error fell from ")
        assert page.locator("h1").inner_text().count("not by the last step") == 0
        looked_at(page)
        page.locator("button.back").first.click()
        expect(page.locator("#version")).to_have_text(model.name)
        expect(page.locator("#task")).to_be_hidden()
        with page.expect_popup() as found:
            page.click("#report")
        found.value.wait_for_selector("#paper[data-ready]")
        assert f"{name}-7" in found.value.locator("#paper").inner_text()
        assert_quiet(seen, bench)


@pytest.mark.thorough
def test_live_with_one_line_and_a_table(browser: Browser, tmp_path: Path) -> None:
    """What is corrected is named, its error is drawn along the one line, no other ± is shown."""
    with table_and_slide(tmp_path) as config, opened(config) as bench:
        seen = visit(browser, bench, until="#view[data-tab=live]", reduced_motion="reduce")
        page = seen.page
        with live_run(config) as run:
            run.until(compensating)
            expect(page.locator("#state")).to_have_text("X: corrected in full")
            expect(page.locator("[data-axis=C] .guard")).to_have_text("not corrected")
            page.wait_for_selector("#volume .plot .scatterlayer path")
            expect(page.locator("#volume h2")).to_contain_text("errs by up to 14.0 µm")
            page.wait_for_selector("#history[data-ready]")
            looked_at(page)
        # before there was a run
        seen.errors[:] = [e for e in seen.errors if "409" not in e]
        assert_quiet(seen, bench)


def test_one_row_is_no_verdict(browser: Browser, tmp_path: Path) -> None:
    """Why is said in the person's language, and what to do: another campaign, or more of it."""
    model, fitted, _ = write_machine("lathe", tmp_path)
    lines = fitted.read_text("utf-8").splitlines()
    head = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    fitted.write_text("\n".join(lines[: head + 2]) + "\n", encoding="utf-8")
    with opened(model, fitted) as bench:
        seen = visit(browser, bench, until="#trouble:visible", locale="de-DE")
        page = seen.page
        expect(page.locator("#trouble")).to_contain_text("nimmt alles Gemessene auf (1 Zeile)")
        expect(page.locator("h1")).to_have_text("Dazu lässt sich noch nichts sagen")
        expect(page.locator("#campaigns select")).to_have_count(2)
        looked_at(page)
        assert_quiet(seen, bench)
