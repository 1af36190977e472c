"""Fifty channels watched in a browser: processor time of both sides, and whether either grows."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.browsing.taken import BrowserProcesses, resident, spent
from tests.support.daemon.browser import chromium, visit
from tests.support.daemon.live_run import MODEL, compensating, live_run, machine
from tests.support.daemon.workbench import opened

CHANNELS = 50
"""Three axes' positions and thermometers."""
_SETTLED = 120.0
"""s after which figures are taken: what is drawn first is drawn, and every path was taken once."""
_EVERY = 10.0
"""s between two samples of memory."""
_COVERAGE = 2.0


def fifty_channels(seconds: float) -> str:
    """Measure; the figures as a page has them."""
    with tempfile.TemporaryDirectory() as name, machine(Path(name)) as (_, config):
        _with_more(config)
        with opened(config) as bench, live_run(config) as run, chromium() as browser:
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
            page.wait_for_timeout(1e3 * _SETTLED)
            processes, pid = BrowserProcesses(), bench.process.pid
            began, cpu, own = time.monotonic(), processes.spent(), spent(pid)
            counted = int(page.evaluate("window.counted"))
            samples = []
            while (passed := time.monotonic() - began) < seconds:
                page_now = page_has()
                renderer = processes.memory_of("renderer")
                others = processes.memory() - renderer
                samples.append((passed, *page_now, renderer, others, resident(pid)))
                page.wait_for_timeout(1e3 * _EVERY)
            passed = time.monotonic() - began
            used, served = (processes.spent() - cpu) / passed, (spent(pid) - own) / passed
            drawn = (int(page.evaluate("window.counted")) - counted) / passed
            nodes = page.evaluate("document.querySelectorAll('*').length")
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
| the processes that draw pages, MB | {grown[3]} |
| all other processes of the browser, MB | {grown[4]} |
| the server, MB | {grown[5]} |

Target: under 30 % of a core, server under 120 MB, and no growth. Growth, ± {_COVERAGE:g} standard
errors, is the slope of a straight line through a sample every {_EVERY:.0f} s of
{passed / 60.0:.0f} minutes, begun {_SETTLED:.0f} s after the page was opened, in which the records,
and with them the pictures of the past, fill; the standard error takes what is left as independent.
Garbage is collected before each sample, which costs processor time, too."""


def _with_more(config: Path) -> None:
    """The same machine with as many signals as make `CHANNELS`, of its thermistors in turn."""
    text = config.read_text()
    sensors = [line for line in text.splitlines() if line.startswith("[signals.")]
    more = CHANNELS - 3 - len(sensors)
    parts = text.split("[signals.")[1:]
    bodies = [part.partition("]")[2].partition("[")[0].strip() for part in parts]
    model = Path(MODEL).read_text()
    signals, known = [], []
    for k in range(more):
        body = bodies[k % len(bodies)]
        signals.append(f"[signals.T_more_{k + 1}]\n{body}\n")
        known.append(
            f'[machine.signals.T_more_{k + 1}]\nunit = "degC"\nrole = "structure"\n'
            f'location = "place {k + 1}"\n'
        )
    at = model.index("[machine.signals.")
    changed = config.with_name("model.toml")
    changed.write_text(model[:at] + "\n".join(known) + "\n" + model[at:])
    text = text.replace(f'model = "{MODEL}"', 'model = "model.toml"', 1)
    at = text.index("[signals.")
    text = text[:at] + "\n".join(signals) + "\n" + text[at:]
    config.write_text(f"{text}\n[records]\nevery = 0.1\n\n[http]\n")


def _growth(at: np.ndarray, values: np.ndarray) -> str:
    """Slope per hour with its standard error."""
    (slope, _), covariance = np.polyfit(at / 3600.0, values, 1, cov=True)
    return f"{slope:+.1f} ± {_COVERAGE * np.sqrt(covariance[0, 0]):.1f}".replace("-", "−")
