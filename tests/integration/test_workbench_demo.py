"""``abbe demo`` starts the workbench: the machine is seen live in Chromium while the demo runs."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.support.daemon.browser import chromium, watched
from tests.support.daemon.live_run import PATIENCE

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]


@pytest.mark.thorough
def test_the_demo_is_seen_live_and_ends_by_itself(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "abbe.daemon", "demo", "--json", "--duration", "45"]
    process = subprocess.Popen(
        [*command, "--out", "out"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    lines: list[str] = []
    reading = threading.Thread(target=lambda: lines.extend(process.stdout or ()), daemon=True)
    reading.start()
    try:
        address = None
        for line in process.stderr:
            if address := re.search(r"http://127\.0\.0\.1:\d+/enter\?key=\S+", line):
                break
        assert address is not None
        rest = threading.Thread(target=process.stderr.read, daemon=True)
        rest.start()
        with chromium() as browser:
            seen = watched(browser)
            page = seen.page
            page.goto(address[0])
            page.wait_for_selector(".live[data-seen=run]")
            expect(page.locator("#machine")).to_have_text("Bridge CMM (simulated)")
            expect(page.locator("#state")).to_have_text("corrected in full")
            # its stream, its covariance, its records: positions ten times a second, ±, history
            page.wait_for_selector(".live[data-cycle]")
            expect(page.locator("[data-axis=X]")).to_contain_text(re.compile(r"± \d+\.\d µm"))
            expect(page.locator("[data-axis=X]")).to_contain_text("before")
            page.wait_for_selector("#history[data-ready]")
            expect(page.locator(".past")).not_to_have_count(0)
            assert process.poll() is None, "seen while it ran"
            # a further browser's address stands in the folder
            further = (tmp_path / "out" / "workbench.txt").read_text().strip()
            other = watched(browser).page
            other.goto(further)
            other.wait_for_selector(".live[data-seen=run]")
            process.wait(2 * PATIENCE)
            # the demo is over, and its workbench with it
            expect(page.locator("#lost")).to_be_visible()
        assert process.returncode == 0
        reading.join(PATIENCE)
        summary = json.loads(lines[-1])["summary"]
        assert summary["improvement"] >= 8.0
        assert not (tmp_path / "out" / "workbench.txt").exists()
        assert [e for e in seen.errors if "ERR_" not in e] == []
    finally:
        process.kill()
        process.wait()
        reading.join(PATIENCE)
        process.stdout.close()
        process.stderr.close()
