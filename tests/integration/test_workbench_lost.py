"""The workbench is killed, started anew at the same port, or its session is over: nothing is lost.

In Debian's Chromium: what was typed stays, what has happened is said, and nothing is done twice.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.daemon.config.tokens import add_token
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.browser import Watched, chromium, visit
from tests.support.daemon.live_run import MODEL, compensating, live_run, machine
from tests.support.daemon.measuring import SPEED, configuration, driven, line_plan, write_plan
from tests.support.daemon.some_setups import some_setups
from tests.support.daemon.upload_cases import Place, patient_place, sums
from tests.support.daemon.workbench import OpenedWorkbench, opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(900)]

BRIDGE = Path(__file__).parents[1] / "data" / "p03-bridge"
AWAY = "The workbench does not answer"
OUTSIDE = "This window is not let in any more"
ANEW = "The workbench was started anew. What was typed here stays."


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


KNOWN = """async () => {
  const state = await (await fetch("/api/state")).json();
  return state.learned && state.task === null;
}"""
"""The causes are known, and nothing is under way."""


class Reopened:
    """A workbench that is killed and started anew with the same words, at the same port."""

    def __init__(self, stack: ExitStack, *words: str | Path) -> None:
        self._stack, self._words = stack, words
        self.bench = stack.enter_context(opened(*words))
        self._port = self.bench.port

    def kill(self, page: Page) -> None:
        """It is gone, and the page says so, and how it goes on."""
        self.bench.process.kill()
        self.bench.process.wait()
        expect(page.locator("#trouble")).to_contain_text(AWAY)
        expect(page.locator("#trouble")).to_contain_text(f"--port {self._port}")

    def start(self, page: Page) -> None:
        """It is there again, and lets the browser in by a tab of its own."""
        self.bench = self._stack.enter_context(opened(*self._words, "--port", str(self._port)))
        expect(page.locator("#trouble")).to_contain_text(OUTSIDE)
        enter(page, self.bench)
        expect(page.locator("#trouble")).to_contain_text(ANEW)
        expect(page.locator("#view.lost")).to_have_count(0)


def enter(page: Page, bench: OpenedWorkbench) -> None:
    """The address that was printed, in another tab of the same browser."""
    tab = page.context.new_page()
    tab.goto(bench.address)
    tab.wait_for_selector("#view[data-tab]")
    tab.close()


def further(bench: OpenedWorkbench) -> None:
    """The address for another browser."""
    assert bench.process.stdout is not None
    for line in bench.process.stdout:
        if line.startswith("for another browser"):
            bench.address = line.split()[-1]
            return


def unexpected(seen: Watched) -> list[str]:
    """What the browser complained of, apart from the server's being away."""
    away = re.compile(
        r"ERR_(CONNECTION|EMPTY_RESPONSE|INCOMPLETE|CONTENT_LENGTH|SOCKET)|Failed to fetch|40[39]"
    )
    return [e for e in seen.errors if not away.search(e)]


