"""The page of ``abbe correct --report``: one point, and who contributes how many µm."""

from __future__ import annotations

from abbe.compcore.figures.figure import figure
from abbe.compcore.model.uncertainty import expanded
from abbe.compcore.units import in_digits
from abbe.daemon.answers.correct import Corrected
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
    if found.beside:
        page.key_figures(
            [
                (f"stays in {a}, no axis", f"{e * 1e3:+.2f}{wide.get(a, '')}", "µm")
                for a, e in found.beside.items()
            ]
        )
    if found.left is not None:
        page.key_figures(
            [("direction of the tool left", f"{found.left.direction * 1e6:.2f}", "µrad")]
        )
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
    traces = [
        {
            "type": "bar",
            "orientation": "h",
            "name": axis,
            "y": list(shown),
            "x": [part[i] * 1e3 for part in shown.values()],
        }
        for i, axis in enumerate("XYZ")
    ]
    page.figure(
        figure(
            traces,
            "part of the error (actual − indicated), µm",
            height=max(300, 60 + 34 * len(shown)),
            barmode="group",
        ),
        "Each effect's part of the error at this point, largest on top. The parts sum to the "
        f"correction{' with its sign turned' if found.command else ''} but for "
        f"{in_digits(max(map(abs, found.second_order)) * 1e6, 2)} nm of second order.",
    )
    page.table(
        ["Effect", "X, µm", "Y, µm", "Z, µm"],
        [
            [spec, *(f"{value * 1e3:+.3f}" for value in part)]
            for spec, part in reversed(shown.items())
        ],
    )
    return page
