"""The page of ``abbe compare --report``: how wrong, and where."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

from abbe.compcore.campaign.noise import NoiseLevel
from abbe.compcore.campaign.sampling import sampling_words
from abbe.compcore.comparison.compare import Comparison
from abbe.compcore.comparison.parts import ComparedRows
from abbe.compcore.comparison.tabulate import ResidualGroup
from abbe.compcore.comparison.words import clock_words, fitted_note, known_waves
from abbe.compcore.figures.figure import Figure
from abbe.compcore.figures.residuals import MOST_POINTS
from abbe.compcore.sentences import said
from abbe.daemon.report.head import PageHead
from abbe.daemon.report.page import Page, number
from abbe.daemon.report.versions import error_of_versions

_MOST_ROWS = 40


def comparison_page(comparison: Comparison, head: PageHead) -> Page:
    """The whole page."""
    problem = comparison.problem
    machine = problem.model.machine
    subtitle = f"{machine.name or 'Machine'}: model beside measurements"
    page = Page(verdict_title(comparison), subtitle, head)
    _verdict(page, comparison)
    page.key_figures(key_figures(comparison))
    if fitted := comparison.fitted_files:
        page.notes([fitted_note(fitted)], warning=True)
    page.notes(list(comparison.noise.words()))
    page.notes(list(sampling_words(problem.campaign, known_waves(problem.model))))
    page.notes(
        [
            f"Left out: {spec}; it belongs to a placing of the instrument in another campaign."
            for spec in comparison.left_out
        ],
        warning=True,
    )
    page.notes(list(clock_words(comparison.other_day, comparison.same_day)), warning=True)
    if problem.model.history and (
        versions := error_of_versions([*problem.model.history, problem.model.fit])
    ):
        page.section("Versions of the model")
        page.figure(versions)
    for part, name, unit in (
        (comparison.lengths, "Lengths", "µm"),
        (comparison.rotations, "Rotations", "µrad"),
    ):
        if part.n:
            page.section(name)
            _pictures(page, comparison, part)
            _tables(page, comparison, part, unit)
    if comparison.lines:
        page.section("Lines")
        page.text(
            "Each straight line's error, split into what grows evenly with length (temperature, "
            "scale, squareness) and the rest (the form of guideways and scales)."
        )
        ordered = sorted(comparison.lines, key=lambda entry: -entry.rest_before)
        page.figure(comparison.figures()["lines"]())
        page.table(
            ["Set-up", "Length, mm", "linear before, µm", "after", "rest before, µm", "after"],
            [
                [
                    entry.setup,
                    entry.length,
                    _um(entry.linear_before),
                    _um(entry.linear_after),
                    entry.rest_before * 1e3,
                    entry.rest_after * 1e3,
                ]
                for entry in ordered
            ],
            digits=3,
        )
    return page


def verdict_title(comparison: Comparison) -> str:
    """Whether the model holds, and if not, the most that is wrong, in the shop's words."""
    if comparison.sides and (comparison.uncertainty.open or not comparison.holds):
        return comparison.sides[0].short
    if comparison.uncertainty.open:
        return said("What the model leaves of the measurements")
    return said("The model holds") if comparison.holds else said("The model does not hold")


def _verdict(page: Page, comparison: Comparison) -> None:
    """What the reader came for, and what to do next."""
    page.notes(list(comparison.verdict()), warning=not comparison.holds)


def key_figures(comparison: Comparison) -> list[tuple[str, str, str]]:
    """Label, value and unit of what the reader came for."""
    figures = []
    for part, name, unit, factor, kinds in (
        (comparison.lengths, "lengths", "µm", 1e3, ("displacement", "distance")),
        (comparison.rotations, "rotations", "µrad", 1e6, ("rotation",)),
    ):
        if not part.n:
            continue
        figures += [
            (f"{name}, rms", number(part.rms * factor, 3), unit),
            ("95 % within", number(part.p95 * factor, 3), unit),
            ("largest", number(part.max * factor, 3), unit),
        ]
        if math.isfinite(part.chi2_per_dof) and not comparison.estimated(part):
            figures.append(("χ² per degree of freedom", number(part.chi2_per_dof, 3), ""))
        level = _known(comparison, kinds)
        if level is not None and level.value is not None:
            figures.append(("noise floor", number(level.value * factor, 3), unit))
    return figures


