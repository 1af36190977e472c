"""Debian's Chromium, and what it asks for and complains of while a page is looked at."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect, sync_playwright

from tests.support.daemon.workbench import OpenedWorkbench

PATIENCE_MS = 120_000.0
"""What anything may take on a busy machine."""
WIDTHS = (360, 1280, 3840)
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]

INK = """(canvas) => {
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let coloured = 0;
  for (let i = 0; i < pixels.length; i += 4) {
    const [r, g, b] = pixels.slice(i, i + 3);
    if (pixels[i + 3] > 60 && Math.max(r, g, b) - Math.min(r, g, b) > 60) coloured += 1;
  }
  return coloured;
}"""
"""Pixels in colour of a picture: axes and text are grey."""


@dataclass
class Watched:
    """A page, and everything that the browser asked for or complained of."""

    page: Page
    requests: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)


@contextmanager
def chromium() -> Iterator[Browser]:
    """Chromium, until the context is over."""
    program = shutil.which("chromium")
    assert program, "chromium is missing: apt install chromium (make test does)"
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(
            executable_path=program, args=["--no-sandbox", "--disable-background-networking"]
        )
        yield started
        started.close()


def watched(browser: Browser, width: int = 1280, **context: Any) -> Watched:
    """A new browser's page that has not gone anywhere yet."""
    page = browser.new_context(viewport={"width": width, "height": 900}, **context).new_page()
    page.set_default_timeout(PATIENCE_MS)
    expect.set_options(timeout=PATIENCE_MS)
    seen = Watched(page)
    page.on("request", lambda r: seen.requests.append(r.url))
    page.on("console", lambda m: seen.errors.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: seen.errors.append(str(error)))
    page.on("dialog", lambda dialog: seen.errors.append(f"dialog {dialog.message}"))
    return seen


def visit(
    browser: Browser,
    bench: OpenedWorkbench,
    width: int = 1280,
    *,
    until: str = "#view[data-tab=compare]",
    **context: Any,
) -> Watched:
    """A new browser's page, entered by the address that was printed."""
    seen = watched(browser, width, **context)
    seen.page.goto(bench.address)
    seen.page.wait_for_selector(until)
    return seen


def assert_quiet(seen: Watched, bench: OpenedWorkbench) -> None:
    """Nothing was complained of, and nothing asked for elsewhere."""
    assert seen.errors == []
    elsewhere = [u for u in seen.requests if not u.startswith((bench.origin, "data:", "blob:"))]
    assert elsewhere == []


def assert_for_everybody(page: Page) -> None:
    """axe-core finds nothing, with everything opened that can be."""
    page.evaluate("document.querySelectorAll('main details').forEach((d) => { d.open = true; })")
    found = Axe().run(page, options={"runOnly": {"type": "tag", "values": RULES}})
    said = [
        f"{v['id']}: {v['help']}: {[n['html'][:120] for n in v['nodes'][:4]]}"
        for v in found.response["violations"]
    ]
    assert said == []
    # numbers as people write them
    text = page.locator("main").inner_text()
    assert re.findall(r"(?<![\w.])\d+(?:\.\d+)?e[+−-]?\d\d(?!\w)", text) == []
    assert len(found.response["passes"]) > 10
