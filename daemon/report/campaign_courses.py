"""Each campaign's course through a model's versions, against its own noise floor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np

from abbe.compcore.figures.figure import COLOURS, figure, line
from abbe.compcore.units import in_digits
from abbe.daemon.report.page import Figure
from abbe.daemon.report.versions import change, number_of

FITTED, HELD_OUT = COLOURS[0], COLOURS[4]
_HEADROOM = 1.18


@dataclass(frozen=True)
class CourseValue:
    """A campaign beside one version.

    Attributes
    ----------
    version
        Its number, from 1.
    change
        What made it.
    held_out
        Whether the version was not fitted to the campaign.
    rms, floor
        Of its lengths, µm; the floor None where nothing was repeated.
    """

    version: int
    change: str
    held_out: bool
    rms: float
    floor: float | None


@dataclass(frozen=True)
class CampaignCourse:
    """A campaign beside all versions that were laid beside it."""

    name: str
    values: tuple[CourseValue, ...]

    @property
    def caption(self) -> str:
        """Its name, and how it was used by the last version that saw it."""
        last = self.values[-1]
        used = "held out" if last.held_out else "fitted"
        if len({v.held_out for v in self.values}) > 1:
            used = "fitted by some versions, held out by others"
        floor = "its noise floor is not known: nothing was repeated"
        if last.floor is not None:
            floor = f"{in_digits(last.rms)} µm left, noise floor {in_digits(last.floor)} µm"
        return f"{self.name}, {used}: {floor}"


def courses_of(versions: Sequence[Mapping[str, Any]]) -> list[CampaignCourse]:
    """The courses of all campaigns whose own figures the versions tell, fitted ones first.

    `versions` are the records, oldest first. A campaign is known by its SHA-256.
    """
    found: dict[str, tuple[str, list[CourseValue]]] = {}
    for k, record in enumerate(versions, start=1):
        for key in ("campaigns", "holdout"):
            for one in record.get(key, ()):
                rms = number_of(one, "rms")
                if rms is None:
                    continue
                name = PurePath(str(one.get("file", "–"))).name
                identity = str(one.get("sha256", name))
                value = CourseValue(
                    k, change(record), key == "holdout", rms, number_of(one, "noise_floor")
                )
                found.setdefault(identity, (name, []))[1].append(value)
    courses = [CampaignCourse(name, tuple(values)) for name, values in found.values()]
    return sorted(courses, key=lambda c: c.values[-1].held_out)


def course_figure(course: CampaignCourse, beside: Sequence[CampaignCourse]) -> Figure:
    """One campaign's picture; `beside` are all campaigns, whose greatest value sets the scale."""
    at = np.array([float(v.version) for v in course.values])
    traces = []
    for held_out, name, colour in ((False, "fitted", FITTED), (True, "held out", HELD_OUT)):
        chosen = [v for v in course.values if v.held_out == held_out]
        if chosen:
            traces.append(
                {
                    "type": "bar",
                    "x": [v.version for v in chosen],
                    "y": [v.rms for v in chosen],
                    "name": name,
                    "width": 0.55,
                    "marker": {"color": colour},
                    "hovertext": [f"{v.version}: {v.change}" for v in chosen],
                    "hovertemplate": "%{hovertext}<br>%{in_digits(y, 4)} µm",
                }
            )
    floors = np.array([np.nan if v.floor is None else v.floor for v in course.values])
    if np.isfinite(floors).any():
        x = np.stack([at - 0.42, at + 0.42, at + 0.5], axis=1).ravel()
        y = np.stack([floors, floors, np.full(len(floors), np.nan)], axis=1).ravel()
        style = {"color": "#1b1f24", "dash": "dash", "width": 2}
        traces.append(line(x, y, "its noise floor", line=style))
    # in a low bar there is no room for it, and across its top goes the floor
    traces.append(
        {
            "type": "scatter",
            "mode": "text",
            "x": at,
            "y": [max(v.rms, v.floor or 0.0) for v in course.values],
            "text": [in_digits(v.rms) for v in course.values],
            "textposition": "top center",
            "textfont": {"color": "#1b1f24"},
            "hoverinfo": "skip",
        }
    )
    tallest = max(max(v.rms, v.floor or 0.0) for c in beside for v in c.values)
    first, last = (f(v.version for c in beside for v in c.values) for f in (min, max))
    return figure(
        traces,
        "version",
        "rms in µm",
        title=course.name,
        height=300,
        barmode="overlay",
        # the page says what the colours are; beside a name there is no room on a telephone
        showlegend=False,
        margin={"l": 56, "r": 8, "t": 36, "b": 44},
        xaxis={"tickvals": list(range(first, last + 1)), "range": [first - 0.6, last + 0.6],
               "showgrid": False},
        yaxis={"range": [0.0, _HEADROOM * tallest]},
    )  # fmt: skip
