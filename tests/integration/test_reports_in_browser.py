"""Every kind of report in Debian's Chromium: pictures drawn, no error, no request to anywhere."""

from __future__ import annotations

import base64
import shutil
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pypdfium2
import pytest
from playwright.sync_api import Browser, sync_playwright
from typer.testing import CliRunner

from abbe.compcore.figures.figure import SIGNED, figure, line
from abbe.daemon.application import app
from abbe.daemon.report.page import Page
from tests.support.daemon.some_setups import some_setups

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

DATA = Path(__file__).parents[1] / "data"
MILL, BRIDGE = DATA / "p01-mill", DATA / "p03-bridge"

ARGUMENTS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]

PATIENCE_MS = 240_000.0
"""What a picture may take to be drawn on a busy machine without a graphics card."""

PICTURES = """() => [...document.querySelectorAll("figure[data-plot]")].map((node) => {
  const size = node.querySelector(".main-svg").getBoundingClientRect();
  const marks = ".scatterlayer path, .barlayer path, .heatmaplayer image, .contourlayer path";
  const caption = node.querySelector("figcaption");
  return {
    name: node.dataset.plot,
    width: size.width,
    height: size.height,
    marks: node.querySelectorAll(marks).length,
    canvas: node.querySelector("canvas") !== null,
    gap: caption ? caption.getBoundingClientRect().top - size.bottom : 0,
  };
})"""

COLOURS_OF_CANVAS = """(name) => {
  const plot = document.querySelector(`figure[data-plot="${name}"] .js-plotly-plot`);
  return Plotly.toImage(plot, {format: "png", width: 320, height: 240}).then((url) =>
    new Promise((resolve) => {
      const image = new Image();
      image.onload = () => {
        const copy = document.createElement("canvas");
        [copy.width, copy.height] = [image.width, image.height];
        const context = copy.getContext("2d", {willReadFrequently: true});
        context.drawImage(image, 0, 0);
        const pixels = context.getImageData(0, 0, copy.width, copy.height).data;
        let coloured = 0;
        for (let i = 0; i < pixels.length; i += 4) {
          const [r, g, b] = pixels.slice(i, i + 3);
          if (pixels[i + 3] > 128 && Math.max(r, g, b) - Math.min(r, g, b) > 60) coloured += 1;
        }
        resolve(coloured);
      };
      image.src = url;
    }));
}"""
"""Pixels in colour of a picture as the browser renders it: axes and text are grey."""


@dataclass
class Seen:
    """What the browser told of one page."""

    requests: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    pictures: list[dict[str, Any]] = field(default_factory=list)
    coloured: dict[str, int] = field(default_factory=dict)


Look = Callable[[Path], Seen]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    program = shutil.which("chromium")
    assert program, "chromium is missing: apt install chromium (make test does)"
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=program, args=ARGUMENTS)
        yield opened
        opened.close()


@pytest.fixture
def look(browser: Browser) -> Iterator[Look]:
    """Open a page and wait until every picture is there."""
    context = browser.new_context(viewport={"width": 900, "height": 600})
    context.set_default_timeout(PATIENCE_MS)

    def opened(path: Path) -> Seen:
        seen = Seen()
        page = context.new_page()
        page.on("request", lambda r: seen.requests.append(r.url))
        page.on("console", lambda m: seen.errors.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda error: seen.errors.append(str(error)))
        page.goto(path.as_uri())
        page.wait_for_function(
            """() => [...document.querySelectorAll("figure[data-plot]")].every(
                 (node) => node.querySelector(".js-plotly-plot .main-svg"))"""
        )
        seen.pictures = page.evaluate(PICTURES)
        for picture in seen.pictures:
            if picture["canvas"]:
                name = picture["name"]
                seen.coloured[name] = page.evaluate(COLOURS_OF_CANVAS, name)
        page.close()
        return seen

    yield opened
    context.close()


def elsewhere(seen: Seen) -> list[str]:
    return [url for url in seen.requests if not url.startswith(("file:", "data:", "blob:"))]


def assert_sound(seen: Seen, *, pictures: int) -> None:
    """All pictures drawn, nothing fetched, nothing complained of."""
    assert seen.errors == []
    assert elsewhere(seen) == []
    assert len(seen.pictures) >= pictures
    for picture in seen.pictures:
        assert picture["width"] > 300, picture
        assert picture["height"] > 50, picture
        assert picture["marks"] or picture["canvas"], f"nothing drawn: {picture}"
        assert -1.0 < picture["gap"] < 40.0, f"caption not below its picture: {picture}"
        if picture["canvas"]:
            assert seen.coloured[picture["name"]] > 50, f"nothing drawn: {picture}"


