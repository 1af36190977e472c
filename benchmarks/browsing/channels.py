"""Fifty channels watched in a browser: processor time of both sides, and whether either grows."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser

from benchmarks.browsing.fifty import CHANNELS, filled, with_more
from benchmarks.browsing.taken import BrowserProcesses, resident, spent
from tests.support.daemon.browser import chromium, visit
from tests.support.daemon.live_run import compensating, live_run, machine
from tests.support.daemon.workbench import OpenedWorkbench, opened

_SETTLED = 120.0
"""s after which figures are taken: what is drawn first is drawn, and every path was taken once."""
_EVERY = 10.0
"""s between two samples of memory."""
_COVERAGE = 2.0


def fifty_channels(seconds: float) -> str:
    """Measure; the figures as a page has them."""
    with tempfile.TemporaryDirectory() as name, machine(Path(name)) as (_, config):
        with_more(config)
        with live_run(config) as before:
            before.until(compensating)
            time.sleep(2.0)
        filled(Path(name) / "records.sqlite")
        with ExitStack() as stack:
            bench = stack.enter_context(opened(config))
            run = stack.enter_context(live_run(config))
            browser = stack.enter_context(chromium())
            run.until(compensating)
            seen = visit(browser, bench, until=".live[data-seen=run]")
            page = seen.page
            page.wait_for_selector("#history[data-ready]")
            rows = page.locator("#now tbody tr").count()
            devtools = page.context.new_cdp_session(page)

            def page_has() -> tuple[float, float, float]:
                """Objects, MB, elements and listeners of the page, once what is unused is gone."""
                for _ in range(2):  # what is let go of in the first is collected in the second
                    devtools.send("HeapProfiler.collectGarbage")
                counted = devtools.send("Memory.getDOMCounters")
                used = float(devtools.send("Runtime.getHeapUsage")["usedSize"]) / 1e6
                return used, float(counted["nodes"]), float(counted["jsEventListeners"])

            page.evaluate(
                """() => { window.counted = 0; new MutationObserver((all) => {
                if (all.some((one) => one.attributeName === "data-cycle")) window.counted += 1;
                }).observe(document.querySelector(".live"), {attributes: true}); }"""
            )
            processes, pid = BrowserProcesses(), bench.process.pid
            second, attached = stack.enter_context(_alone(bench))
            page.wait_for_timeout(1e3 * _SETTLED)
            alone = BrowserProcesses(second)
            began, cpu, own = time.monotonic(), processes.spent(), spent(pid)
            counted = int(page.evaluate("window.counted"))
            samples = []
            while (passed := time.monotonic() - began) < seconds:
                page_now = page_has()
                renderer = alone.memory_of("renderer")
                others = alone.memory() - renderer
                kept = processes.memory_of("renderer")
                samples.append((passed, *page_now, renderer, others, kept, resident(pid)))
                page.wait_for_timeout(1e3 * _EVERY)
            passed = time.monotonic() - began
            used, served = (processes.spent() - cpu) / passed, (spent(pid) - own) / passed
            drawn = (int(page.evaluate("window.counted")) - counted) / passed
            nodes = page.evaluate("document.querySelectorAll('*').length")
            late_second = alone.memory_of("renderer")
            _collected(browser, attached)
            swept = alone.memory_of("renderer")
    at, *series = np.array(samples).T
    late = at >= at[-1] / 2.0
    grown = [
        f"{values[0]:,.1f} | {values[-1]:,.1f} | {_growth(at, values)} | "
        f"{_growth(at[late], values[late])}"
        for values in series
    ]
    return f"""### Fifty channels in a browser

The same machine with {CHANNELS} channels (three axes, {rows} sensors that are shown), watched in
Debian's Chromium (without a graphics card) for {passed:.0f} s, the last hour's history below; load
of the host {os.getloadavg()[0]:.1f}.

| | |
| --- | --- |
| processor time of all of the browser's processes | **{used:.1%}** of a core |
| processor time of the server | {served:.1%} of a core |
| positions drawn a second | {drawn:.1f} |
| elements of the page | {nodes:,} |

| garbage collected | at first | at the end | growth in an hour | in its second half |
| --- | --- | --- | --- | --- |
| the page's objects (JavaScript heap), MB | {grown[0]} |
| elements and texts that anything holds | {grown[1]} |
| listeners that anything holds | {grown[2]} |
| a browser that no tool listens in on: the processes that draw pages, MB | {grown[3]} |
| all its other processes, MB | {grown[4]} |
| the browser that is measured: the processes that draw pages, MB | {grown[5]} |
| the server, MB | {grown[6]} |

The browser that no tool listens in on, at the end, before and after its garbage was collected:
{late_second:.1f} and **{swept:.1f} MB**; it lets what it does not need lie while it has room.

Target: under 30 % of a core, server under 120 MB, and no growth. Growth, ± {_COVERAGE:g} standard
errors, is the slope of a straight line through a sample every {_EVERY:.0f} s of
{passed / 60.0:.0f} minutes, begun {_SETTLED:.0f} s after the page was opened; the hour before it is
full of records, so that the pictures are full from the first; the standard error takes what is left
as independent.
Objects, elements and listeners are counted by the browser's own tools after garbage was collected,
which costs processor time, too; and a browser whose network is listened in on (Chrome DevTools
Protocol, `Network.enable`, as test tools do) grows by it: measured apart, in 8 minutes at
10 kB/s of stream, by 99 ± 6 MB/h, one with another tool attached (`Performance.enable`) by
1 ± 4 MB/h. Memory is therefore a second browser's beside it."""


@contextmanager
def _alone(bench: OpenedWorkbench) -> Iterator[tuple[int, Path]]:
    """Chromium as a person has it, with the same page; its process, and how to attach a tool."""
    program = shutil.which("chromium")
    assert program, "chromium is missing: apt install chromium"
    assert bench.process.stdout is not None
    address = ""
    while "for another browser" not in address:
        address = bench.process.stdout.readline()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        words = ["--headless=new", "--no-sandbox", "--disable-background-networking",
                 "--no-first-run", "--window-size=1280,900", "--remote-debugging-port=0",
                 f"--user-data-dir={profile}"]  # fmt: skip
        process = subprocess.Popen(
            [program, *words, address.split()[-1]],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            yield process.pid, Path(profile) / "DevToolsActivePort"
        finally:
            process.terminate()
            process.wait()


def _collected(browser: Browser, attached: Path) -> None:
    """Have the garbage of a browser's page collected that no tool was attached to before."""
    port = attached.read_text().splitlines()[0]
    other = browser.browser_type.connect_over_cdp(f"http://127.0.0.1:{port}")
    page = other.contexts[0].pages[0]
    devtools = page.context.new_cdp_session(page)
    for _ in range(2):
        devtools.send("HeapProfiler.collectGarbage")
    time.sleep(5.0)  # pages that are empty go a little later
    other.close()


def _growth(at: np.ndarray, values: np.ndarray) -> str:
    """Slope per hour with its standard error."""
    (slope, _), covariance = np.polyfit(at / 3600.0, values, 1, cov=True)
    return f"{slope:+.1f} ± {_COVERAGE * np.sqrt(covariance[0, 0]):.1f}".replace("-", "−")