@pytest.mark.thorough
def test_compare_what_if_and_add_go_on_where_they_were(browser: Browser, tmp_path: Path) -> None:
    campaign = some_setups(BRIDGE / "fit.csv", tmp_path / "some.csv", every=6)
    versions = tmp_path / "versions"
    with ExitStack() as stack:
        again = Reopened(stack, BRIDGE / "model.toml", campaign, "--versions", versions)
        seen = visit(browser, again.bench)
        page = seen.page
        # compare: what was selected and opened is there afterwards
        page.locator("details[open] button.small", has_text="Show").first.click()
        chosen = page.locator("#selection").get_attribute("data-count")
        page.locator("summary", has_text="Against signals").first.click()
        title = page.locator("h1").inner_text()
        again.kill(page)
        expect(page.locator("#view.lost h1")).to_have_text(title)
        again.start(page)
        expect(page.locator("#task")).to_be_hidden()
        expect(page.locator("h1")).to_have_text(title)
        expect(page.locator("#selection")).to_have_attribute("data-count", str(chosen))
        assert page.locator("details[open] summary", has_text="Against signals").count() == 1

        # what if: what was typed and tried stays, and is answered when somebody answers again
        page.click("#tab-learn")
        panel = page.locator("#what-if")
        page.wait_for_selector("#what-if[data-ready]")
        page.wait_for_selector("#advice li")
        slider = panel.locator("input[data-name='amount of it']")
        best = panel.get_attribute("data-rms") or ""
        slider.fill("0")
        expect(panel).not_to_have_attribute("data-rms", best)
        nothing = panel.get_attribute("data-rms") or ""
        slider.fill("200")  # of 400 steps: all of it
        expect(panel).to_have_attribute("data-rms", best)
        page.fill("#any-cause", "backlash axis=X")
        again.kill(page)
        slider.fill("0")
        again.start(page)
        expect(panel).to_have_attribute("data-rms", nothing)
        assert slider.input_value() == "0"
        assert page.input_value("#any-cause") == "backlash axis=X"

        # add: clicked while nobody answers, it is not done, and not by itself later
        add = page.locator("#what-if .add")
        spec = add.get_attribute("data-spec")
        again.bench.process.kill()
        again.bench.process.wait()
        add.click()
        expect(page.locator("#trouble")).to_contain_text("was not answered")
        again.start(page)
        expect(page.locator("#trouble")).to_contain_text("nothing is done twice")
        while not page.evaluate(KNOWN):
            page.wait_for_timeout(100)
        assert list(versions.iterdir()) == []
        # clicked again it is done once
        add.click()
        expect(page.locator("#trouble")).to_be_hidden()
        page.locator("tr.current", has_text=spec).wait_for()
        expect(page.locator("#task")).to_be_hidden()
        assert [p.name for p in versions.glob("*.toml")] == ["model-2.toml"]
        assert (versions / "workbench.jsonl").read_text("utf-8").count('"made"') == 1
        # in the middle of a refit: that is said; the version before is there
        page.click("#tab-watch")
        page.locator("#fit").click()
        expect(page.locator("#task")).to_be_visible()
        again.kill(page)
        again.start(page)
        expect(page.locator("#trouble")).to_contain_text("It shows model.toml at first")
        known = page.locator("main tr.current, main tr:has(button.back)")
        whole = [p for p in versions.iterdir() if p.suffix == ".toml" and p.stat().st_size]
        expect(known).to_have_count(1 + len(whole))
        page.locator("button.back").first.click()
        expect(page.locator("#version")).to_have_text("model-2.toml")
        assert unexpected(seen) == []


@pytest.mark.thorough
def test_live_goes_on_with_the_part_of_the_past_that_was_looked_at(
    browser: Browser, tmp_path: Path
) -> None:
    with ExitStack() as stack:
        _, config = stack.enter_context(machine(tmp_path))
        config.write_text(config.read_text() + "\n[records]\nevery = 0.1\n\n[http]\n")
        run = stack.enter_context(live_run(config))
        run.until(compensating)
        again = Reopened(stack, config)
        seen = visit(browser, again.bench, until="#view[data-tab=live]")
        page = seen.page
        page.wait_for_selector("#history[data-ready]")
        page.locator("#history button", has_text="Closer").click()
        expect(page.locator("#history button", has_text="Back")).to_be_enabled()
        page.wait_for_selector(".live[data-cycle]")
        for _ in range(2):
            again.kill(page)
            expect(page.locator("#lost")).to_be_visible()
            expect(page.locator("#age")).to_contain_text("says nothing of the present")
            again.start(page)
            expect(page.locator("#lost")).to_be_hidden()
            expect(page.locator("#state")).to_have_text("corrected in full")
            page.wait_for_function(
                "n => Number(document.querySelector('.live').dataset.cycle) > n",
                arg=run.cycles[-1]["cycle"],
            )
            expect(page.locator("#history button", has_text="Back")).to_be_enabled()
        assert unexpected(seen) == []


