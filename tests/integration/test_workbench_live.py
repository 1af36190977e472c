"""The live view in Debian's Chromium: a run seen, lost, seen again; its past, its volume."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.support.daemon.browser import (
    INK,
    PATIENCE_MS,
    WIDTHS,
    Watched,
    assert_quiet,
    chromium,
    visit,
)
from tests.support.daemon.live_run import PATIENCE, compensating, live_run, machine, set_fault
from tests.support.daemon.paper import assert_on_paper
from tests.support.daemon.workbench import OpenedWorkbench, opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

SEEN = ".live[data-seen=run]"
HIDE = """(hidden) => {
  Object.defineProperty(document, "hidden", {value: hidden, configurable: true});
  document.dispatchEvent(new Event("visibilitychange"));
}"""
"""What a browser does with a window that another one covers; this one shows all of them."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


def look(browser: Browser, bench: OpenedWorkbench, width: int = 1280) -> Watched:
    seen = visit(browser, bench, width, until="#view[data-tab=live]")
    seen.page.wait_for_selector(SEEN)
    return seen


def status(config: Path) -> dict[str, object]:
    command = [sys.executable, "-m", "abbe.daemon", "status", str(config), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=True)
    found: dict[str, object] = json.loads(done.stdout)
    return found


def number(page: Page, axis: str) -> float:
    text = page.locator(f"[data-axis={axis}] .large").inner_text()
    return float(text.removesuffix(" mm").replace("−", "-"))


def test_a_run_is_seen_lost_and_seen_again(browser: Browser, tmp_path: Path) -> None:
    with machine(tmp_path) as (simulator, config):
        config.write_text(config.read_text() + "\n[records]\nevery = 0.1\n\n[http]\n")
        with opened(config) as bench:
            # nothing runs yet: that is said, and asked again
            seen = visit(browser, bench, until="#view[data-tab=live]")
            page = seen.page
            expect(page.locator("#lost")).to_contain_text("no correction runs with")
            with live_run(config) as run:
                page.wait_for_selector(SEEN)
                run.until(compensating)
                expect(page.locator("#state")).to_have_text("corrected in full")
                expect(page.locator("#lost")).to_be_hidden()
                # ten times a second, by the service's stream
                page.wait_for_selector(".live[data-cycle]")
                before = run.cycles[-1]["cycle"]
                page.wait_for_function(
                    "n => Number(document.querySelector('.live').dataset.cycle) > n", arg=before
                )
                # a window that nobody sees keeps no connection from those that are seen
                page.evaluate(HIDE, True)
                stood = page.locator(".live").get_attribute("data-cycle")
                run.until(lambda c: c["cycle"] > int(stood or 0) + 30)
                expect(page.locator(".live")).to_have_attribute("data-cycle", stood or "")
                page.evaluate(HIDE, False)
                page.wait_for_function(
                    "n => Number(document.querySelector('.live').dataset.cycle) > n + 30",
                    arg=int(stood or 0),
                )
                # what is shown is what was written, at some moment around it
                shown = number(page, "X")
                now = len(run.cycles)
                run.until(lambda c: c["cycle"] > run.cycles[now - 1]["cycle"] + 5)
                near = [c["corrected"]["X"] for c in run.cycles[-400:]]
                assert min(abs(shown - x) for x in near) < 5e-3
                for axis in "XYZ":
                    expect(page.locator(f"[data-axis={axis}] .guard")).to_have_text("in full")
                expect(page.locator("main")).to_contain_text("X scale, low end")
                expect(page.locator(".links")).to_contain_text("link cmm (modbus) up")

                # a sensor fails: what `abbe status` says of it stands here
                set_fault(simulator.port, "thermistors_open", 0b1)
                expect(page.locator("tr.stale")).to_contain_text("T_x1")
                expect(page.locator("#state")).not_to_have_text("corrected in full")
                said = status(config)
                assert isinstance(said["faults"], dict)
                for what, why in said["faults"].items():
                    expect(page.locator("#warnings")).to_contain_text(f"{what}: {why}"[:30])
                set_fault(simulator.port, "thermistors_open", 0)
                expect(page.locator("#state")).to_have_text("corrected in full")
                assert run.end(signal.SIGTERM) == 0
            expect(page.locator("#lost")).to_contain_text("not seen since")
            expect(page.locator("#age")).to_contain_text("says nothing of the present")
            # what stood there last is neither what it is now, nor in its colour
            expect(page.locator("#state")).to_contain_text("Not seen any more; last: ")
            expect(page.locator("#state")).to_have_class("bad")
            with live_run(config) as run:
                page.wait_for_selector(SEEN)
                run.until(compensating)
                expect(page.locator("#state")).to_have_text("corrected in full")
                expect(page.locator("#lost")).to_be_hidden()
            # the workbench itself goes: the page says since when
            bench.process.kill()
            expect(page.locator("#lost")).to_contain_text("The server is lost since 20")
    elsewhere = [u for u in seen.requests if not u.startswith((bench.origin, "data:", "blob:"))]
    assert elsewhere == []


