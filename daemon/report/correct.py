"""The page of ``abbe correct --report``: one point, and who contributes how many µm."""

from __future__ import annotations

import numpy as np

from abbe.compcore.figures.figure import figure
from abbe.compcore.model.uncertainty import expanded
from abbe.compcore.units import in_digits
from abbe.daemon.answers.correct import NO_LINEAR_AXIS, Corrected
from abbe.daemon.arguments.effect_name import short
from abbe.daemon.report.head import PageHead
from abbe.daemon.report.page import Page

_SMALL = 1e-6
"""mm: parts below this are gathered."""


def corrected_page(found: Corrected, warnings: list[str], title: str, head: PageHead) -> Page:
    """The whole page.

    Parameters
    ----------
    found
        The point and its parts.
    warnings
        What makes the answer doubtful.
    title
        The machine's name.
    head
        Which machine, measured when, and which files.
    """
    page = Page(f"{title or 'Machine'}: one point corrected", head=head)
    wide: dict[str, str] = {}
    if found.sure is not None:
        wide = {a: f" ± {v * 1e3:.2f}" for a, v in expanded(found.sure).items()}
    page.key_figures(
        [
            (f"correction in {a}", f"{found.correction(a) * 1e3:+.2f}{wide.get(a, '')}", "µm")
            for a in found.carrying
        ]
    )
    if staying := found.staying:
        page.key_figures(
            [
                (f"error in {a}, where no axis moves", f"{e * 1e3:+.2f}{wide.get(a, '')}", "µm")
                for a, e in staying.items()
            ]
        )
    if found.left is not None:
        page.key_figures(
            [("direction of the tool left", f"{found.left.direction * 1e6:.2f}", "µrad")]
        )
    if not found.carrying and not found.command:
        page.notes([NO_LINEAR_AXIS])
    if warnings:
        page.notes(warnings, warning=True)
    heads = ("target", "command") if found.command else ("indicated", "corrected")
    page.section("The point")
    page.table(
        ["Axis", f"{heads[0]}, mm (rotary: °)", f"{heads[1]}, mm (rotary: °)"],
        [[axis, f"{q:.5f}", f"{found.answer[axis]:.5f}"] for axis, q in found.asked.items()],
    )
    page.section("Who contributes how much")
    parts = {short(spec): part for spec, part in found.parts.items()}
    shown = {k: v for k, v in parts.items() if max(map(abs, v)) >= _SMALL}
    shown = dict(sorted(shown.items(), key=lambda item: max(map(abs, item[1]))))
    # a slit has an error in X alone: no Y and Z of zeros
    every = np.array([*parts.values(), found.second_order])
    directions = [
        (i, a)
        for i, a in enumerate("XYZ")
        if a in found.carrying or np.abs(every[:, i]).max() > _SMALL
    ]
    traces = [
        {
            "type": "bar",
            "orientation": "h",
            "name": axis,
            "y": list(shown),
            "x": [part[i] * 1e3 for part in shown.values()],
        }
        for i, axis in directions
    ]
    page.figure(
        figure(
            traces,
            "part of the error (actual − indicated), µm",
            height=max(300, 60 + 34 * len(shown)),
            barmode="group",
        ),
        "Each effect's part of the error at this point, largest on top. The parts sum to the "
        f"error there{_second_order(found)}.",
    )
    page.table(
        ["Effect", *(f"{a}, µm" for _, a in directions)],
        [
            [spec, *(f"{part[i] * 1e3:+.3f}" for i, _ in directions)]
            for spec, part in reversed(shown.items())
        ],
    )
    return page


def _second_order(found: Corrected) -> str:
    largest = max(map(abs, found.second_order))
    return "" if largest < _SMALL else f" but for {in_digits(largest * 1e6, 2)} nm of second order"
