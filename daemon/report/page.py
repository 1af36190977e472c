"""A self-contained HTML page: text, tables and Plotly figures, readable offline and on paper.

Nothing is fetched: Plotly.js is in the file (packed, only where there is a figure), and the page's
own content security policy forbids the browser every request.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from math import floor, isfinite, log10
from pathlib import Path
from typing import Any

import numpy as np

from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.sentences import Sentence, said
from abbe.compcore.units import in_digits
from abbe.daemon.installed import abbe_version
from abbe.daemon.report.head import PageHead
from abbe.daemon.report.language import ENGLISH, PageLanguage
from abbe.daemon.report.language import language as known_language
from abbe.daemon.report.pictures.packed import packed_pictures
from abbe.daemon.report.pictures.still import still
from abbe.daemon.report.style import STYLE

Figure = Mapping[str, Any]
"""A Plotly figure as plain data: ``{"data": [...], "layout": {...}}``."""

# 'unsafe-eval': Plotly's 3D pictures compile their shaders' wrappers
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; worker-src blob:"
)
_MINUS = re.compile(r"(?<![^\s(])-(?=\d)")
_HEIGHT = 450
"""Pixels that Plotly gives a picture whose height is not stated."""


class Page:
    """A page, built from top to bottom.

    Parameters
    ----------
    title
        What the page is about; also the browser's title.
    subtitle
        One line below it.
    head
        Which machine, when, by whom, and which files.
    language
        In which all texts are shown that it knows.

    Examples
    --------
    >>> page = Page("Positioning of X", "x.csv")
    >>> page.section("Results")
    >>> page.table(["Result", "µm"], [["A", 9.0]])
    >>> "<td>A</td>" in page.html()
    True
    """

    def __init__(
        self,
        title: str,
        subtitle: str = "",
        head: PageHead | None = None,
        language: PageLanguage | None = None,
    ) -> None:
        self._language = known_language(ENGLISH) if language is None else language
        self._title = self._language.say(title)
        self._subtitle = self._language.say(subtitle)
        self._head = head
        self._made = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
        self._body: list[str] = []
        self._figures: dict[str, Any] = {}

    def _text(self, text: str) -> str:
        """A text in the page's language, as HTML."""
        return escape(self._language.say(text))

    def section(self, heading: str) -> None:
        """Begin a section."""
        self._body.append(f"<h2>{self._text(heading)}</h2>")

    def subsection(self, heading: str, spec: str = "") -> None:
        """Begin a part of a section; `spec` is what Abbe's commands call it."""
        beside = f" <code>{escape(spec)}</code>" if spec else ""
        self._body.append(f"<h3>{self._text(heading)}{beside}</h3>")

    def text(self, paragraph: str) -> None:
        """Add a paragraph."""
        self._body.append(f"<p>{self._text(paragraph)}</p>")

    def notes(self, notes: Sequence[str], *, warning: bool = False) -> None:
        """Add remarks, set apart; nothing when there are none."""
        if notes:
            items = "".join(f"<li>{self._text(note)}</li>" for note in notes)
            kind = "warning" if warning else "note"
            self._body.append(f'<ul class="notes {kind}">{items}</ul>')

    def key_figures(self, figures: Sequence[tuple[str, str, str]]) -> None:
        """Add a row of (label, value, unit) in large type: what the reader came for."""
        cells = "".join(
            f"<div><dt>{self._text(label)}</dt><dd>{self._text(value)} "
            f"<small>{self._text(unit)}</small></dd>"
            "</div>"
            for label, value, unit in figures
        )
        self._body.append(f'<dl class="key">{cells}</dl>')

    def table(
        self,
        columns: Sequence[str],
        rows: Sequence[Sequence[str | float | int | None]],
        *,
        caption: str = "",
        digits: int = 4,
    ) -> None:
        """Add a table; None becomes a dash.

        The numbers of a column have the same decimals: `digits` significant ones in the greatest.
        """
        numeric = [
            any(not isinstance(row[i], str | None) for row in rows) for i in range(len(columns))
        ]
        decimals = [_decimals([row[i] for row in rows], digits) for i in range(len(columns))]
        head = "".join(
            # a column without a name is no heading
            f'<th scope="col"{_NUMBER if is_number else ""}>{self._text(column)}</th>'
            if column
            else "<td></td>"
            for column, is_number in zip(columns, numeric, strict=True)
        )
        body = "".join(
            f"<tr>{''.join(self._cell(v, d) for v, d in zip(row, decimals, strict=True))}</tr>"
            for row in rows
        )
        title = f"<caption>{self._text(caption)}</caption>" if caption else ""
        # what is wider than the window is scrolled with keys, too
        label = self._text(caption) or ", ".join(self._text(c) for c in columns if c)
        self._body.append(
            f'<div class="wide" tabindex="0" role="group" aria-label="{label}">'
            f"<table>{title}<thead><tr>{head}</tr></thead>"
            f"<tbody>{body}</tbody></table></div>"
        )

    def _cell(self, value: str | float | None, decimals: int) -> str:
        if isinstance(value, str):
            text = self._text(value)
            # a file's name may be broken anywhere, a number or a word may not
            return (
                f"<td{_LONG if max(map(len, text.split()), default=0) > _WORD else ''}>{text}</td>"
            )
        return f"<td{_NUMBER}>{escape(_text(value, decimals))}</td>"

    def figure(self, figure: Figure, caption: str = "") -> None:
        """Add a Plotly figure (see `abbe.compcore.figures.figure`)."""
        name = f"figure-{len(self._figures) + 1}"
        figure = named_in(figure, self._language)
        self._figures[name] = plain(figure)
        text = f"<figcaption>{self._text(caption)}</figcaption>" if caption else ""
        in_space = any(_in_space(trace) for trace in figure["data"])
        space, drawing = (" data-space", still(figure)) if in_space else ("", "")
        height = figure["layout"].get("height", _HEIGHT)
        self._body.append(
            f'<figure data-plot="{name}"{space}><div style="min-height:{height}px"></div>'
            f"{drawing}{text}</figure>"
        )

    def figures(self, figures: Sequence[tuple[Figure, str]]) -> None:
        """Add small figures with their captions side by side, as many as there is room for."""
        self._body.append('<div class="panels">')
        for each, caption in figures:
            self.figure(each, caption)
        self._body.append("</div>")

    def html(self) -> str:
        """The whole page; on paper each sheet says in its margin what made it."""
        made = self._language.say(
            said("Made by Abbe {version}, {at}", version=abbe_version(), at=self._made)
        )
        margin = f'@page {{ @bottom-left {{ content: "{made}"; font-size: 8pt; color: #555 }} }}'
        parts = [
            "<!DOCTYPE html>",
            f'<html lang="{self._language.code}"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f'<meta name="generator" content="Abbe {abbe_version()}">',
            f"<title>{escape(self._title)}</title><style>{STYLE}{margin}</style>",
            "</head><body><main>",
            f"<header><h1>{escape(self._title)}</h1>",
            f"<p>{escape(self._subtitle)}</p>" if self._subtitle else "",
            "</header>",
            "" if self._head is None else self._head.html(self._language.say),
            *self._body,
            f"</main><footer>{made}</footer>",
        ]
        if self._figures:
            parts.append(packed_pictures(self._figures))
        parts.append("</body></html>")
        return "\n".join(parts)

    def write(self, path: str | Path) -> None:
        """Write the page to a file, whole or not at all.

        Raises
        ------
        InputError
            When the file cannot be written.
        """
        write_atomically(path, self.html())


