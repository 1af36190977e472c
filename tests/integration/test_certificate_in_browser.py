"""The certificate of abbe verify in Chromium: on a telephone, on a desk, and on paper."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, sync_playwright

from tests.support.daemon.browser import assert_for_everybody
from tests.support.daemon.command_line import abbe
from tests.support.daemon.german import english_on
from tests.support.daemon.verified_line import SCALE, fitted, line, written
from tests.support.pdf_text import pages_of

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

PATIENCE_MS = 240_000.0
DRAWN = """() => [...document.querySelectorAll("figure[data-plot]")].every(
  (node) => node.querySelectorAll(".barlayer path").length > 0)"""
WIDE = """() => [...document.querySelectorAll("body *")]
  .filter((node) => !node.closest(".wide, .js-plotly-plot, script, style"))
  .filter((node) => node.getBoundingClientRect().right > document.documentElement.clientWidth + 1)
  .map((node) => node.outerHTML.slice(0, 80))"""
"""What sticks out to the right, tables that scroll by themselves apart."""
BROKEN = """() => [...document.querySelectorAll(".wide td")].filter((cell) => {
  if (!cell.textContent.trim() || /\\s/.test(cell.textContent.trim())) return false;
  if (cell.textContent.length > 12) return false;
  const range = document.createRange();
  range.selectNodeContents(cell);
  return range.getClientRects().length > 1;
}).map((cell) => cell.textContent)"""
"""Words and numbers of tables that are broken in two."""
CUT = """() => [...document.querySelectorAll(".wide")].filter((table) =>
  table.scrollWidth > table.clientWidth).map((table) => table.textContent.slice(0, 80))"""
"""Tables that are wider than the sheet."""
OWN = frozenset({"XL-80, 12A345", "hall 3"})
"""What people wrote."""
BEFORE, AFTER = (230, 159, 0), (0, 114, 178)
"""The colours of the bars."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    program = shutil.which("chromium")
    assert program, "chromium is missing: apt install chromium (make test does)"
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("certificate"), "en")


@pytest.fixture(scope="module")
def german(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("zertifikat"), "de")


def made(folder: Path, language: str) -> Path:
    """A certificate with lines, tolerances and lengths, before and after."""
    model = fitted(folder)
    after = written(folder / "after.csv", line("x_check", 310.0, scale=0.0))
    before = written(folder / "before.csv", line("x_check", 310.0, scale=SCALE))
    if language != "en":
        # who is not named is not stated, in that language
        after.write_text(after.read_text("utf-8").replace('# operator = "R. Meier"\n', ""), "utf-8")
    page = folder / "certificate.html"
    done = abbe(
        "verify", model, after, "--before", before, "--tolerance", "E=12um", "--tolerance",
        "A=13um", "--mpe", "9", "--report", page, "--language", language,
    )  # fmt: skip
    assert done.status == 4, done.err
    return page


@pytest.mark.parametrize(("which", "width"), [("german", 360), ("certificate", 1280)])
def test_it_is_read_on_a_telephone_and_on_a_desk(
    browser: Browser, request: pytest.FixtureRequest, which: str, width: int
) -> None:
    certificate: Path = request.getfixturevalue(which)
    context = browser.new_context(viewport={"width": width, "height": 740}, color_scheme="light")
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    said: list[str] = []
    page.on("console", lambda m: said.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda r: said.append(r.url) if r.url.startswith("http") else None)
    page.goto(certificate.as_uri())
    page.wait_for_function(DRAWN)
    assert page.evaluate("document.querySelectorAll('figure[data-plot]').length") == 3
    assert said == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate(WIDE) == []
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert_for_everybody(page)
    english = list(english_on(page, OWN))
    assert page.evaluate("document.documentElement.lang") == {"german": "de"}.get(which, "en")
    assert english == [] if which == "german" else len(english) > 20
    context.close()


def test_paper_has_all_of_it(browser: Browser, certificate: Path) -> None:
    page = browser.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(certificate.as_uri())
    page.pdf(path=certificate.with_suffix(".pdf"), format="A4")
    page.close()
    printed = pages_of(certificate.with_suffix(".pdf"))
    assert all(len(p.text) > 40 for p in printed), "a page is blank"
    text = "".join(p.text for p in printed)
    for words in (
        "Certificate of verification: Small", "4711", "R. Meier", "XL-80, 12A345", "hall 3",
        "2026-03-02", "neither is proven", "Stated tolerances", "Before and after",
        "Lengths, ISO 10360-2 E0: passes", "Measured against foretold", "Uncertainty budget",
        "Thermal expansion", "Repeatability", "Signature", "Decision rule (ISO 14253-1)",
    ):  # fmt: skip
        assert "".join(words.split()) in text, words
    # the whole SHA-256, which the screen shortens
    for name in ("m.toml", "after.csv", "before.csv"):
        digest = hashlib.sha256((certificate.parent / name).read_bytes()).hexdigest()
        assert digest in text, name
    fills = {fill for p in printed for fill in p.fills}
    assert {BEFORE, AFTER} <= fills, "no bars on paper"


def test_a_page_without_bars_is_noticed(browser: Browser, certificate: Path) -> None:
    """Printed without its scripts nothing is drawn: what the colours above stand for."""
    bare = certificate.with_name("bare.html")
    bare.write_text(certificate.read_text("utf-8").replace("Plotly.newPlot", "void "), "utf-8")
    page = browser.new_page()
    page.goto(bare.as_uri())
    page.pdf(path=bare.with_suffix(".pdf"), format="A4")
    page.close()
    assert AFTER not in {f for p in pages_of(bare.with_suffix(".pdf")) for f in p.fills}


def test_on_paper_no_table_is_cut_off_and_no_word_of_it_broken(
    browser: Browser, german: Path
) -> None:
    # A4 between its margins
    context = browser.new_context(viewport={"width": 680, "height": 1000})
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(german.as_uri())
    for media in ("screen", "print"):
        page.emulate_media(media=media)
        assert page.evaluate(BROKEN) == []
    assert page.evaluate(CUT) == []
    context.close()
