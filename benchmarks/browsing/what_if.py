"""A cause tried by hand: from the move of a slider until its residuals stand on the screen."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from statistics import median

from benchmarks.browsing.taken import BrowserProcesses, spent
from tests.support.daemon.browser import chromium, visit
from tests.support.daemon.workbench import opened

_MILL = Path(__file__).parents[2] / "tests" / "data" / "p01-mill"
_MOVES = 40
_MOVE = """async (to) => {
  const trial = document.querySelector("#what-if"), bar = trial.querySelector("input[type=range]");
  const frame = () => new Promise((done) => requestAnimationFrame(done));
  const before = trial.dataset.rms, began = performance.now();
  bar.value = String(to);
  bar.dispatchEvent(new Event("input", {bubbles: true}));
  while (trial.dataset.rms === before) await frame();
  await frame();
  return performance.now() - began;
}"""


def what_if() -> str:
    """Measure; the figures as a page has them."""
    with tempfile.TemporaryDirectory() as name, chromium() as browser:
        versions = Path(name) / "versions"
        with opened(_MILL / "model.toml", _MILL / "fit.csv", "--versions", versions) as bench:
            page = visit(browser, bench).page
            page.click("#tab-learn")
            page.wait_for_selector("#what-if[data-ready]")
            page.wait_for_selector("#advice li")
            page.wait_for_function("() => document.querySelector('#task').hidden")
            spec = page.locator("#what-if").get_attribute("data-spec")
            rows = page.evaluate("fetch('/api/compare').then((r) => r.json()).then((c) => c.of)")
            page.locator("#what-if").evaluate(f"() => ({_MOVE})(11)")
            processes, pid = BrowserProcesses(), bench.process.pid
            cpu, own = processes.spent(), spent(pid)
            took = sorted(float(page.evaluate(f"({_MOVE})({20 + 9 * k})")) for k in range(_MOVES))
            each = [1e3 * s / _MOVES for s in (processes.spent() - cpu, spent(pid) - own)]
            answered = page.evaluate(
                """async (spec) => {
                const began = performance.now();
                await (await fetch("/api/try", {method: "POST", body: JSON.stringify({spec}),
                  headers: {"content-type": "application/json"}})).text();
                return performance.now() - began; }""",
                spec,
            )
    return f"""### What if

*Learn* of a campaign of {rows:,} rows in Debian's Chromium (without a graphics card): the slider of
its cause, `{spec}`,
moved to {_MOVES} places, one after the other; load of the host {os.getloadavg()[0]:.1f}.

| | |
| --- | --- |
| from the move until four pictures and the bar show it, median | **{median(took):.0f} ms** |
| nine of ten within | {took[int(0.9 * _MOVES)]:.0f} ms |
| the longest | {took[-1]:.0f} ms |
| one answer of the server, asked alone | {answered:.0f} ms |
| processor time of a move: browser, server | {each[0]:.0f} ms, {each[1]:.0f} ms |

Target: 100 ms on 2,000 rows."""