@pytest.mark.thorough
def test_volume_and_history(browser: Browser, tmp_path: Path) -> None:
    with machine(tmp_path) as (_, config):
        config.write_text(config.read_text() + "\n[records]\nevery = 0.1\n\n[http]\n")
        with live_run(config) as run, opened(config) as bench:
            run.until(compensating)
            seen = look(browser, bench)
            page = seen.page
            # the volume: one sentence, arrows and a warped box, turned by hand and by keys
            expect(page.locator("#volume h2")).to_have_text(
                re.compile(r"Without correction the machine errs by up to \d+\.\d µm")
            )
            canvas = page.locator("#volume canvas")
            assert canvas.evaluate(INK) > 1000
            before = canvas.evaluate("c => c.toDataURL()")
            canvas.focus()
            page.keyboard.press("ArrowLeft")
            turned = canvas.evaluate("c => c.toDataURL()")
            assert turned != before
            box = canvas.bounding_box()
            assert box is not None
            page.mouse.move(box["x"] + 100, box["y"] + 100)
            page.mouse.down()
            page.mouse.move(box["x"] + 200, box["y"] + 120, steps=3)
            page.mouse.up()
            assert canvas.evaluate("c => c.toDataURL()") != turned

            # the past: never too many points, zoom asks again
            page.wait_for_selector("#history[data-ready]")
            pictures = page.locator(".past[data-points]")
            expect(page.locator(".past").first).to_contain_text("Corrections, µm")
            assert pictures.count() >= 3
            for picture in pictures.all():
                assert 0 < int(picture.get_attribute("data-points") or 0) <= 2000
            chart = page.locator(".past .u-over").first
            chart.evaluate("drawn => drawn.scrollIntoView({block: 'center'})")
            area = chart.bounding_box()
            assert area is not None
            page.mouse.move(area["x"] + 0.7 * area["width"], area["y"] + 40)
            page.mouse.down()
            page.mouse.move(area["x"] + 0.95 * area["width"], area["y"] + 50, steps=4)
            page.mouse.up()
            expect(page.locator("#history button", has_text="Back")).to_be_enabled()
            span = """() => {
              const {first, last} = document.querySelector("#history").dataset;
              return last - first;
            }"""
            page.wait_for_function(f"() => ({span})() < 60")
            closer = page.evaluate(span)
            asked = [u for u in seen.requests if "/api/live/picture" in u]
            part = dict(parse_qsl(urlsplit(asked[-1]).query))
            assert float(part["last"]) - float(part["first"]) == pytest.approx(closer, abs=0.01)
            for words in ("Wider", "Earlier", "Later", "Closer", "Back", "Last day", "Last month"):
                page.locator("#history button", has_text=words).first.click()
            expect(page.locator("[data-span=Month]")).to_have_attribute("aria-pressed", "true")

            # on paper: the volume and every picture of the past
            page.locator("[data-span=Hour]").click()
            expect(page.locator("[data-span=Hour]")).to_have_attribute("aria-pressed", "true")
            page.wait_for_function(
                "() => { const {first, last} = document.querySelector('#history').dataset;"
                " return last - first < 7200; }"
            )
            assert_on_paper(page, tmp_path, 1 + pictures.count(), [config])

            # room at every width, and no more text than the window is wide
            page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
            for width in WIDTHS:
                page.set_viewport_size({"width": width, "height": 900})
                page.wait_for_function(
                    "width => document.documentElement.scrollWidth <= width", arg=width
                )
            assert_quiet(seen, bench)


@pytest.mark.thorough
def test_a_run_without_stream_or_records_is_seen_all_the_same(
    browser: Browser, tmp_path: Path
) -> None:
    with machine(tmp_path) as (_, config), live_run(config) as run, opened(config) as bench:
        run.until(compensating)
        seen = look(browser, bench)
        page = seen.page
        expect(page.locator("#state")).to_have_text("corrected in full")
        first = number(page, "Y")
        page.wait_for_function(
            "text => document.querySelector('[data-axis=Y] .large').textContent !== text",
            arg=page.locator("[data-axis=Y] .large").inner_text(),
            timeout=PATIENCE_MS,
        )
        assert isinstance(first, float)
        expect(page.locator("#history")).to_contain_text("no records are kept of this run")
        # 409 is what the server says of records; nothing else is complained of
        assert [e for e in seen.errors if "409" not in e] == []