_NUMBER = ' class="number"'
_LONG = ' class="long"'
_WORD = 16
"""Letters of a word that is never broken: *eingehalten*."""
_MOST = 9
"""Decimals at the most."""


def _decimals(column: Sequence[str | float | None], digits: int) -> int:
    greatest = max((abs(v) for v in column if isinstance(v, float) and isfinite(v)), default=0.0)
    # what only a row of zeros could show is nothing
    return max(0, digits - 1 - floor(log10(greatest))) if greatest > 0.5 * 10.0**-_MOST else 0


def _text(value: str | float | None, decimals: int) -> str:
    if isinstance(value, str):
        return value
    if value is None or not isfinite(value):
        return "–"
    text = str(value) if isinstance(value, int) else f"{value:z.{min(decimals, _MOST)}f}"
    return text.replace("-", "−")


Cell = str | float | int | None
"""What stands in a table; None becomes a dash."""


def in_words(rows: Sequence[Sequence[Cell]], digits: int = 4) -> list[list[str]]:
    """The cells of a table as `Page.table` writes them: a column has the same decimals."""
    if not rows:
        return []
    decimals = [_decimals([row[i] for row in rows], digits) for i in range(len(rows[0]))]
    return [[_text(v, d) for v, d in zip(row, decimals, strict=True)] for row in rows]


def number(value: float, digits: int = 4) -> str:
    """A number for people: significant digits, a true minus sign.

    >>> number(-12.34567), number(0.0)
    ('−12.35', '0')
    >>> number(4664.2, 3)
    '4664'
    """
    return in_digits(value, digits).replace("-", "−")


def typeset(text: str) -> str:
    """A text of a terminal with true minus signs before its numbers.

    >>> typeset("-4.2 ± 1.1 of -X, 2026-11-26, 01_laser-2")
    '−4.2 ± 1.1 of -X, 2026-11-26, 01_laser-2'
    """
    if isinstance(text, Sentence):
        return text.rewritten(typeset)
    return _MINUS.sub("−", text)


def named_in(figure: Figure, language: PageLanguage) -> Figure:
    """A figure whose curves and axes are named in a language."""
    data = [{**t, "name": language.say(t["name"])} if t.get("name") else t for t in figure["data"]]
    layout = dict(figure["layout"])
    for key, part in layout.items():
        if key[1:].startswith("axis") and isinstance(part.get("title"), Mapping):
            title = part["title"]
            layout[key] = {**part, "title": {**title, "text": language.say(title.get("text", ""))}}
    return {**figure, "data": data, "layout": layout}


def _in_space(trace: Mapping[str, Any]) -> bool:
    kind = str(trace.get("type", "scatter"))
    return kind.endswith("3d") or kind in ("surface", "cone", "volume", "isosurface")


def plain(value: Any) -> Any:
    """Arrays to lists, what is not finite to null: gaps in a curve."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
