"""The page of ``abbe plan --instruments``: every set-up with its picture, to be taken along."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.figures.figure import COLOURS, GREY, Figure, figure, line
from abbe.compcore.figures.places import reaches_by_joints
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.planning.plan import PlanStep, SurveyPlan
from abbe.compcore.planning.planned_setup import PlannedSetup, tip_at
from abbe.compcore.planning.setups.presets import PRESETS
from abbe.compcore.planning.targets import SurveyTask
from abbe.compcore.sentences import as_it_stands, said
from abbe.daemon.answers.measurements.plan import AFTER, BEFORE
from abbe.daemon.answers.measurements.survey import (
    MEANING,
    hindered_words,
    most_stays,
    placeless_words,
    runs_words,
    stays_words,
    unmoved_words,
)
from abbe.daemon.report.head import PageHead, facts_before, file_on_page
from abbe.daemon.report.language import PageLanguage
from abbe.daemon.report.page import Page, number, typeset

F64 = NDArray[np.float64]

_MOST_PICTURES = 40
_REACH = said("reach of the tip")
_ARC = 25
"""Places of a joint on the lines that show its reach."""
_MANY = 60
"""Targets above which they are drawn small."""
_FEW = 3
"""Joints beside the one that moves, up to which each of them stands at its ends."""


def page(plan: SurveyPlan, model: Path, language: PageLanguage | None = None) -> Page:
    """Lay out a plan, in English or another language."""
    task = plan.task
    machine = task.machine
    head = PageHead(facts_before(machine), [file_on_page("model", model)])
    name = machine.name or said("this machine")
    title = said("Plan of measurements for {machine}", machine=name)
    made = Page(title, head=head, language=language)
    made.key_figures(
        [
            (said("time to measure"), f"{plan.seconds / 3600.0:.1f}", "h"),
            (said("uncertain before"), number(plan.before * 1e3, 3), "µm"),
            (said("uncertain after"), number(plan.after * 1e3, 3), "µm"),
        ]
    )
    made.text(said("{sentence}.", sentence=MEANING))
    made.notes(list(unmoved_words(plan)))
    warm = said(
        "warm up {minutes} min; after a pause of more than 10 min again",
        minutes=f"{plan.warm_up / 60.0:.0f}",
    )
    made.notes([*BEFORE, warm])
    made.notes(list(stays_words(plan)), warning=most_stays(plan))
    made.notes([*placeless_words(plan), *hindered_words(plan)], warning=True)
    made.section(said("Set-ups"))
    made.table(
        ["", said("What"), said("With"), said("Targets"), said("Runs"), said("Tool"), "min",
         said("Before, µm"), said("After, µm"), said("Done")],
        [_row(step) for step in plan.steps],
        digits=3,
    )  # fmt: skip
    steps = np.arange(len(plan.steps) + 1)
    left = [plan.before * 1e3, *(step.after * 1e3 for step in plan.steps)]
    made.figure(
        figure([line(steps, left, mode="lines+markers")], said("set-ups done"), said("left, µm"),
               xaxis={"dtick": 1 + len(plan.steps) // 12}, yaxis=_decades(left)),
        said("What is uncertain over the volume after each set-up."),
    )  # fmt: skip
    made.section(said("What stays undetermined"))
    nothing = said("nothing that would be felt in the volume")
    made.notes([str(one) for one in plan.left] or [nothing])
    if plan.presets:
        made.section(said("The same time spent otherwise, with the instruments that it needs"))
        rows = [[said("this plan"), number(plan.after * 1e3, 3)]]
        rows += [
            [as_it_stands(PRESETS[key].title), number(v * 1e3, 3)]
            for key, v in plan.presets.items()
        ]
        made.table(["", said("Left, µm")], rows)
    for step in plan.steps[:_MOST_PICTURES]:
        setup = step.setup
        made.section(said("{name}: {what}", name=setup.name, what=typeset(setup.what)))
        made.text(
            said(
                "{instrument}, {count} targets, {runs}, tool {tool}, {minutes} min; "
                "unknown: {free}.",
                instrument=as_it_stands(setup.instrument.title), count=setup.count,
                runs=runs_words(step), tool=f"{setup.tool} {tuple(setup.offset)}",
                minutes=f"{setup.seconds / 60.0:.0f}",
                free=", ".join(setup.free) or said("nothing"),
            )
        )  # fmt: skip
        made.figure(
            picture(task, setup),
            said("Orange: what moves and its targets. Blue: where the instrument stands."),
        )
    if plan.hindered:
        made.section(said("Not considered because of keep-out boxes"))
        rows = [
            [as_it_stands(one.instrument), typeset(one.what), str(one.box)] for one in plan.hindered
        ]
        made.table([said("With"), said("What"), said("Box")], rows)
    made.notes([AFTER])
    return made


def _row(step: PlanStep) -> list[str | float | int | None]:
    setup = step.setup
    return [
        setup.name,
        typeset(setup.what),
        setup.instrument.title,
        setup.count,
        runs_words(step),
        setup.tool,
        setup.seconds / 60.0,
        number(step.before * 1e3, 3),
        number(step.after * 1e3, 3),
        "",
    ]


def _decades(values: Sequence[float]) -> dict[str, Any]:
    """A logarithmic axis on which every number is written whole: 1, 2, 5, 10, …"""
    low, high = (int(np.floor(np.log10(max(v, 1e-9)))) for v in (min(values), max(values)))
    ticks = [one * 10.0**power for power in range(low, high + 1) for one in (1.0, 2.0, 5.0)]
    return {"type": "log", "tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks]}


def picture(task: SurveyTask, setup: PlannedSetup) -> Figure:
    """The volume, keep-out boxes, the way of the tool's tip, and where the optics stand; mm."""
    shared: dict[str, Any] = {"type": "scatter3d", "hoverinfo": "text"}
    traces = [_reach(task.machine, setup)]
    traces += [
        _box(np.array(box.low), np.array(box.high), COLOURS[6], said("keep out"))
        for box in task.space.keep_out
    ]
    way = setup.stood(task.machine)
    many = len(way) > _MANY
    traces.append(
        shared | {"mode": "lines+markers", "name": said("targets"),
                  "line": {"color": COLOURS[1], "width": 1 if many else 4},
                  "marker": {"size": 3 if many else 5, "color": COLOURS[1]},
                  "x": way[:, 0], "y": way[:, 1], "z": way[:, 2]}
    )  # fmt: skip
    for i, (title, place) in enumerate(setup.optics.items()):
        beam = np.stack([np.asarray(place), way[0]])
        traces.append(
            shared | {"mode": "lines+markers+text" if i == 0 else "markers+text", "name": title,
                      "text": [title, ""], "textposition": "top center",
                      "line": {"color": COLOURS[0], "dash": "dot", "width": 4},
                      "marker": {"size": [14, 0], "color": COLOURS[0]},
                      "x": beam[:, 0], "y": beam[:, 1], "z": beam[:, 2]}
        )  # fmt: skip
    scene = {
        "aspectmode": "data",
        # from far enough that no scale is cut off at the picture's edge
        "camera": {"eye": dict.fromkeys("xyz", 1.45), "center": {"x": 0.0, "y": 0.0, "z": -0.15}},
        **{f"{k}axis": {"title": {"text": f"{k.upper()}, mm"}} for k in "xyz"},
    }
    return figure(traces, scene=scene, height=480, showlegend=True)