def abbe(*arguments: object) -> None:
    done = CliRunner().invoke(app, [str(a) for a in arguments])
    assert done.exit_code == 0, done.output


@pytest.mark.thorough
def test_diagnose(look: Look, tmp_path: Path) -> None:
    report = tmp_path / "diagnose.html"
    abbe("diagnose", MILL / "model.toml", MILL / "fit.csv", "--report", report)
    seen = look(report)
    assert_sound(seen, pictures=4)
    assert len(seen.coloured) == 1  # the residuals in the volume


def test_fit_and_compare(look: Look, tmp_path: Path) -> None:
    check = MILL / "check.csv"
    model = tmp_path / "fitted.toml"
    fitted, compared = tmp_path / "fit.html", tmp_path / "compare.html"
    abbe("fit", MILL / "model.toml", check, "-o", model, "--report", fitted)
    abbe("compare", model, check, "--report", compared)
    for report in (fitted, compared):
        seen = look(report)
        assert_sound(seen, pictures=5)
        assert len(seen.coloured) == 1, report


@pytest.mark.thorough
def test_iso230(look: Look, tmp_path: Path) -> None:
    report = tmp_path / "iso230.html"
    campaign = some_setups(MILL / "fit.csv", tmp_path / "lines.csv", every=4)
    abbe("iso230", campaign, "--report", report)
    assert_sound(look(report), pictures=2)


def test_history(look: Look, tmp_path: Path) -> None:
    one, two, report = tmp_path / "1.toml", tmp_path / "2.toml", tmp_path / "history.html"
    some = some_setups(BRIDGE / "fit.csv", tmp_path / "some.csv", every=6)
    both = ("--campaign", some, "--holdout", BRIDGE / "check.csv", "-o")
    abbe("add", BRIDGE / "model.toml", "backlash", "axis=Z", *both, one)
    added = tmp_path / "added.html"
    abbe("add", one, "warm_up", "direction=X", *both, two, "--report", added)
    assert_sound(look(added), pictures=1)
    abbe("history", two, "--report", report)
    seen = look(report)
    assert_sound(seen, pictures=2)
    # two campaigns, fitted and held out: three versions, a bar and the noise floor across each
    assert [picture["marks"] for picture in seen.pictures] == [6, 6]


@pytest.mark.thorough
def test_table_and_correct(look: Look, tmp_path: Path) -> None:
    model, tables = tmp_path / "fitted.toml", tmp_path / "table.html"
    corrected = tmp_path / "correct.html"
    abbe("fit", MILL / "model.toml", MILL / "check.csv", "-o", model)
    at = ("--at", "reference")
    abbe("table", model, "--controller", "linuxcnc", "-o", tmp_path / "t", *at, "--report", tables)
    assert_sound(look(tables), pictures=2)
    warm = [f"T_{name}=21.5" for name in ("amb", "x", "y", "z", "col_front", "col_rear", "spindle")]
    abbe("correct", model, "X=400", "Y=250", "Z=-200", *warm, "--report", corrected)
    assert_sound(look(corrected), pictures=1)


def test_what_is_in_view_comes_first_and_paper_has_everything(
    browser: Browser, tmp_path: Path
) -> None:
    """Pictures below are drawn one by one, or all at once when the page is printed."""
    report = Page("Many")
    for _ in range(30):
        report.figure(figure([line([0.0, 1.0], [0.0, 1.0])]))
    report.write(tmp_path / "many.html")
    drawn = "document.querySelectorAll('.js-plotly-plot .main-svg:first-child').length"
    opened = browser.new_page(viewport={"width": 900, "height": 600})
    opened.set_default_timeout(PATIENCE_MS)
    # no clock: none is drawn but what is in view
    opened.add_init_script("window.setTimeout = () => 0")
    opened.goto((tmp_path / "many.html").as_uri())
    opened.wait_for_function(f"() => {drawn} > 0")
    height = opened.evaluate("document.documentElement.scrollHeight")
    assert opened.evaluate(drawn) < 10
    opened.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert opened.evaluate(drawn) == 30
    assert opened.evaluate("document.documentElement.scrollHeight") == pytest.approx(
        height, rel=0.1
    )
    opened.close()


def printed(browser: Browser, path: Path) -> dict[str, int]:
    """A page as Chromium prints it, seen by PDFium: pixels in colour, and how far they reach."""
    paper = path.with_suffix(".pdf")
    page = browser.new_page()
    page.goto(path.as_uri())
    page.pdf(path=paper)
    page.close()
    with pypdfium2.PdfDocument(paper) as document:
        dots = document[0].render(scale=2.0).to_numpy()[:, :, :3].astype(int)
    coloured = np.argwhere(np.ptp(dots, axis=2) > 60)
    down, across = np.ptp(coloured, axis=0) if len(coloured) else (0, 0)
    return {"coloured": len(coloured), "wide": int(across), "tall": int(down)}


