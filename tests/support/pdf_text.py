"""The text of a PDF as Chromium prints it: glyphs back to letters by each font's own map."""

from __future__ import annotations

import re
import unicodedata
import zlib
from dataclasses import dataclass
from pathlib import Path

_OBJECT = re.compile(rb"(?<!\d)(\d+) 0 obj\n<<(.*?)>>\s*(?:stream\r?\n|\nendobj)", re.DOTALL)
_SHOWN = re.compile(r"/(F\d+) [\d.]+ Tf|<([0-9A-Fa-f]+)> Tj|(ET)")


@dataclass(frozen=True)
class PrintedPage:
    """One page: its letters, and the colours in which areas are filled.

    Attributes
    ----------
    text
        Without blanks: where a line breaks is the printer's affair.
    fills
        Red, green, blue, 0 to 255.
    """

    text: str
    fills: frozenset[tuple[int, ...]]


def pages_of(path: Path) -> list[PrintedPage]:
    """The pages of a PDF."""
    data = path.read_bytes()
    heads, streams = {}, {}
    for found in _OBJECT.finditer(data):
        number = int(found[1])
        heads[number] = found[2]
        if b"FlateDecode" in found[2] and found[0].rstrip().endswith(b"stream"):
            end = data.index(b"endstream", found.end())
            streams[number] = zlib.decompressobj().decompress(data[found.end() : end])
    pages = []
    for head in heads.values():
        if re.search(rb"/Type /Page\b(?!s)", head) is None:
            continue
        fonts = {
            name.decode(): _letters(heads, streams, int(number))
            for name, number in re.findall(rb"/(F\d+) (\d+) 0 R", head)
        }
        content = re.search(rb"/Contents (\d+) 0 R", head)
        assert content, "a page without content"
        drawn = streams[int(content[1])].decode("latin-1")
        fills = {
            tuple(round(255 * float(part)) for part in fill.split())
            for fill in re.findall(r"((?:[\d.]+ ){3})rg", drawn)
        }
        pages.append(PrintedPage(_shown(drawn, fonts), frozenset(fills)))
    assert pages, "no page"
    return pages


def _shown(content: str, fonts: dict[str, dict[int, str]]) -> str:
    text, font = [], {}
    for name, glyphs, _ in _SHOWN.findall(content):
        if name:
            font = fonts[name]
        codes = [int(glyphs[i : i + 4], 16) for i in range(0, len(glyphs), 4)]
        text += [font.get(code, "") for code in codes]
    return "".join(unicodedata.normalize("NFKC", "".join(text)).split())


def _letters(heads: dict[int, bytes], streams: dict[int, bytes], font: int) -> dict[int, str]:
    """Glyph → letters of a font."""
    where = re.search(rb"/ToUnicode (\d+) 0 R", heads.get(font, b""))
    if where is None:
        return {}
    table = streams[int(where[1])].decode("ascii")
    found = {}
    for part in re.findall(r"beginbfchar(.*?)endbfchar", table, re.DOTALL):
        for code, letters in re.findall(r"<(\w+)> <(\w+)>", part):
            found[int(code, 16)] = bytes.fromhex(letters).decode("utf-16-be")
    for part in re.findall(r"beginbfrange(.*?)endbfrange", table, re.DOTALL):
        for low, high, letter in re.findall(r"<(\w+)> <(\w+)> <(\w+)>", part):
            for i in range(int(low, 16), int(high, 16) + 1):
                found[i] = chr(int(letter, 16) + i - int(low, 16))
    return found
