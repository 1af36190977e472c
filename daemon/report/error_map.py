"""The page of ``abbe error-map``: a plane as it is, component by component, and how sure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.figures.figure import SIGNED, Figure, figure
from abbe.compcore.figures.motions import plane as distorted
from abbe.compcore.model.model import Model
from abbe.compcore.model.uncertainty import COVERAGE, UNKNOWN
from abbe.compcore.units import in_digits
from abbe.daemon.answers.error_map import MappedPlane, state_in_words
from abbe.daemon.report.head import PageHead
from abbe.daemon.report.page import Page, number

F64 = NDArray[np.float64]

_SURE = ((0.0, "#ffffff"), (1.0, "#009e73"))


def error_map_page(
    model: Model, mapped: Sequence[MappedPlane], warnings: Sequence[str], head: PageHead
) -> Page:
    """The whole page: a section for each state of the machine, all in the same scale."""
    across = "–".join(mapped[0].plane.across)
    worst = max(mapped, key=lambda one: abs(one.found.worst_error))
    page = Page(
        f"A length in the plane {across} errs by up to {abs(worst.found.worst_error) * 1e3:.1f} µm",
        f"{model.machine.name or 'Machine'}: error map at {state_in_words(model, worst.plane)}",
        head,
    )
    page.notes(warnings, warning=True)
    if mapped[0].sure is None:
        page.notes([f"How sure: {UNKNOWN}"], warning=True)
    largest = max(float(np.abs(one.found.error).max()) for one in mapped) * 1e3
    widest = max((one.widest or 0.0) for one in mapped) * 1e3
    for one in mapped:
        page.section(f"At {state_in_words(model, one.plane)}")
        ends = [", ".join(number(one.found.worst[a][k]) for a in one.plane.across) for k in (0, 1)]
        key = [
            ("error of length, worst pair", f"{one.found.worst_error * 1e3:+.1f}", "µm"),
            ("between", f"({ends[0]}) and ({ends[1]})", "mm"),
            ("largest error of a point", f"{one.largest * 1e3:.1f}", "µm"),
        ]
        if one.widest is not None:
            key.append(
                ("how sure", f"± {in_digits(one.widest * 1e3, 2)}", f"µm at most, k = {COVERAGE:g}")
            )
        page.key_figures(key)
        page.figure(
            distorted(one.found),
            "The error in the plane, enlarged: where the grid's points really are.",
        )
        panels = [
            (
                _component(one, one.found.error[:, :, k] * 1e3, name, SIGNED, -largest, largest),
                f"Error in {name}, actual − indicated",
            )
            for k, name in enumerate("XYZ")
        ]
        if one.sure is not None:
            wide = np.linalg.norm(one.sure.translation, axis=1) * COVERAGE * 1e3
            shaped = wide.reshape(one.plane.points)
            panels.append(
                (
                    _component(one, shaped, "±", _SURE, 0.0, max(widest, 1e-6)),
                    f"How sure: ± of the error's length, k = {COVERAGE:g}",
                )
            )
        page.figures(panels)
    return page


def _component(
    one: MappedPlane,
    values: F64,
    name: str,
    scale: Sequence[tuple[float, str]],
    low: float,
    high: float,
) -> Figure:
    """One number over the plane, µm."""
    first, second = one.plane.across
    x, y = one.found.grid
    trace = {
        "type": "heatmap",
        "x": x,
        "y": y,
        "z": values.T,
        "name": name,
        "colorscale": [list(stop) for stop in scale],
        "zmin": low,
        "zmax": high,
        "colorbar": {"title": {"text": "µm"}, "thickness": 12},
        "hovertemplate": f"{first} %{{x:.5g}}, {second} %{{y:.5g}}: %{{z:.2f}} µm<extra></extra>",
    }
    equal = {"scaleanchor": "x", "constrain": "domain"}
    margin = {"l": 56, "r": 8, "t": 16, "b": 44}
    return figure(
        [trace], f"{first} (mm)", f"{second} (mm)", height=320, yaxis=equal, margin=margin
    )
