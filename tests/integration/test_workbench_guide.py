"""The guide in the workbench from its first step to the certificate by clicking; its upload."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from abbe.daemon.calibration.request import CalibrationRequest
from abbe.daemon.calibration.state import CalibrationState
from abbe.daemon.commands.calibration.guide import steps_now
from abbe.daemon.config import load_config
from abbe.daemon.config.tokens import add_token
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.browser import assert_for_everybody, chromium, visit
from tests.support.daemon.german import english_of
from tests.support.daemon.measuring import (
    SPEED,
    bent_scales,
    configuration,
    driven,
    line_plan,
    write_plan,
)
from tests.support.daemon.upload_cases import SLOW, Place, fill, sums, texts
from tests.support.daemon.workbench import opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(900)]

INSTRUMENT = """
[links.cnc.channels.laser]
table = "input"
address = 6
type = "int32"
unit = "mm"

[instrument.laser]
source = "cnc.laser"
reads = "length"
"""


def do(page: Page, step: str, *, secret: str = "") -> None:
    """Click the step that comes next."""
    page.wait_for_selector(f'div[data-step="{step}"] #go')
    page.fill("#start-by", "A. Vogel")
    if secret:
        page.fill("#start-token", secret)
    page.click("#go")


def done(page: Page, step: str) -> None:
    page.wait_for_selector(f'li[data-step="{step}"][data-state=done], #step[data-ended=bad]')
    failed = page.locator("#step[data-ended=bad]")
    assert failed.count() == 0, failed.inner_text()


def measure(page: Page, machine: SimulatedProcess, plan: Path, model: Path) -> None:
    """Stand the instrument up wherever that is asked for, and drive to every target."""
    moves = driven(plan, model)
    begun, count = 0, 0
    for at in [k for k, move in enumerate(moves) if move.get("stands")]:
        way = [{k: v for k, v in m.items() if k != "stands"} for m in moves[begun : at + 1]]
        if any("place" in move for move in way):
            page.click("[data-choice=stands]")
            expect(page.locator(".question")).to_have_count(0)
        machine.order("drive", moves=way, speed=SPEED)
        begun, count = at + 1, count + 1
        page.wait_for_selector(f'#step[data-done="{count}"]')


def assert_said_in_german(page: Page) -> None:
    """What the step has said has no English in it, but for how set-ups are placed."""
    page.select_option("#language", "de")
    page.wait_for_selector("#step[data-ended] .lines", state="attached")
    expect(page.locator("#step .lines")).to_contain_text("Zielposition", use_inner_text=False)
    said = (page.locator("#step .lines").text_content() or "").splitlines()
    # steps' names are typed as they stand
    lines = [re.sub(r"^\d+/\d+ [\w-]+: ", "", line) for line in said]
    assert len(lines) > 15
    placed = [line for line in lines if line.startswith("aufbauen: ")]
    assert len(placed) == 3
    assert [line for line in lines if line not in placed and english_of(line)] == []
    page.select_option("#language", "en")
    page.wait_for_selector("#step[data-ended] .lines", state="attached")
    said = (page.locator("#step .lines").text_content() or "").splitlines()
    assert len([line for line in said if english_of(line)]) > 3


@pytest.mark.thorough
def test_from_the_first_step_to_the_certificate(tmp_path: Path) -> None:
    model = bent_scales(tmp_path / "model.toml")
    secret = add_token(tmp_path / "http-tokens.toml", "cell-3", "operate")
    folder = tmp_path / "c"
    with SimulatedProcess("bench", "--seed", "1") as machine:
        config = configuration(machine.ready, tmp_path)
        config.write_text(config.read_text() + "\n[http]\n")
        with chromium() as browser, opened(config, "--calibration", folder) as bench:
            seen = visit(browser, bench, until=".calibration[data-ready]")
            page = seen.page
            page.locator("summary", has_text="What is asked for").click()
            for name, text in {"time": "30min", "check_time": "60min", "tools": "P=0,0,-150",
                               "controller": "linuxcnc"}.items():  # fmt: skip
                page.fill(f"#ask-{name}", text)
            page.click("#ask")
            page.wait_for_selector('li[data-step="program"]')
            for step in ("start", "plan"):
                do(page, step)
                done(page, step)
            # three short lines in place of what takes twenty minutes
            write_plan(folder / "plan.toml", *(
                line_plan(f"along_{axis}", axis, places, both_ways=False)
                for axis, places in {"X": (100.0, 300.0, 500.0), "Y": (100.0, 400.0, 700.0),
                                     "Z": (-250.0, -145.0, -40.0)}.items()
            ))  # fmt: skip
            expect(page.locator("section[data-plan=plan] img")).to_have_count(3)
            do(page, "program")
            done(page, "program")
            do(page, "measure", secret=secret)
            measure(page, machine, folder / "plan.toml", model)
            done(page, "measure")
            assert_said_in_german(page)
            do(page, "fit")
            done(page, "fit")
            # whatever it finds is agreed to or not, one after the other; this person wants none
            do(page, "diagnose")
            either = page.locator("[data-choice=no], li[data-step=diagnose][data-state=done]")
            either.first.wait_for()
            while page.locator('li[data-step="diagnose"][data-state=done]').count() == 0:
                page.locator("[data-choice=no]").click()
                expect(page.locator("[data-choice=no]")).to_have_count(0)
                either.first.wait_for()
            do(page, "check-plan")
            done(page, "check-plan")
            plan = folder / "check.toml"
            # Z's scale, 5 µm there, is what three places get hold of: it is surely better
            checked = line_plan("check", "Z", (-235.0, -55.0), at=(200.0, 600.0, 0.0))
            write_plan(plan, checked)
            expect(page.locator("section[data-plan=check] img")).to_have_count(1)
            do(page, "check-program")
            done(page, "check-program")
            do(page, "check", secret=secret)
            measure(page, machine, plan, model)
            done(page, "check")
            for step in ("verify", "live"):
                do(page, step)
                done(page, step)
            expect(page.locator("h1")).to_have_text("Calibrated and verified")
            # everything is done, and nothing is offered any more
            assert page.locator("#go").count() == 0
            assert page.locator("li[data-state=done]").count() == page.locator(".guide li").count()
            assert_for_everybody(page)
            with page.expect_popup() as opened_page:
                page.click("a[href='/api/calibrate/certificate']")
            expect(opened_page.value.locator("h1").first).to_contain_text("Bridge CMM")
            state = json.loads((folder / "calibration.json").read_text())
            assert state["steps"]["check"]["note"] == "A. Vogel, token cell-3 at 127.0.0.1"
            assert state["steps"]["verify"]["outcome"].startswith("verified: Z check: E ")
            live = (folder / "live.toml").read_text("utf-8")
            assert live.startswith("# VERIFIED. Written by abbe calibrate, ")
            kept = load_config(folder / "live.toml").model_path
            assert kept.read_bytes() == (folder / "calibrated.toml").read_bytes()
            assert not (folder / "live-not-verified.toml").exists()
            assert seen.errors == []


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    """A mill whose calibration has come as far as its tables, and its control with older ones."""
    fill(tmp_path)
    with SimulatedProcess("controller", "modbus") as control:
        control.order("reset")
        control.order("load", files=texts(tmp_path / "old"))
        keys = {"driver": "modbus", "host": "127.0.0.1", "port": control.ready["port"]}
        here = Place(tmp_path, control, keys, SLOW)
        here.configure(**SLOW)
        text = here.config.read_text().replace("[upload]", f"{INSTRUMENT}\n[upload]", 1)
        here.config.write_text(text + "\n[http]\n")
        yield here


def come_to_the_upload(place: Place) -> Path:
    """Note every step before it as done, as the command would have."""
    folder = place.folder / "c"
    folder.mkdir()
    shutil.copytree(place.folder / "new", folder / "tables")
    request = CalibrationRequest(
        load_config(place.config), folder, "4h", "1h", ("P=0,0,0",), "", "csv", yes=False
    )
    state = CalibrationState.read(folder, place.config)
    for now in steps_now(request):
        if now.step.name == "upload":
            break
        for path in now.step.makes:
            if not path.exists():
                path.write_text(f"made by {now.step.name}\n")
        state.note(now.step.name, now.step.made_from, "", now.step.settings)
    return folder


@pytest.mark.thorough
def test_the_upload_is_a_step_of_the_guide(place: Place) -> None:
    folder = come_to_the_upload(place)
    operates = add_token(place.folder / "http-tokens.toml", "cell-3", "operate")
    looks = add_token(place.folder / "http-tokens.toml", "visitor", "view")
    with chromium() as browser, opened(place.config, "--calibration", folder) as bench:
        page = visit(browser, bench, until=".calibration[data-ready]").page
        page.locator("summary", has_text="What is asked for").click()
        page.fill("#ask-tables", "csv")
        page.fill("#ask-tools", "P=0,0,0")
        page.click("#ask")
        page.wait_for_selector('div[data-step="upload"] #controller')
        # not by the steps' own way: what is written is looked at first
        answered = bench_post(page, "/api/calibrate/start", {"step": "upload"})
        assert "looked at" in answered
        page.locator("#controller button").first.click()
        page.wait_for_selector("#said[data-kind=preflight][data-ended=good]")
        expect(page.locator("#said")).to_contain_text("the correction changes by at most")
        assert_for_everybody(page)
        for machine, secret, why in (
            ("mill", looks, "a token of the role operate"),
            ("lathe", operates, "another machine: nothing was written"),
        ):
            page.fill("#write-machine", machine)
            page.fill("#write-token", secret)
            page.click("#write")
            expect(page.locator("#said [role=alert]")).to_contain_text(why)
        assert place.truth()["active"] == sums(place.folder / "old")
        assert place.entries() == []
        page.fill("#write-machine", "mill")
        page.fill("#write-token", operates)
        page.fill("#write-by", "A. Vogel")
        page.click("#write")
        done(page, "upload")
        # what it did stands there, and in both journals; the lines to verify come next
        expect(page.locator("#step")).to_contain_text("verified by reading it back")
        assert place.truth()["active"] == sums(place.folder / "new")
        who = "A. Vogel, token cell-3 at 127.0.0.1"
        assert place.entries()[0]["who"] == who
        state = json.loads((folder / "calibration.json").read_text())
        assert state["steps"]["upload"]["note"] == who
        expect(page.locator("li[data-state=next]")).to_have_attribute("data-step", "check-plan")


def bench_post(page: Page, path: str, body: dict[str, str]) -> str:
    """What the server answers to a request of the page."""
    found = page.evaluate(
        """async ([path, body]) => (await fetch(path, {method: "POST",
        headers: {"content-type": "application/json"}, body: JSON.stringify(body)})).text()""",
        [path, body],
    )
    return str(found)


@pytest.mark.thorough
def test_an_upload_in_the_guide_that_fails_leaves_the_old_table_and_the_step_open(
    place: Place,
) -> None:
    folder = come_to_the_upload(place)
    operates = add_token(place.folder / "http-tokens.toml", "cell-3", "operate")
    place.control.order("fault", kind="lies", at="show", times=100)
    with opened(place.config, "--calibration", folder) as bench:
        bench.enter()
        asked = {"time": "4h", "check_time": "1h", "tools": "P=0,0,0", "tables": "csv"}
        bench.json("/api/calibrate/ask", asked)
        bench.json("/api/calibrate/upload/preflight", {"change": "upload"})

        def settled() -> dict[str, object]:
            while True:
                state = bench.json("/api/calibrate/upload/state")
                if state["work"]["ended"]:
                    return dict(state)

        body = json.dumps({"cleared": settled()["cleared"], "machine": "mill"}).encode()
        sent = bench.ask(
            "POST", "/api/calibrate/upload/write", body, authorization=f"Bearer {operates}"
        )
        assert sent.status == 200
        assert "bad" in str(settled()["work"])
        shown = bench.json("/api/calibrate")
        assert [s["name"] for s in shown["steps"] if s["state"] == "next"] == ["upload"]
    assert place.truth()["active"] == sums(place.folder / "old")
    assert "upload" not in json.loads((folder / "calibration.json").read_text())["steps"]
