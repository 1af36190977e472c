"""The page of ``abbe fit --report``: what was found, how surely, and what is left over."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from abbe.compcore.campaign.campaign import LENGTHS, Kind
from abbe.compcore.campaign.noise import NoiseFloor
from abbe.compcore.figures.figure import Figure
from abbe.compcore.figures.motions import plane_of
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.fitting.rigid_body import rigid_body_test
from abbe.compcore.model.as_built import ON_THE_TABLE, reversed_parameters
from abbe.compcore.model.error_map import error_map
from abbe.compcore.model.held_spindle import tool_of
from abbe.compcore.model.model import Model
from abbe.compcore.model.to_enter import average_line_words
from abbe.compcore.units import read_in
from abbe.daemon.report.head import PageHead
from abbe.daemon.report.model.compare import draw_residuals
from abbe.daemon.report.page import Page, number
from abbe.daemon.report.versions import error_of_versions

_FEW = 3
"""An effect with more parameters is a shape, whose coefficients say little one by one."""


def fit_page(result: FitResult, model: Model, noise: NoiseFloor, head: PageHead) -> Page:
    """The whole page; `model` is the fitted model with its history."""
    page = Page(f"{model.machine.name or 'Machine'}: fit", head=head)
    key = []
    for kinds, name, unit, factor in (
        (LENGTHS, "lengths, rms left", "µm", 1e3),
        ((Kind.ROTATION,), "rotations, rms left", "µrad", 1e6),
    ):
        rms = result.rms(*kinds)
        if math.isfinite(rms):
            key.append((name, number(rms * factor, 3), unit))
    key.append(("χ² per degree of freedom", number(result.chi2_per_dof, 3), ""))
    key.append(("degrees of freedom", str(result.dof), ""))
    page.key_figures(key)
    page.notes([str(level) for level in noise.levels.values()])
    if model.history and (versions := error_of_versions([*model.history, model.fit])):
        page.section("Versions of the model")
        page.figure(versions)
    figures = result.figures()
    _motions(page, model, figures)
    page.section("Parameters")
    page.text("Effects of one or two parameters; coefficients of shapes stand at the end.")
    _parameters(page, result, few=True)
    page.notes(list(average_line_words(result.model, tool_of(result.problem.campaign))))
    page.section("What this campaign does not determine")
    page.notes([u.text for u in result.undetermined if not u.convention], warning=True)
    page.notes([u.text for u in result.undetermined if u.convention])
    if not result.undetermined:
        page.text("Nothing: every combination of parameters is determined.")
    _rigid_body(page, result)
    _error_map(page, model, figures)
    _outliers(page, result)
    page.section("Residuals")
    for what in ("residuals", "rotations"):
        if f"{what} beside chance" in figures:
            draw_residuals(page, figures, what)
    page.section("Coefficients of shapes")
    _parameters(page, result, few=False)
    return page


def _motions(page: Page, model: Model, figures: Mapping[str, Callable[[], Figure]]) -> None:
    page.section("Error motions")
    page.text(
        "At the reference temperature, in the chosen frame, with 95 % intervals; "
        "actual − indicated."
    )
    for axis in model.machine.structure.axes:
        if axis in model.machine.structure.workpiece_side:
            page.text(f"{axis}: {ON_THE_TABLE}.")
        for name in (f"error motions of {axis}", f"angular error motions of {axis}"):
            if name in figures:
                page.figure(figures[name]())


def _parameters(page: Page, result: FitResult, *, few: bool) -> None:
    layout = result.problem.layout
    rows: list[list[str | float | None]] = []
    for term, where in zip(result.model.terms, layout.terms, strict=True):
        if (len(term.values) <= _FEW) != few:
            continue
        for (name, value), unknown in zip(term.values.items(), layout.unknowns[where], strict=True):
            unit, factor = read_in(unknown)
            sd = None if value.sd is None else value.sd * factor
            seen = reversed_parameters(result.model.machine, term.effect)
            on_table = -value.value * factor if name in seen else None
            if not value.measured:
                rows.append([term.effect.spec, name, "not measured", None, unit, None])
                continue
            rows.append([term.effect.spec, name, value.value * factor, sd, unit, on_table])
    heads = ["Effect", "Parameter", "Value", "± standard uncertainty", "Unit"]
    heads.append("On the table itself")
    if rows and all(row[-1] is None for row in rows):
        heads, rows = heads[:-1], [row[:-1] for row in rows]
    if rows:
        page.table(heads, rows)


def _rigid_body(page: Page, result: FitResult) -> None:
    tests = rigid_body_test(result)
    page.section("Is the body rigid?")
    if not tests:
        page.text("This campaign measures no error motion in several places.")
        return
    page.text(
        "Whether an error motion depends on where another axis stands, beyond levers and "
        "squareness; p-values are corrected for all dependences tested."
    )
    page.table(
        ["Error motion", "depends on", "p", "µm rms", "looks the same as"],
        [[t.motion, t.by, t.adjusted, t.rms * 1e3, ", ".join(t.alike)] for t in tests[:5]],
        digits=2,
    )


def _error_map(page: Page, model: Model, figures: Mapping[str, Callable[[], Figure]]) -> None:
    across = plane_of(model)
    if across is None:
        return
    page.section("Error map")
    found = error_map(model, across, {})
    ends = [", ".join(number(found.worst[a][k]) for a in across) for k in (0, 1)]
    page.text(
        "At the reference temperature, other axes in the middle of their travels, no tool: a "
        f"length errs most between ({ends[0]}) and ({ends[1]}) mm, by "
        f"{number(found.worst_error * 1e3, 3)} µm."
    )
    page.figure(figures["error map"](), "The error's component in the plane, enlarged.")


def _outliers(page: Page, result: FitResult) -> None:
    if not result.outliers:
        return
    page.section("Outliers")
    if not result.set_aside and result.misfit:
        page.text(
            f"{len(result.outliers)} rows stand out, but χ² per degree of freedom says that the "
            "model lacks something rather than that rows are wrong."
        )
        return
    page.text(
        "Set aside: they had no weight in the fit."
        if result.set_aside
        else "Used in the fit; with --robust they would be set aside."
    )
    rotation = result.problem.campaign.kind == Kind.ROTATION
    page.table(
        ["Line of the file", "Set-up", "residual, µm or µrad", "in standard deviations"],
        [
            [o.line, o.setup, o.residual * (1e6 if rotation[o.row] else 1e3), o.size]
            for o in result.outliers
        ],
        digits=3,
    )
