"""First sight of the workbench in a browser that has its files: from what it is made."""

from __future__ import annotations

import http.server
import json
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median

from playwright.sync_api import Browser

from benchmarks.browsing.taken import BrowserProcesses, spent
from tests.support.daemon.browser import chromium
from tests.support.daemon.live_run import compensating, live_run, machine
from tests.support.daemon.workbench import opened

_BRIDGE = Path(__file__).parents[2] / "tests" / "data" / "p03-bridge"
_TURNS = 9
_BETWEEN = 2000.0
"""ms from one sight to the next load: what was begun ends."""
_VERDICT = "#view[data-tab=compare] h1"
_STATE = ".live[data-seen=run] .axes"
_WATCH = """(() => {
  const look = () => {
    if (!document.querySelector(WANTED)?.textContent.trim()) requestAnimationFrame(look);
    // in the frame after the next it stands on the screen
    else requestAnimationFrame(() => requestAnimationFrame(() => {
      window.seen = performance.now();
    }));
  };
  addEventListener("DOMContentLoaded", () => requestAnimationFrame(look));
})()"""
_WEIGH = """() => performance.getEntriesByType("resource").concat(
  performance.getEntriesByType("navigation")).reduce((sum, e) => sum + e.transferSize, 0)"""
_PAGE = b"<!DOCTYPE html><title>Empty</title><h1>There</h1>"


def first_sight() -> str:
    """Measure; the figures as a page has them."""
    with chromium() as browser, _empty_page() as empty, tempfile.TemporaryDirectory() as name:
        alone = _sight(browser, empty, "h1", None)
        files = (_BRIDGE / "model.toml", _BRIDGE / "fit.csv", "--holdout", _BRIDGE / "check.csv")
        with opened(*files) as bench:
            compare = _sight(browser, bench.address, _VERDICT, bench.process.pid)
        with machine(Path(name)) as (_, config):
            config.write_text(config.read_text() + "\n[records]\nevery = 0.1\n\n[http]\n")
            with live_run(config) as run, opened(config) as bench:
                run.until(compensating)
                live = _sight(browser, bench.address, _STATE, bench.process.pid)
    rows = [
        f"| {words} | {seen:.0f} ms | {used:.0f} ms | {served:.0f} ms | {1e-3 * sent:.0f} kB |"
        for words, (seen, used, served, sent) in (
            ("an empty page of a server in the same process", alone),
            ("*Compare* of p03, until the verdict is read", compare),
            ("*Live*, until positions are read", live),
        )
    ]
    return f"""### First sight

A browser that was there before (Debian's Chromium, without a graphics card; its files are kept)
loads the page anew, medians of {_TURNS} turns: until what is wanted stands on the screen; the
processor time of all of the browser's processes and of the server meanwhile; what travels. The
first column grows with the load of the host, which was {os.getloadavg()[0]:.1f}.

| | on the screen after | browser | server | over the wire |
| --- | --- | --- | --- | --- |
{chr(10).join(rows)}

Target: 1 s and 2 MB. Plotly is not fetched before a picture needs it; pictures are drawn after what
is read, and those below the window's edge after those above it."""


@contextmanager
def _empty_page() -> Iterator[str]:
    class Empty(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("content-type", "text/html")
            self.send_header("content-length", str(len(_PAGE)))
            self.end_headers()
            self.wfile.write(_PAGE)

        def log_message(self, *_: object) -> None:
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Empty)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()


def _sight(
    browser: Browser, address: str, wanted: str, pid: int | None
) -> tuple[float, float, float, float]:
    """Until `wanted` is seen, ms; processor time of browser and server, ms; bytes."""
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    page = context.new_page()
    page.set_default_timeout(120_000.0)
    page.add_init_script(_WATCH.replace("WANTED", json.dumps(wanted)))
    page.goto(address)
    found = []
    for turn in range(_TURNS + 1):
        page.wait_for_function("() => window.seen")
        page.wait_for_timeout(_BETWEEN)
        if turn == _TURNS:
            break
        processes = BrowserProcesses()
        before = processes.spent(), spent(pid) if pid else 0.0
        page.reload(wait_until="commit")
        page.wait_for_function("() => window.seen")
        served = spent(pid) if pid else 0.0
        used = processes.spent()
        found.append((
            float(page.evaluate("() => window.seen")),
            1e3 * (used - before[0]), 1e3 * (served - before[1]), float(page.evaluate(_WEIGH)),
        ))  # fmt: skip
    context.close()
    seen, by_browser, by_server, sent = (median(column) for column in zip(*found, strict=True))
    return seen, by_browser, by_server, sent
