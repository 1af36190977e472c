"""``abbe plan``: what to measure on a machine, in which order and in which steps."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.options import AsJson, Force


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
    as_json: AsJson = False,
    report: Annotated[
        Path | None, typer.Option(help="A page to take along.", metavar="FILE.html")
    ] = None,
    force: Force = False,
) -> None:
    """List what to measure on a machine, in the order of ISO/TR 16907, 10.3, with steps.

    An example: abbe plan model.toml --wave X=10 --report plan.html
    """
    from math import radians

    from abbe.compcore.campaign.plan import measurement_plan
    from abbe.compcore.files.model_file import load_model
    from abbe.compcore.machine.plausible import Range
    from abbe.compcore.machine.structure import is_rotary
    from abbe.daemon.answers.measurements import plan as answer
    from abbe.daemon.arguments.assignments import number, split_assignments
    from abbe.daemon.outputs import REPORT, check_outputs

    say = check_outputs([model], [(report, REPORT)], force=force, as_json=as_json)
    waves = {}
    for axis, text in split_assignments(wave or []).items():
        rotary = bool(axis) and is_rotary(axis)
        length = number("wave", text, "degrees" if rotary else "mm", Range(1e-6, 1e5, ""))
        waves[axis] = radians(length) if rotary else length
    machine = load_model(model).machine
    made = measurement_plan(machine, waves, held)
    if report is not None:
        from abbe.daemon.report.measurements.plan import page

        page(machine, made, model).write(report)
    if as_json:
        say(json.dumps(answer.as_json(machine, made), ensure_ascii=False))
        return
    for line in answer.as_text(machine, made):
        say(line)
    if report is not None:
        say(f"written: {report}")