@pytest.mark.thorough
def test_a_session_that_is_over_goes_on_where_it_was(browser: Browser, tmp_path: Path) -> None:
    campaign = some_setups(BRIDGE / "fit.csv", tmp_path / "some.csv", every=6)
    with opened(BRIDGE / "model.toml", campaign, "--session", "0.004") as bench:
        seen = visit(browser, bench)
        page = seen.page
        page.locator("details[open] button.small", has_text="Show").first.click()
        chosen = page.locator("#selection").get_attribute("data-count")
        expect(page.locator("#trouble")).to_contain_text(OUTSIDE)
        further(bench)
        enter(page, bench)
        expect(page.locator("#trouble")).to_be_hidden()
        # the same server: nothing was computed anew, nothing lost
        expect(page.locator("#selection")).to_have_attribute("data-count", str(chosen))
        assert unexpected(seen) == []


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    """A mill, its tables ``old`` (active) and ``new``, and a control."""
    with patient_place(tmp_path) as here:
        yield here


def looked_at(page: Page) -> None:
    page.locator("#controller button").first.click()
    page.wait_for_selector("#write")


@pytest.mark.thorough
def test_an_upload_that_was_cut_off_is_said_and_done_once(browser: Browser, place: Place) -> None:
    secret = add_token(place.folder / "http-tokens.toml", "cell-3", "operate")
    with ExitStack() as stack:
        again = Reopened(stack, place.config, "--tables", place.folder / "new")
        seen = visit(browser, again.bench, until=".tables[data-ready]")
        page = seen.page
        looked_at(page)
        page.fill("#write-machine", "mill")
        page.fill("#write-by", "A. Vogel")
        page.fill("#write-note", "new scale")
        again.kill(page)
        again.start(page)
        # what was looked at by another workbench does not count; what was typed does
        expect(page.locator("#write")).to_have_count(0)
        looked_at(page)
        for name, typed in {"machine": "mill", "by": "A. Vogel", "note": "new scale"}.items():
            assert page.input_value(f"#write-{name}") == typed
        # the control hangs where the new tables are to be made active, and the workbench is killed
        place.control.order("fault", kind="hang", at="commit")
        page.fill("#write-token", secret)
        page.click("#write")
        expect(page.locator("#said")).to_contain_text("Under way")
        while not place.truth()["happened"]:
            page.wait_for_timeout(50)
        again.kill(page)
        place.control.order("clear")
        place.control.order("wake")
        again.start(page)
        expect(page.locator("#said")).to_contain_text("ended while something was under way")
        page.locator("#controller button").first.click()
        expect(page.locator("#said")).to_contain_text("was not finished")
        page.wait_for_selector("#write")
        page.fill("#write-machine", "mill")
        page.fill("#write-token", secret)
        page.click("#write")
        # that one is brought to its end first, then the tables are written once
        page.wait_for_selector("#said[data-kind=write][data-ended=good]")
        assert place.truth()["active"] == sums(place.folder / "new")
        assert place.entries()[-1]["active"] == "new"
        assert len({e["upload"] for e in place.entries()}) == 2
        assert unexpected(seen) == []


@pytest.mark.thorough
def test_two_people_at_one_controller(browser: Browser, place: Place) -> None:
    secret = add_token(place.folder / "http-tokens.toml", "cell-3", "operate")
    with opened(place.config, "--tables", place.folder / "new") as bench:
        one = visit(browser, bench, until=".tables[data-ready]").page
        looked_at(one)
        one.fill("#write-machine", "mill")
        one.fill("#write-by", "A. Vogel")
        further(bench)
        two = visit(browser, bench, until=".tables[data-ready]").page
        two.wait_for_selector("#write")
        # the other looks, for so long that it is mostly seen under way; what was typed stays
        place.control.order("fault", kind="late_answer", at="identity", seconds=6.0)
        two.locator("#controller button").first.click()
        expect(one.locator("#said")).to_contain_text("looked at in another window")
        assert one.input_value("#write-machine") == "mill"
        assert one.input_value("#write-by") == "A. Vogel"
        # a roll-back is looked at: a name that was typed for an upload does not count for it
        expect(two.locator("#write")).to_be_visible()
        two.locator("#controller button", has_text="Roll back").click()
        two.wait_for_selector('#said[data-kind=preflight][data-ended="bad"]')
        looked_at(one)
        one.fill("#write-machine", "mill")
        one.fill("#write-token", secret)
        one.click("#write")
        one.wait_for_selector("#said[data-kind=write][data-ended=good]")
        expect(two.locator("#said[data-kind=write][data-ended=good]")).to_contain_text("is active")
        expect(two.locator("#journal tbody tr")).to_have_count(1)
        assert len({e["upload"] for e in place.entries()}) == 1


