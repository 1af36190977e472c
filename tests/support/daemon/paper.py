"""A view as paper has it: its report, and what a printer gets of that."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from playwright.sync_api import Page

from tests.support.pdf_text import pages_of

COLOURED = """async (image) => {
  await image.decode();
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [image.naturalWidth, image.naturalHeight];
  const pen = copy.getContext("2d");
  pen.drawImage(image, 0, 0);
  const dots = pen.getImageData(0, 0, copy.width, copy.height).data;
  let coloured = 0;
  for (let i = 0; i < dots.length; i += 4) {
    const [r, g, b] = dots.slice(i, i + 3);
    if (dots[i + 3] > 60 && Math.max(r, g, b) - Math.min(r, g, b) > 60) coloured += 1;
  }
  return coloured;
}"""
"""Pixels in colour of an image."""
INKED = COLOURED.replace("Math.max(r, g, b) - Math.min(r, g, b) > 60", "Math.max(r, g, b) < 235")
"""Pixels that are not paper: some pictures are grey."""
SHEET = 297.0 - 2 * 14.0
"""Height of an A4 sheet between the margins, mm."""
_PX = 25.4 / 96.0


def report_of(page: Page) -> Page:
    """The window that the button opens."""
    with page.expect_popup() as found:
        page.click("#report")
    made = found.value
    made.wait_for_selector("#paper[data-ready]")
    return made


def assert_on_paper(page: Page, folder: Path, pictures: int, files: Iterable[Path] = ()) -> None:
    """A view's report has so many pictures at least, none blank; every sheet says what it is of.

    `files`: those whose SHA-256 stands whole on the first sheet, and shortened on each.
    """
    made = report_of(page)
    images = made.locator("#paper img").all()
    assert len(images) >= pictures
    for image in images:
        assert image.evaluate(INKED) > 300, image.get_attribute("alt")
    made.emulate_media(media="print")
    for image in made.locator("#paper img, #paper svg").all():
        box = image.bounding_box()
        assert box is not None
        # what is not higher than a sheet is not cut: each stands in a block that is kept together
        assert box["height"] * _PX < 0.9 * SHEET
        assert image.evaluate("i => getComputedStyle(i).breakInside") == "avoid"
    made.emulate_media(media="null")
    paper = folder / "view.pdf"
    made.pdf(path=paper, format="A4")
    sheets = pages_of(paper)
    machine = "".join(page.locator("#machine").inner_text().split())
    for number, sheet in enumerate(sheets, start=1):
        for words in (machine, "Date:", "Serialnumber:", "Operator:", "Environment:"):
            assert words in sheet.text, (number, words)
        assert f"{number}/{len(sheets)}" in sheet.text
        for file in files:
            digest = hashlib.sha256(file.read_bytes()).hexdigest()
            assert digest[:12] in sheet.text, (number, file)
    for file in files:
        assert hashlib.sha256(file.read_bytes()).hexdigest() in sheets[0].text
    made.close()