def volume(path: Path, *, blank: bool = False) -> Path:
    """A page with a picture in space and nothing else in colour; `blank`: without its still."""
    ends = np.array([[0.0, 0.0, 0.0], [300.0, 400.0, 200.0]])
    gap = np.full((1, 3), np.nan)
    path_ = np.concatenate([ends, gap, ends[::-1] * [1.0, 0.0, 1.0]])
    colour = [-2.0, -2.0, 0.0, 2.0, 2.0]
    style = {"color": colour, "colorscale": SIGNED, "cmin": -2.0, "cmax": 2.0, "width": 4}
    trace = {"type": "scatter3d", "mode": "lines", "line": style}
    trace |= dict(zip("xyz", path_.T, strict=True))
    page = Page("Volume")
    page.figure(figure([trace], height=500))
    html = page.html()
    path.write_text(html.replace("svg.still { display: block", "svg.x { display: block") if blank
                    else html, encoding="utf-8")  # fmt: skip
    return path


def test_paper_has_ink_where_the_volume_is(browser: Browser, tmp_path: Path) -> None:
    ink = printed(browser, volume(tmp_path / "volume.html"))
    assert ink["coloured"] > 300
    assert ink["wide"] > 150
    assert ink["tall"] > 150
    assert printed(browser, volume(tmp_path / "blank.html", blank=True))["coloured"] == 0


def test_on_paper_no_picture_lies_over_text(browser: Browser, tmp_path: Path) -> None:
    report = Page("Two")
    for _ in range(2):
        report.figure(figure([line([0.0, 1.0], [0.0, 1.0], "a")], height=360), "Its caption.")
        report.text("What follows.")
    report.write(tmp_path / "two.html")
    page = browser.new_page(viewport={"width": 700, "height": 400})
    page.set_default_timeout(PATIENCE_MS)
    page.goto((tmp_path / "two.html").as_uri())
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    drawn = "document.querySelectorAll('.js-plotly-plot .main-svg:first-child').length"
    page.wait_for_function(f"() => {drawn} === 2")
    for picture in page.evaluate(PICTURES):
        assert picture["height"] > 300
        assert -1.0 < picture["gap"] < 40.0, picture
    page.close()


def hidden(content: bytes, *, level: int = 6, way: int = zlib.Z_DEFAULT_STRATEGY) -> str:
    """Content as a page holds it, packed by zlib in one of its ways."""
    packer = zlib.compressobj(level, zlib.DEFLATED, -zlib.MAX_WBITS, 9, way)
    return base64.b64encode(packer.compress(content) + packer.flush()).decode()


OPENED = """([text, size]) => {
  const node = Object.assign(document.createElement("i"), {textContent: text});
  node.dataset.size = size;
  return unpacked(node);
}"""


def test_what_is_packed_is_opened_as_zlib_opens_it(browser: Browser) -> None:
    """All kinds of blocks, the longest and the farthest repetitions, letters of several bytes."""
    page = browser.new_page()
    page.add_script_tag(
        content=files("abbe.daemon.report.pictures").joinpath("inflate.js").read_text()
    )
    rng = np.random.default_rng(16)
    random = "".join(map(chr, rng.integers(32, 0x2FF, 40_000)))
    far = random[:16_000] + "a" * 900 + random[:16_000]
    skewed = "".join(map(chr, (48 + rng.geometric(0.5, 60_000))))
    for text in ("", "µ", "abc" * 100, "a" * 100_000, random, far, skewed):
        content = text.encode()
        ways = [{"level": n} for n in (0, 1, 6, 9)]
        ways += [{"way": w} for w in (zlib.Z_FIXED, zlib.Z_HUFFMAN_ONLY, zlib.Z_RLE)]
        for how in ways:
            assert page.evaluate(OPENED, [hidden(content, **how), len(content)]) == text, how
    page.close()


def test_the_look_itself_notices(look: Look, tmp_path: Path) -> None:
    """A page that asks for something, errs and draws nothing must not pass."""
    path = tmp_path / "bad.html"
    page = Page("Bad")
    page.figure(figure([]))
    page.figure(figure([line([0.0, 1.0], [0.0, 1.0])]))
    html = page.html().replace("Content-Security-Policy", "x")
    bad = '<script>throw new Error("broken")</script><img src="http://127.0.0.1:9/x.png"></body>'
    path.write_text(html.replace("</body>", bad), encoding="utf-8")
    seen = look(path)
    assert elsewhere(seen) == ["http://127.0.0.1:9/x.png"]
    assert any("broken" in error for error in seen.errors)
    assert [picture["marks"] > 0 for picture in seen.pictures] == [False, True]