@pytest.mark.thorough
def test_a_measurement_that_was_cut_off_goes_on(browser: Browser, tmp_path: Path) -> None:
    shutil.copy(MODEL, tmp_path / "model.toml")
    secret = add_token(tmp_path / "http-tokens.toml", "cell-3", "operate")
    folder = tmp_path / "c"
    with ExitStack() as stack:
        bench = stack.enter_context(SimulatedProcess("bench", "--seed", "1"))
        config = configuration(bench.ready, tmp_path)
        config.write_text(config.read_text() + "\n[http]\n")
        again = Reopened(stack, config, "--calibration", folder)
        seen = visit(browser, again.bench, until=".calibration[data-ready]")
        page = seen.page
        page.locator("summary", has_text="What is asked for").click()
        page.fill("#ask-time", "30min")
        page.fill("#ask-tools", "P=0,0,-150")
        page.click("#ask")
        page.fill("#start-by", "A. Vogel")
        page.click("#go")
        page.wait_for_selector('li[data-step="start"][data-state=done]')
        page.wait_for_selector('div[data-step="plan"] #go')
        # what is asked for, what is typed and not yet asked for, who does it
        page.fill("#ask-check_time", "20min")
        page.fill("#start-by", "B. Ohm")
        again.kill(page)
        again.start(page)
        for name, typed in {"ask-time": "30min", "ask-tools": "P=0,0,-150",
                            "ask-check_time": "20min", "start-by": "B. Ohm"}.items():  # fmt: skip
            assert page.input_value(f"#{name}") == typed
        page.click("#go")
        page.wait_for_selector('li[data-step="plan"][data-state=done]')
        write_plan(folder / "plan.toml", line_plan("one", "X", (100.0, 200.0)))
        page.wait_for_selector('div[data-step="measure"] #go')
        moves = driven(folder / "plan.toml", tmp_path / "model.toml")
        targets = [k for k, move in enumerate(moves) if move.get("stands")]

        def begin() -> None:
            page.fill("#start-token", secret)
            page.click("#go")
            expect(page.locator(".question")).to_contain_text(re.compile("set up (again )?one"))
            page.click("[data-choice=stands]")

        def drive(first: int, last: int) -> None:
            way = [{k: v for k, v in m.items() if k != "stands"} for m in moves[first : last + 1]]
            bench.order("drive", moves=way, speed=SPEED)

        begin()
        drive(0, targets[0])
        page.wait_for_selector('#step[data-done="1"]')
        # a second window sees it, and cannot do it a second time
        further(again.bench)
        other = visit(browser, again.bench, until=".calibration[data-ready]").page
        expect(other.locator("h1")).to_contain_text("Under way")
        assert other.locator("#go").count() == 0
        other.context.close()
        again.kill(page)
        again.start(page)
        expect(page.locator("#doing [role=alert]")).to_contain_text("What it has written is kept")
        # the step of the workbench that is gone has ended, too: the machine is free
        begin()
        for first, last in zip([targets[0] + 1, *[k + 1 for k in targets[1:]]], targets[1:],
                               strict=False):  # fmt: skip
            drive(first, last)
            page.wait_for_selector(f'#step[data-done="{targets.index(last) + 1}"]')
        page.wait_for_selector('li[data-step="measure"][data-state=done]')
        kept = read_campaign(folder / "campaign.csv", load_model(tmp_path / "model.toml").machine)
        assert kept.n == len(targets)
        state = json.loads((folder / "calibration.json").read_text())
        assert state["asked"]["time"] == "30min"
        assert state["steps"]["plan"]["note"] == "B. Ohm"
        assert unexpected(seen) == []
