"""``abbe plan``: what to measure: a list by the standard, or the best use of a time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.compcore.sentences import said
from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.measurements.survey_options import (
    AlongAxes,
    GaugeAtHand,
    Instruments,
    KeepOutBoxes,
    PlanOut,
    PlateAtHand,
    TableRadius,
    TimeThere,
    ToolRadius,
    Tools,
)
from abbe.daemon.arguments.options import AsJson, Force, PrintedIn

if TYPE_CHECKING:
    from collections.abc import Callable

    from abbe.compcore.model.model import Model
    from abbe.compcore.planning.plan import SurveyPlan
    from abbe.compcore.planning.targets import SurveyTask
    from abbe.daemon.report.language import PageLanguage


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("plan")(plan)


def plan(
    model: Annotated[
        Path, typer.Argument(help="Model: structure, travels, sensors.", metavar="MODEL.toml")
    ],
    wave: Annotated[
        list[str] | None,
        typer.Option(
            help="Shortest wave to be seen along an axis, mm or degrees; may be repeated.",
            metavar="AXIS=LENGTH",
        ),
    ] = None,
    held: Annotated[
        float,
        typer.Option(
            callback=within(0.41, 0.999, ""), help="Part of its amplitude that tables shall hold."
        ),
    ] = 0.8,
    instruments: Instruments = None,
    time: TimeThere = "4h",
    out: PlanOut = None,
    preset: Annotated[
        str | None, typer.Option(help="A usual programme instead: iso230-2, iso230-6, …")
    ] = None,
    tool: Tools = None,
    keep_out: KeepOutBoxes = None,
    tool_radius: ToolRadius = 0.0,
    table_radius: TableRadius = 0.0,
    plate: PlateAtHand = None,
    gauge: GaugeAtHand = None,
    along_axes: AlongAxes = False,
    apart: Annotated[
        list[str] | None,
        typer.Option(help="Tell these causes apart instead; give two or more.", metavar="EFFECT"),
    ] = None,
    changed: Annotated[
        float,
        typer.Option(
            callback=within(0.001, 1.0, ""),
            help="Part of its believable size by which a fitted value may have changed.",
        ),
    ] = 0.05,
    as_json: AsJson = False,
    report: Annotated[
        Path | None, typer.Option(help="A page to take along.", metavar="FILE.html")
    ] = None,
    language: PrintedIn = "en",
    force: Force = False,
) -> None:
    """List what to measure on a machine, in the order of ISO/TR 16907, 10.3, with steps.

    With --instruments: the set-ups that make the corrected machine surest in the time there is.

    An example: abbe plan model.toml --instruments laser,ball-bar --time 4h -o plan.toml
    """
    from math import radians

    from abbe.compcore.files.gauge_file import read_gauge
    from abbe.compcore.files.model_file import load_model
    from abbe.compcore.files.plan_file import write_plan
    from abbe.compcore.files.plate_file import read_plate
    from abbe.compcore.machine.plausible import Range
    from abbe.compcore.machine.structure import is_rotary
    from abbe.compcore.planning.envelope import WorkingSpace
    from abbe.compcore.planning.nudge import NUDGE
    from abbe.compcore.planning.targets import SurveyTask
    from abbe.daemon.answers.measurements import survey as answer
    from abbe.daemon.arguments.assignments import number, split_assignments
    from abbe.daemon.arguments.plan_arguments import (
        keep_out_of,
        seconds_of,
        tools_of,
        with_effects,
    )
    from abbe.daemon.outputs import PLAN, REPORT, check_outputs
    from abbe.daemon.printed_in import failing_in, printed_in
    from abbe.daemon.report.language import language as known_language

    spoken = known_language(language)
    say = check_outputs(
        [model, plate, gauge], [(out, PLAN), (report, REPORT)], force=force, as_json=as_json
    )
    with printed_in(spoken), failing_in(spoken):
        waves = {}
        for axis, text in split_assignments(wave or []).items():
            rotary = bool(axis) and is_rotary(axis)
            length = number("wave", text, "degrees" if rotary else "mm", Range(1e-6, 1e5, ""))
            waves[axis] = radians(length) if rotary else length
        loaded = load_model(model)
        if instruments is None and preset is None:
            _list(loaded, model, waves, held, out, report, say, spoken, as_json=as_json)
            return
        grown, places = with_effects(_determined(loaded), apart or [])
        # an instrument that writes a file would take the nudge for a target
        nudge = 0.0 if along_axes else NUDGE
        boxes = keep_out_of(keep_out or [])
        space = WorkingSpace(boxes, tool_radius, nudge=nudge, table=table_radius)
        task = SurveyTask(
            grown, space, tools_of(tool or []),
            waves, held, None if plate is None else read_plate(plate),
            None if gauge is None else read_gauge(gauge), along_axes,
        )  # fmt: skip
        made = _planned(task, instruments, preset, seconds_of(time), places, changed)
        if out is not None:
            write_plan(made, out, str(model))
        if report is not None:
            from abbe.daemon.report.measurements.survey import page

            page(made, model, spoken).write(report)
        if as_json:
            say(json.dumps(answer.as_json(made), ensure_ascii=False))
            return
        for line in answer.as_text(made):
            say(line)
        written = ", ".join(str(p) for p in (out, report) if p is not None)
        if written:
            say(said("written: {files}", files=written))


def _determined(loaded: Model) -> Model:
    """The model whose parameters are to be determined; the start model where it has no effects."""
    from abbe.compcore.model.start_model import StartOptions, start_model

    if loaded.effects:
        return loaded
    rotary = bool(loaded.machine.structure.rotary)
    return start_model(loaded.machine, StartOptions(play=True, rotary_motions=rotary))


def _planned(
    task: SurveyTask, instruments: str | None, preset: str | None, seconds: float,
    places: tuple[int, ...], changed: float,
) -> SurveyPlan:  # fmt: skip
    from abbe.compcore.planning.instruments import instruments_called
    from abbe.compcore.planning.plan import plan_preset, plan_survey
    from abbe.compcore.planning.setups.presets import preset_called
    from abbe.daemon.progress import shown

    if preset is not None:
        return plan_preset(task, preset_called(preset), seconds, changed=changed)
    called = instruments_called([w.strip() for w in (instruments or "").split(",")])
    with shown("set-ups that can be done") as tell:
        return plan_survey(
            task, called, seconds, apart=places, changed=changed, compare=True, progress=tell
        )


def _list(
    loaded: Model, path: Path, waves: dict[str, float], held: float, out: Path | None,
    report: Path | None, say: Callable[[str], None], spoken: PageLanguage, *, as_json: bool,
) -> None:  # fmt: skip
    """The direct measurements of the machine, whatever instruments there are."""
    from abbe.compcore.campaign.plan import measurement_plan
    from abbe.compcore.errors import InputError
    from abbe.daemon.answers.measurements import plan as answer

    if out is not None:
        raise InputError(
            "a plan needs to know what it may use",
            field="instruments",
            expected="--instruments laser,ball-bar,… or --preset iso230-2",
        )
    machine = loaded.machine
    made = measurement_plan(machine, waves, held)
    if report is not None:
        from abbe.daemon.report.measurements.plan import page

        page(machine, made, path, spoken).write(report)
    if as_json:
        say(json.dumps(answer.as_json(machine, made), ensure_ascii=False))
        return
    for line in answer.as_text(machine, made):
        say(line)
    if report is not None:
        say(said("written: {files}", files=report))
