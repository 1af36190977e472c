"""What the page *Compare* shows: the answer of ``abbe compare``, and every row for its pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.compare import Comparison
from abbe.compcore.comparison.tabulate import ResidualGroup
from abbe.compcore.comparison.words import fitted_note
from abbe.daemon.report.model.compare import key_figures, told_apart, verdict_title, where_of
from abbe.daemon.report.page import Cell, in_words, plain
from abbe.daemon.workbench.residuals.brush import ManyResiduals
from abbe.daemon.workbench.residuals.rows import panels, rows_json, shown_rows, values_json


def compared(comparison: Comparison) -> tuple[dict[str, Any], ManyResiduals | None]:
    """One object for the page, lengths µm, angles µrad; where not all rows are drawn, all rows."""
    problem = comparison.problem
    campaign, machine = problem.campaign, problem.model.machine
    rows = shown_rows(campaign, comparison.residual)
    sides = [(s.axis, s.component) for s in comparison.sides]
    # the last sentence says what to type next: here that is a button
    sentences = [s for s in comparison.verdict() if not s.startswith("next: ")]
    fitted = comparison.fitted_files
    pictures = panels(campaign, rows, comparison.residual, sides)
    listed = list(_tables(comparison))
    many = None
    if len(rows) < np.isfinite(comparison.residual).sum():
        selects = [table["select"] for table in listed]
        many = ManyResiduals(campaign, machine, comparison.residual, pictures, rows, selects)
    found: dict[str, Any] = {
        "title": verdict_title(comparison),
        "holds": comparison.holds,
        "open": comparison.uncertainty.open,
        "verdict": sentences,
        "suspicions": list(comparison.suspicions),
        "fitted": fitted_note(fitted) if fitted else "",
        "unfitted": bool(problem.model.terms) and not any(t.fitted for t in problem.model.terms),
        "notes": list(comparison.noise.words()),
        "key": [list(figure) for figure in key_figures(comparison)],
        "rows": rows_json(campaign, machine, rows),
        "values": values_json(campaign, rows, comparison.residual),
        "of": campaign.n,
        "panels": pictures,
        "cells": None if many is None else many.pictures(),
        "tables": listed,
    }
    answer: dict[str, Any] = plain(found)
    return answer, many


def _tables(comparison: Comparison) -> Iterator[dict[str, Any]]:
    campaign = comparison.problem.campaign
    for k, (part, unit, factor) in enumerate(
        ((comparison.lengths, "µm", 1e3), (comparison.rotations, "µrad", 1e6))
    ):
        if not part.n:
            continue
        worst: list[list[Cell]] = [
            [
                PurePath(campaign.file_of(p.row)).name,
                int(p.line),
                p.setup,
                p.residual * factor,
                p.sd * factor,
            ]
            for p in part.worst
        ]
        yield {
            "title": "Worst points",
            "part": k,
            "columns": ["File", "Line", "Set-up", f"residual, {unit}", "its uncertainty"],
            "cells": in_words(worst, 3),
            "select": [{"row": p.row} for p in part.worst],
        }
        for title, groups in told_apart(comparison, part):
            yield {
                "title": title,
                "part": k,
                "columns": ["", "n", f"rms, {unit}", f"largest, {unit}", f"mean, {unit}"],
                "cells": in_words(
                    [[where_of(g, rotations=bool(k)), g.n, g.rms, g.max, g.mean] for g in groups], 3
                ),
                "select": [_selected(g, k, groups) for g in groups],
            }


def _file(campaign: Campaign, row: int) -> str:
    """Which file a row is of; where that lies stands on no page."""
    return PurePath(campaign.file_of(row)).name


def _selected(group: ResidualGroup, part: int, groups: Sequence[ResidualGroup]) -> dict[str, Any]:
    """What makes a row one of a group; only the `last` of its kind has its upper end, too."""
    of = dict(group.of)
    if "to" in of:
        kind = (of.get("axis"), of.get("signal"))
        ends = [g.of["to"] for g in groups if (g.of.get("axis"), g.of.get("signal")) == kind]
        of["last"] = of["to"] == max(ends)
    return {"part": part, **of}
