"""``python -m tools.house_picture``: docs/images/house.svg, the rooms of the house in one picture.

Imports go downwards only. The numbered discs are the two walks of docs/architecture.md.
"""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import NamedTuple

from abbe.compcore.files.text.atomic import write_atomically

FILE = Path(__file__).resolve().parent.parent / "docs" / "images" / "house.svg"
TITLE = "The house of Abbe: daemon above drivers above compcore, and the rooms of each"

Rooms = tuple[tuple[str, str], ...]
"""(room, what it holds)."""

DAEMON: tuple[Rooms, ...] = (
    (
        ("commands", "one file each"),
        ("arguments", "what is typed"),
        ("answers", "text and JSON"),
        ("report", "HTML pages"),
        ("show", "live screens"),
        ("demo", "all at once"),
        ("workbench", "in a browser"),
    ),
    (
        ("measure", "plans, measured"),
        ("upload", "tables, safely"),
        ("table_watch", "tables made anew"),
        ("checks", "still true?"),
        ("records", "what was"),
        ("spreading", "work, to many"),
        ("fleet", "a plant's store"),
    ),
    (
        ("control", "by a person"),
        ("status", "what it says"),
        ("http", "over a network"),
        ("mqtt", "to a broker"),
        ("opcua_server", "for SCADA"),
        ("side_process", "beside a run"),
        ("systemd", "as a service"),
    ),
    (
        ("pipeline", "read, correct, write"),
        ("guard", "what may go out"),
        ("config", "loaded, checked"),
        ("ownership", "one at a time"),
        ("calibration", "its steps, its state"),
    ),
)
DRIVERS: tuple[Rooms, ...] = (
    (
        ("modbus", "TCP, RTU"),
        ("serial", "ASCII lines"),
        ("can", "DBC, CANopen"),
    ),
    (
        ("linuxcnc", "HAL"),
        ("ipp", "I++ DME"),
        ("opcua", "OPC UA"),
        ("mtconnect", "MTConnect"),
    ),
    (
        ("transducers", "counts, ohms → mm, °C"),
        ("controllers", "tables' dialects"),
        ("programs", "targets as NC"),
        ("stores", "tables' places"),
        ("simulated", "to try on"),
    ),
)
COMPCORE: tuple[Rooms, ...] = (
    (("virtual_cmm", "how sure a part is measured"),),
    (
        ("planning", "what to measure"),
        ("verification", "lines that were not fitted"),
        ("fleet", "machines of a type"),
        ("monitoring", "is the model still true?"),
    ),
    (
        ("tables", "what controllers hold"),
        ("diagnosis", "what is missing"),
        ("comparison", "how wrong, where"),
        ("iso10791", "tests of rotary axes"),
    ),
    (
        ("maps", "CMMs' own maps"),
        ("fitting", "parameters from measurements"),
        ("compensator", "errors at the machine's pace"),
    ),
    (
        ("artefacts", "gauge blocks, plates, ISO 10360"),
        ("figures", "pictures of results, as data"),
    ),
    (("model", "machine + effects + parameters ± sd"),),
    (
        ("effects", "one physical cause, one class"),
        ("iso230", "evaluation of lines"),
    ),
    (("campaign", "measurements, and their noise"),),
    (("machine", "axes, error motions, the lever rule"),),
)
"""Floor by floor, the highest first; a room imports from floors below its own."""
FILES = ("files", "read and write")
"""Stands beside all floors of compcore: it imports from any of them, and none from it."""

COUNT = {
    "modbus": "1 2 9",
    "pipeline": "3 5 8",
    "transducers": "4",
    "compensator": "6",
    "guard": "7",
}
"""Room → its steps of the first walk."""
ROW = {
    "commands": "1",
    "files": "2",
    "campaign": "3",
    "effects": "4",
    "machine": "5",
    "fitting": "6",
    "diagnosis": "7 8 9",
    "answers": "10",
}
"""Room → its steps of the second walk."""

_STYLE = """
text{font:13px system-ui,sans-serif;fill:#1f2933}
.ground{fill:#fff}
.top{font-weight:600;font-size:15px}
.small{font-size:11px;fill:#52606d}
.outside{fill:#f5f7fa;stroke:#9aa5b1;stroke-dasharray:4 3}
.daemon{fill:#e8f1fb}.drivers{fill:#eaf6ec}.compcore{fill:#fdf3e1}
.room{fill:#fff;stroke:#7b8794}
.count{fill:#c2410c}.row{fill:#1d4ed8}
.disc{fill:#fff;font-size:10px;font-weight:600}
.arrow{stroke:#7b8794;stroke-width:1.5;fill:none;marker-end:url(#tip)}
"""
_WIDTH = 960
_LEFT, _RIGHT = 150, 930
_ROOM, _GAP = 46, 10


class Box(NamedTuple):
    """A rectangle, pixels."""

    x: float
    y: float
    width: float
    height: float