def _known(comparison: Comparison, kinds: tuple[str, ...]) -> NoiseLevel | None:
    levels = (comparison.noise.levels.get(kind) for kind in kinds)
    return next((level for level in levels if level is not None), None)


def _pictures(page: Page, comparison: Comparison, part: ComparedRows) -> None:
    if part.n > MOST_POINTS:
        page.text(f"The pictures show {MOST_POINTS} of {part.n} rows, the largest all.")
    what = "rotations" if part is comparison.rotations else "residuals"
    draw_residuals(page, comparison.figures(), what)


_PARTS = (
    (
        "In the volume",
        ("in the volume",),
        "Each vector stands where the axes stood, along the measured direction, enlarged.",
    ),
    ("Along each axis", ("along ",), ""),
    ("Against signals and time", ("against ", "over time"), ""),
    (
        "Beside chance",
        ("beside chance",),
        "On the dashed line where residuals are normal noise of the stated size.",
    ),
)


def draw_residuals(page: Page, figures: Mapping[str, Callable[[], Figure]], what: str) -> None:
    """All pictures of ``residuals`` or ``rotations`` among those of a result."""
    for heading, starts, caption in _PARTS:
        begins = tuple(f"{what} {start}" for start in starts)
        own = [make for name, make in figures.items() if name.startswith(begins)]
        if own:
            page.subsection(heading)
        for make in own:
            page.figure(make(), caption)


def _tables(page: Page, comparison: Comparison, part: ComparedRows, unit: str) -> None:
    page.subsection("Told apart")
    for title, groups in told_apart(comparison, part):
        page.table(
            ["", "n", f"rms, {unit}", f"largest, {unit}", f"mean, {unit}"],
            [[where_of(g, rotations=unit == "µrad"), g.n, g.rms, g.max, g.mean] for g in groups],
            caption=title,
            digits=3,
        )
    campaign = comparison.problem.campaign
    factor = 1e6 if unit == "µrad" else 1e3
    page.table(
        ["Line of the file", "Set-up", f"residual, {unit}", "its uncertainty"],
        [[int(p.line), p.setup, p.residual * factor, p.sd * factor] for p in part.worst],
        caption=f"Worst points of {campaign.name}",
        digits=3,
    )


def told_apart(
    comparison: Comparison, part: ComparedRows
) -> Iterator[tuple[str, list[ResidualGroup]]]:
    """Titles, and the residuals of one kind told apart, the worst groups first."""
    for title, groups in (
        ("Side of approach, by what was measured", comparison.by_side(part)),
        ("Set-ups", part.tables.setups),
        ("Regions of the axes", part.tables.regions),
        ("Tools", part.tables.tools),
        ("Signals, in parts with equal numbers of rows", part.tables.signals),
        ("Time, s", part.tables.time),
    ):
        if groups:
            yield f"{title}, worst first", sorted(groups, key=lambda g: -g.rms)[:_MOST_ROWS]


def where_of(group: ResidualGroup, *, rotations: bool = False) -> str:
    """What some rows have in common, in words."""
    parts = dict(group.of)
    if "from" in parts and "to" in parts:
        ends = f"{number(parts.pop('from'))} … {number(parts.pop('to'))}"
        return " ".join([*(str(v) for v in parts.values()), ends])
    if "direction" in parts:
        side = f"{parts['axis']} {'towards plus' if parts['direction'] > 0 else 'towards minus'}"
        measured = parts["measured"]
        how = f"{'about' if rotations else 'in'} {measured}"
        return f"{side}, measured {'obliquely' if measured == 'oblique' else how}"
    return " ".join(
        ", ".join(number(x) for x in v) if isinstance(v, list) else str(v) for v in parts.values()
    )


def _um(value: float | None) -> float | None:
    return None if value is None else value * 1e3
