"""Calibrating in the workbench, by clicking: planned, drawn, measured by whoever may."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import expect

from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.daemon.config.tokens import add_token
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.browser import WIDTHS, assert_for_everybody, chromium, visit
from tests.support.daemon.measuring import (
    SPEED,
    bent_scales,
    configuration,
    driven,
    line_plan,
    write_plan,
)
from tests.support.daemon.paper import assert_on_paper
from tests.support.daemon.workbench import OpenedWorkbench, opened

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[SimulatedProcess]:
    # what it errs by is nobody's question here, and is soon planned for
    bent_scales(tmp_path / "model.toml")
    with SimulatedProcess("bench", "--seed", "1") as process:
        configuration(process.ready, tmp_path)
        config = tmp_path / "config.toml"
        config.write_text(config.read_text() + "\n[http]\n")
        yield process


def test_step_by_step_by_clicking(machine: SimulatedProcess, tmp_path: Path) -> None:
    secret = add_token(tmp_path / "http-tokens.toml", "cell-3", "operate")
    folder = tmp_path / "c"
    with chromium() as browser, opened(tmp_path / "config.toml", "--calibration", folder) as bench:
        seen = visit(browser, bench, until=".calibration[data-ready]")
        page = seen.page
        (cookie,) = page.context.cookies()
        bench.cookie = f"{cookie['name']}={cookie['value']}"
        assert_only_the_next_step_and_what_is_asked(bench, folder)
        page.locator("summary", has_text="What is asked for").click()
        page.fill("#ask-time", "30min")
        page.fill("#ask-tools", "P=0,0,-150")
        page.fill("#ask-controller", "linuxcnc")
        page.click("#ask")
        expect(page.locator("li[data-state=next]")).to_have_attribute("data-step", "start")
        for name in ("start", "plan"):
            page.wait_for_selector(f'div[data-step="{name}"] #go')
            page.fill("#start-by", "A. Vogel")
            page.click("#go")
            page.wait_for_selector(f'li[data-step="{name}"][data-state=done]')
        # who and when stand in the state of `abbe calibrate`
        state = json.loads((folder / "calibration.json").read_text())
        assert {s["note"] for s in state["steps"].values()} == {"A. Vogel"}
        # each set-up of the plan is drawn
        pictures = page.locator("section[data-plan=plan] img")
        assert pictures.count() >= 1
        pictures.last.evaluate("image => image.decode()")
        assert pictures.first.evaluate("image => image.naturalWidth") > 100
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 900})
            page.wait_for_function(
                "width => document.documentElement.scrollWidth <= width", arg=width
            )
        assert_for_everybody(page)
        page.set_viewport_size({"width": 1280, "height": 900})
        assert_on_paper(page, tmp_path, pictures.count())
        # two lines are enough here: the plan changed by hand is the one that is measured
        write_plan(folder / "plan.toml", line_plan("one", "X", (100.0, 200.0)),
                   line_plan("two", "Y", (100.0, 200.0)))  # fmt: skip
        expect(pictures).to_have_count(2)
        page.wait_for_selector('div[data-step="program"] #go')
        page.click("#go")
        # without the role nothing is measured
        page.wait_for_selector('div[data-step="measure"] #go')
        page.click("#go")
        expect(page.locator("#doing [role=alert]")).to_contain_text("a token of the role operate")
        assert not (folder / "campaign.csv").exists()
        page.fill("#start-token", secret)
        page.fill("#start-by", "A. Vogel")
        page.click("#go")
        # what it asks is answered here, and how far it is is shown
        expect(page.locator(".question")).to_contain_text("set up one")
        page.click("[data-choice=stands]")
        moves = driven(folder / "plan.toml", tmp_path / "model.toml")
        targets = [k for k, move in enumerate(moves) if move.get("stands")]
        begun = 0
        for count, at in enumerate(targets[:4], start=1):
            way = [{k: v for k, v in m.items() if k != "stands"} for m in moves[begun : at + 1]]
            machine.order("drive", moves=way, speed=SPEED)
            begun = at + 1
            page.wait_for_selector(f'#step[data-done="{count}"]')
        expect(page.locator(".question")).to_contain_text("set up two")
        page.click("[data-choice='leave out']")
        page.wait_for_selector('#step[data-ended="bad"]')
        expect(page.locator("#step")).to_contain_text("targets are not measured")
        model = load_model(tmp_path / "model.toml")
        kept = read_campaign(folder / "campaign.csv", model.machine)
        assert kept.n == 4
        # the feed is that of the program
        assert "3000 mm/min" in (folder / "campaign.csv").read_text("utf-8")
        expect(page.locator("li[data-state=next]")).to_have_attribute("data-step", "measure")
        assert [e for e in seen.errors if "403" not in e] == []


def assert_only_the_next_step_and_what_is_asked(bench: OpenedWorkbench, folder: Path) -> None:
    """Nothing else is begun or answered, whoever asks; a certificate's page is kept apart."""

    def refused(path: str, body: dict[str, str], **headers: str) -> str:
        sent = json.dumps(body).encode()
        answered = bench.ask("POST", f"/api/calibrate/{path}", sent, **headers)
        assert answered.status in (403, 409, 422)
        return answered.body.decode()

    assert "is not the next step" in refused("start", {"step": "plan"})
    assert "role operate" in refused("start", {"step": "measure"})
    assert "is not asked" in refused("answer", {"answer": "yes"})
    assert "answer" in refused("answer", {"answer": "; rm"})
    refused("start", {"step": "start"}, origin="http://evil.example")
    assert bench.ask("GET", "/api/calibrate/certificate").status == 409
    assert bench.ask("GET", "/api/calibrate/picture?plan=plan&number=0").status == 409
    # a certificate is a page of a command's: its script runs, without access to anything here
    page = folder / "certificate.html"
    page.parent.mkdir(exist_ok=True)
    page.write_text("<script>1</script>")
    answered = bench.ask("GET", "/api/calibrate/certificate")
    policy = str(answered.headers["content-security-policy"])
    assert policy.startswith("sandbox allow-scripts")
    assert "allow-same-origin" not in policy
    page.unlink()
    assert not (folder / "start.toml").exists()
