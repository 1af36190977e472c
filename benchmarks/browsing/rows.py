"""A million rows looked at in a browser: first sight, what travels, each selection."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

from playwright.sync_api import Page

from benchmarks.browsing.taken import BrowserProcesses, resident, spent
from benchmarks.diagnosis_command import written
from tests.support.daemon.browser import chromium, watched
from tests.support.daemon.workbench import opened

_BRUSHES = 20

_DRAG = """async (panel) => {
  const canvas = panel.querySelector("canvas"), box = canvas.getBoundingClientRect();
  const bar = document.getElementById("selection");
  const send = (kind, x, y) => canvas.dispatchEvent(new PointerEvent(kind, {bubbles: true,
    button: 0, pointerId: 1, clientX: box.left + x * box.width,
    clientY: box.top + y * box.height}));
  canvas.setPointerCapture = () => {};
  const frame = () => new Promise((done) => requestAnimationFrame(done));
  const from = 0.2 + 0.3 * Math.random();
  send("pointerdown", from, 0.3);
  const moves = [];
  for (let k = 1; k <= 8; k += 1) {
    const began = performance.now();
    send("pointermove", from + 0.05 * k, 0.3 + 0.03 * k);
    moves.push(performance.now() - began);
    await frame();
  }
  const before = bar.dataset.turn ?? "0", began = performance.now();
  send("pointerup", from + 0.4, 0.54);
  while ((bar.dataset.turn ?? "0") === before) await frame();
  await frame();
  return {brush: performance.now() - began, move: Math.max(...moves),
    chosen: Number(bar.dataset.count)};
}"""


def many_rows(rows: int) -> str:
    """Measure; the figures as a page has them."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        n = written(folder, rows)
        began = time.monotonic()
        with opened(folder / "model.toml", folder / "campaign.csv") as bench, chromium() as browser:
            bench.enter()
            while bench.json("/api/compare") is None:
                time.sleep(0.5)
            ready = time.monotonic() - began
            packed = len(bench.ask("GET", "/api/compare", accept_encoding="gzip").body)
            began = time.monotonic()
            plain = len(bench.ask("GET", "/api/compare").body)
            served = time.monotonic() - began
            page = _entered(browser, bench)
            began = time.monotonic()
            page.reload()
            page.wait_for_selector("#view[data-tab=compare] .volume canvas")
            first = time.monotonic() - began
            processes, pid = BrowserProcesses(), bench.process.pid
            cpu, own = processes.spent(), spent(pid)
            found: list[dict[str, Any]] = [
                page.locator(".scatter").nth(k % 4).evaluate(_DRAG) for k in range(_BRUSHES)
            ]
            each = [1e3 * s / _BRUSHES for s in (processes.spent() - cpu, spent(pid) - own)]
            devtools = page.context.new_cdp_session(page)
            devtools.send("HeapProfiler.collectGarbage")
            heap = float(devtools.send("Runtime.getHeapUsage")["usedSize"]) / 1e6
            memory, server = processes.memory(), resident(pid)
    brushes, moves = sorted(f["brush"] for f in found), [f["move"] for f in found]
    chosen = [f["chosen"] for f in found]
    figures = {
        "from the start until the comparison is there (reading and comparing included)": (
            f"{ready:.0f} s"
        ),
        "what travels then, compressed (as it is)": f"{packed / 1e6:.2f} MB ({plain / 1e6:.2f} MB)",
        "the server's answer": f"{1e3 * served:.0f} ms",
        "page loaded anew, until all its pictures are there": f"{first:.1f} s",
        "from the end of a drag until every picture shows the selection, median and longest": (
            f"**{median(brushes):.0f} ms**, {brushes[-1]:.0f} ms"
        ),
        "processor time of it, drag included: browser, server": (
            f"{each[0]:.0f} ms, {each[1]:.0f} ms"
        ),
        "a picture drawn anew while the box is drawn, median and longest": (
            f"{median(moves):.1f} ms, {max(moves):.1f} ms"
        ),
        "memory: the page's objects, the browser, the server": (
            f"{heap:.0f} MB, {memory:.0f} MB, {server:.0f} MB"
        ),
    }
    table = "\n".join(f"| {what} | {value} |" for what, value in figures.items())
    return f"""### A million residuals

`abbe open` with a campaign of {n:,} rows (a bridge CMM's day, as under *The commands as typed*),
*Compare* in Debian's Chromium (without a graphics card): all rows are counted in the cells of each
picture on the server; a box drawn over a picture selects among all of them. {_BRUSHES} boxes over
four pictures, {min(chosen):,} to {max(chosen):,} rows each; load of the host
{os.getloadavg()[0]:.1f}.

| | |
| --- | --- |
{table}"""


def _entered(browser: Any, bench: Any) -> Page:
    seen = watched(browser)
    assert bench.process.stdout is not None
    bench.process.stdout.readline()
    address = bench.process.stdout.readline().split()[-1]
    seen.page.goto(address)
    seen.page.wait_for_selector("#view[data-tab=compare] .volume canvas")
    return seen.page