def svg() -> str:
    """The picture."""
    parts: list[str] = []
    y = 16.0
    tops: dict[str, float] = {}
    for name, words, floors in (
        ("daemon", "the service and the command line", DAEMON),
        ("drivers", "the outside world, one plugin each", DRIVERS),
        ("compcore", "the mathematics: no clocks, no threads, no network", COMPCORE),
    ):
        height = 34.0 + len(floors) * (_ROOM + _GAP) + 2.0
        parts.append(_rect(Box(_LEFT, y, _RIGHT - _LEFT, height), name, 8))
        parts.append(_text(_LEFT + 14, y + 21, name, "top"))
        parts.append(_text(_LEFT + 112, y + 21, words, "small"))
        tops[name] = y
        left = _LEFT + 12.0
        if name == "compcore":
            tall = len(floors) * (_ROOM + _GAP) - _GAP
            parts.append(_room(Box(left, y + 34, 116, tall), *FILES))
            left += 116.0 + _GAP
        for i, rooms in enumerate(floors):
            parts += _floor(rooms, y + 34.0 + i * (_ROOM + _GAP), left)
        y += height + 26.0
        if name != "compcore":
            parts.append(_arrow([(540, y - 25), (540, y - 3)]))
            parts.append(_text(552, y - 9, "imports", "small"))
    parts += _outside(tops)
    legend = y + 4.0
    parts.append(_disc(_LEFT + 8, legend, "1", "count"))
    parts.append(_text(_LEFT + 22, legend + 4, "a count on its way to the corrected position"))
    parts.append(_disc(_LEFT + 328, legend, "1", "row"))
    parts.append(_text(_LEFT + 342, legend + 4, "a measured row on its way to the verdict"))
    height = legend + 18.0
    body = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height:g}" '
        f'width="{_WIDTH}" height="{height:g}" role="img">\n<title>{escape(TITLE)}</title>\n'
        f"<style>{_STYLE}</style>\n"
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto-start-reverse"><path d="M0 0L8 4L0 8z" fill="#7b8794"/>'
        "</marker></defs>\n"
        f'<rect class="ground" width="{_WIDTH}" height="{height:g}"/>\n{body}\n</svg>\n'
    )


def _floor(rooms: Rooms, y: float, left: float) -> list[str]:
    width = (_RIGHT - 12.0 - left - _GAP * (len(rooms) - 1)) / len(rooms)
    return [
        _room(Box(left + i * (width + _GAP), y, width, _ROOM), name, words)
        for i, (name, words) in enumerate(rooms)
    ]


def _room(box: Box, name: str, words: str) -> str:
    parts = [_rect(box, "room", 4)]
    parts.append(_text(box.x + 9, box.y + 19, name))
    parts.append(_text(box.x + 9, box.y + 36, words, "small"))
    right = box.x + box.width - 12.0
    for steps, css in ((ROW, "row"), (COUNT, "count")):
        for step in reversed(steps.get(name, "").split()):
            parts.append(_disc(right, box.y + 13, step, css))
            right -= 19.0
    return "\n".join(parts)


def _outside(tops: dict[str, float]) -> list[str]:
    """Who is met outside the house, and where its door is."""
    met = (
        (tops["daemon"] + 34, "people", ("at a terminal",)),
        (tops["drivers"] + 34, "machine", ("its controller",)),
        (tops["compcore"] + 34, "disk", ("models, rows,", "tables, maps")),
    )
    parts = []
    for y, name, lines in met:
        parts.append(_rect(Box(10, y, 112, 34.0 + 16.0 * len(lines)), "outside", 4))
        parts.append(_text(19, y + 20, name))
        parts += [_text(19, y + 38 + 16 * i, words, "small") for i, words in enumerate(lines)]
        parts.append(_arrow([(124, y + 25), (148, y + 25)], both=True))
    return parts


def _rect(box: Box, css: str, radius: int) -> str:
    x, y, width, height = (f"{v:.1f}" for v in box)
    return f'<rect class="{css}" x="{x}" y="{y}" width="{width}" height="{height}" rx="{radius}"/>'


def _text(x: float, y: float, words: str, css: str = "") -> str:
    look = f' class="{css}"' if css else ""
    return f'<text{look} x="{x:.1f}" y="{y:.1f}">{escape(words)}</text>'


def _disc(x: float, y: float, step: str, css: str) -> str:
    return (
        f'<circle class="{css}" cx="{x:.1f}" cy="{y:.1f}" r="8.5"/>'
        f'<text class="disc" x="{x:.1f}" y="{y + 3.5:.1f}" text-anchor="middle">{step}</text>'
    )


def _arrow(points: list[tuple[float, float]], *, both: bool = False) -> str:
    path = "L".join(f"{x:g} {y:g}" for x, y in points)
    start = ' marker-start="url(#tip)"' if both else ""
    return f'<path class="arrow" d="M{path}"{start}/>'


if __name__ == "__main__":
    write_atomically(FILE, svg())
