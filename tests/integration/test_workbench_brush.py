"""More rows than are drawn one by one, in a browser: counted places, and selections of all rows."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.support.daemon.browser import INK, assert_for_everybody, assert_quiet, chromium, visit
from tests.support.daemon.workbench import opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

BRIDGE = Path(__file__).parents[1] / "data" / "p03-bridge"
TIMES = 4


def repeated(campaign: Path, out: Path) -> Path:
    """A campaign in which each row stands several times."""
    lines = campaign.read_text(encoding="utf-8").splitlines()
    head = next(i for i, text in enumerate(lines) if not text.startswith("#"))
    rows = [row for row in lines[head + 1 :] for _ in range(TIMES)]
    out.write_text("\n".join([*lines[: head + 1], *rows]) + "\n", encoding="utf-8")
    return out


@pytest.mark.thorough
def test_a_selection_counts_rows_that_are_not_drawn(tmp_path: Path) -> None:
    files = (BRIDGE / "model.toml", repeated(BRIDGE / "fit.csv", tmp_path / "many.csv"))
    with chromium() as browser, opened(*files) as bench:
        seen = visit(browser, bench)
        page = seen.page
        first = page.locator(".scatter").first
        canvas = first.locator("canvas")
        page.wait_for_selector(".volume canvas")
        assert canvas.evaluate(INK) > 300
        everything = canvas.evaluate("drawn => drawn.toDataURL()")
        canvas.evaluate("drawn => drawn.scrollIntoView({block: 'center'})")
        box = canvas.bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 50, box["y"] + 10)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.9 * box["width"], box["y"] + 82, steps=3)
        page.mouse.up()
        bar = page.locator("#selection")
        expect(bar).to_be_visible()
        count = int(bar.get_attribute("data-count") or 0)
        # each row stands several times, and all of them are chosen
        assert count % TIMES == 0
        assert count > 40
        assert f"{count} rows" in bar.inner_text()
        for panel in ("0 along Z, measured in Z", "0 by set-up", "0 over time"):
            place = page.locator(f'[data-panel="{panel}"]')
            assert place.get_attribute("data-selected") == str(count)
        other = page.locator('[data-panel="0 along Y, measured in Y"]')
        assert other.get_attribute("data-selected") == "0"
        assert canvas.evaluate("drawn => drawn.toDataURL()") != everything
        # what is unfolded later shows the same selection
        page.locator("summary", has_text=re.compile("more along the axes")).first.click()
        page.wait_for_function(
            "() => [...document.querySelectorAll('.scatter')].every((s) => s.dataset.selected)"
        )
        bar.locator("button").click()
        expect(bar).to_be_hidden()
        assert canvas.evaluate("drawn => drawn.toDataURL()") == everything

        # a row of a table
        table = page.locator("details[open] .wide", has_text="mean, µm").first
        table.locator("button.small").first.click()
        expect(bar).to_be_visible()
        said = table.locator("tbody tr").first.locator("td").nth(1).inner_text()
        assert bar.get_attribute("data-count") == said
        bar.locator("button").click()

        # a box over the volume
        volume = page.locator(".volume").first
        volume.locator("button").click()
        drawn = volume.locator("canvas")
        drawn.evaluate("drawn => drawn.scrollIntoView({block: 'center'})")
        box = drawn.bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 2, box["y"] + 2)
        page.mouse.down()
        page.mouse.move(box["x"] + box["width"] - 2, box["y"] + box["height"] - 2, steps=3)
        page.mouse.up()
        lengths = sum("rotation" not in row for row in files[1].read_text("utf-8").splitlines()[1:])
        expect(bar).to_be_visible()
        chosen = int(bar.get_attribute("data-count") or 0)
        assert chosen % TIMES == 0
        assert 0.9 * lengths < chosen + 200
        assert_quiet(seen, bench)
        assert_for_everybody(page)
