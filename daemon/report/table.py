"""The page of ``abbe table --report``: what remains of the error, the tables, and their record."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from abbe.compcore.figures.figure import COLOURS, figure, line, points
from abbe.compcore.model.uncertainty import UNKNOWN
from abbe.compcore.tables.remainder import Remainder
from abbe.compcore.tables.table import Table, unit_of_position
from abbe.daemon.answers.tables.make import FULL, NONE, TableAnswer
from abbe.daemon.answers.tables.words import remaining_rows, trust_lines
from abbe.daemon.report.head import FileOnPage, head_of
from abbe.daemon.report.page import Cell, Figure, Page, number

HELD_COLUMNS = ["Table", "Points", "From", "To", "Directions", "Largest", "Unit"]
_GREY = "#9aa4ae"
_MOST = 1200
"""Points drawn of the working volume."""


def table_page(done: TableAnswer) -> Page:
    """The whole page."""
    controller, record = done.request.controller, done.made.record
    machine = done.model.machine
    model = FileOnPage("model", record["model"]["file"], record["model"]["sha256"])
    page = Page(
        f"{machine.name or 'Machine'}: tables for {controller.name}",
        f"made {record['made']} by {record['by'] or 'unknown'}",
        head_of(done.model, [model]),
    )
    key = [
        (name, number(left.largest * 1e3, 3), "µm largest") for name, left in remaining_rows(done)
    ]
    sure = record["uncertainty"]
    if sure is not None:
        wide = f"µm largest (k = {sure['k']:g})"
        key.append(("how sure the model is", f"± {number(sure['largest'], 3)}", wide))
    page.key_figures(key)
    if sure is None:
        page.notes([f"How sure the model is: {UNKNOWN}"], warning=True)
    page.text(f"Sign of the numbers: {controller.sign}.")
    page.notes(list(trust_lines(controller)), warning=controller.trust.least == "unverified")
    page.notes(done.notes)
    page.section("What remains")
    page.text(
        "The length of the error vector over the working volume, up to a shift of the whole (ISO "
        "230-1, 3.8.3), as the model predicts it."
    )
    _remaining(page, done)
    page.section("Tables")
    page.table(HELD_COLUMNS, held_rows(record))
    for each in table_curves(done.made.tables):
        page.figure(each)
    page.section("At the controller")
    page.notes(controller.activation())
    _conditions(page, done)
    return page


def held_rows(record: Mapping[str, Any]) -> list[list[Cell]]:
    """Each table of a record in a row: where it lies, how large it is."""
    return [
        [
            row["table"], "×".join(map(str, row["points"])), _list(row["from"]),
            _list(row["to"]), row["directions"], row["largest"],
            row["unit"].replace("u", "µ", 1),
        ]
        for row in record["tables"]
    ]  # fmt: skip


def _list(values: Sequence[float]) -> str:
    return ", ".join(number(v) for v in values)


def _remaining(page: Page, done: TableAnswer) -> None:
    rows = remaining_rows(done)
    names = [name for name, _ in rows]
    bars = [
        {
            "type": "bar",
            "orientation": "h",
            "y": names,
            "x": [getattr(left, key) * 1e3 for _, left in rows],
            "name": key,
            "marker": {"color": colour},
        }
        for key, colour in (("largest", _GREY), ("rms", COLOURS[0]))
    ]
    height = 90 + 60 * len(rows)
    upwards = {"autorange": "reversed"}
    page.figure(figure(bars, "µm", height=height, barmode="group", yaxis=upwards))
    page.table(
        ["", "largest, µm", "95 %, µm", "rms, µm", "shift X, Y, Z, µm"],
        [
            [
                n,
                r.largest * 1e3,
                r.p95 * 1e3,
                r.rms * 1e3,
                _list([round(float(s) * 1e3, 2) for s in r.shift]),
            ]
            for n, r in rows
        ],
        digits=3,
    )
    axes = done.model.machine.structure.axes
    for each in where_left(axes, done.remaining, done.request.controller.name):
        page.figure(each)


def where_left(
    axes: Sequence[str], remaining: Mapping[str, Remainder], controller: str
) -> Iterator[Figure]:
    """What is left of the error along each axis: without tables, with them, with full ones."""
    colours = {NONE: _GREY, controller: COLOURS[0], FULL: COLOURS[2]}
    for axis in axes:
        unit, factor = unit_of_position(axis)
        clouds = []
        for key, left in remaining.items():
            if key in colours:
                every = max(1, len(left.errors) // _MOST)
                length = np.linalg.norm(left.errors, axis=1)[::every] * 1e3
                where = left.positions[axis][::every] * factor
                marker = {"size": 4, "color": colours[key], "opacity": 0.55}
                clouds.append(points(where, length, key, marker=marker))
        unit = "°" if unit == "deg" else unit
        yield figure(clouds, f"{axis}, {unit}", "left of the error, µm", height=320)


def table_curves(tables: Sequence[Table]) -> Iterator[Figure]:
    """What the tables over single axes hold, a picture for each axis and unit."""
    for axis in dict.fromkeys(t.inputs[0] for t in tables if len(t.inputs) == 1):
        unit, factor = unit_of_position(axis)
        for of in ("error, µm", "error, µrad", "error, µm per m of the lever"):
            traces = []
            mine = [t for t in tables if t.inputs == (axis,) and _what(t) == of]
            for i, table in enumerate(mine):
                scale = 1e3 if of == "error, µm" else 1e6
                where = table.nodes[0] * factor
                colour = {"color": COLOURS[i % len(COLOURS)]}
                name = f"{table.name} (+)" if table.directional else table.name
                traces.append(
                    line(where, table.forward * scale, name, mode="lines+markers", line=colour)
                )
                if table.directional:
                    dashed = {**colour, "dash": "dot"}
                    traces.append(
                        line(where, table.downward * scale, f"{table.name} (−)", line=dashed)
                    )
            if traces:
                shown = "°" if unit == "deg" else unit
                yield figure(traces, f"{axis}, {shown}", of, height=360)


def _what(table: Table) -> str:
    if table.lever is not None:
        return "error, µm per m of the lever"
    return "error, µrad" if table.output.rotation else "error, µm"


def _conditions(page: Page, done: TableAnswer) -> None:
    page.section("Record (ISO/TR 16907, 9.1)")
    record = done.made.record
    conditions, model = record["conditions"], record["model"]
    rows: list[list[str | float | None]] = [
        ["model", model["file"], f"SHA-256 {model['sha256']}"],
        ["structure", model["structure"], ""],
        ["fitted", model["fit"].get("date", "not recorded"), model["fit"].get("abbe", "")],
        ["tool", ", ".join(f"{v:g}" for v in conditions["tool_mm"]), "mm"],
        ["looked up at", conditions["looked_up_at"], "position"],
    ]
    rows += [[n, s["value"], s["unit"]] for n, s in conditions["signals"].items()]
    rows += [
        [f"volume {a}", f"{v['from']:g} … {v['to']:g}", v["unit"]]
        for a, v in conditions["volume"].items()
    ]
    rows += [
        [f"active while measured: {name}", f"SHA-256 {digest}", ""]
        for name, digest in record["active_while_measured"].items()
    ]
    rows += [[f"file {n}", f"SHA-256 {d}", ""] for n, d in done.made.checksums.items()]
    page.table(["", "", ""], rows)