def _reach(machine: Machine, setup: PlannedSetup) -> Figure:
    """What the tip can reach: the travels' box, or what joints draw, one after the other."""
    if not reaches_by_joints(machine):
        ends = [machine.axes[a].travel if a in machine.axes else (0.0, 0.0) for a in "XYZ"]
        low, high = (np.array([e[i] for e in ends]) + np.asarray(setup.offset) for i in (0, 1))
        return _box(low, high, GREY, _REACH)
    gap = np.full((1, 3), np.nan)
    drawn = []
    for axis, own in machine.axes.items():
        others = [a for a in machine.axes if a != axis]
        for stand in product(*(_stands(machine.axes[a], len(others)) for a in others)):
            at = {a: np.full(_ARC, q) for a, q in zip(others, stand, strict=True)}
            at[axis] = np.linspace(*own.travel, _ARC)
            drawn += [tip_at(machine, at, setup.offset), gap]
    return _lines(np.concatenate(drawn), GREY, _REACH)


def _stands(axis: Axis, others: int) -> tuple[float, ...]:
    """Where a joint stands while another draws its reach; of many joints in the middle."""
    straight = float(axis.clamp(np.zeros(1))[0])
    if others > _FEW:
        return (straight,)
    return (*axis.travel, straight) if axis.rotary else axis.travel


def _box(low: F64, high: F64, colour: str, name: str) -> dict[str, Any]:
    """The twelve edges of a box, in one line with gaps."""
    corners = np.array(list(product(*zip(low, high, strict=True))))
    points = []
    for i, one in enumerate(corners):
        for two in corners[i + 1 :]:
            if (one != two).sum() == 1:
                points += [one, two, np.full(3, np.nan)]
    return _lines(np.array(points) if points else np.zeros((0, 3)), colour, name)


def _lines(edges: F64, colour: str, name: str) -> Figure:
    """Lines with gaps."""
    return {
        "type": "scatter3d", "mode": "lines", "name": name, "hoverinfo": "skip",
        "line": {"color": colour, "width": 2},
        "x": edges[:, 0], "y": edges[:, 1], "z": edges[:, 2],
    }  # fmt: skip
