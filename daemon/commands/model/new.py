"""``abbe new``: a complete model to begin with, from what is known before measuring."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.daemon.arguments.options import AsJson, Force, MachineName, NewModel

if TYPE_CHECKING:
    from abbe.compcore.machine.machine import Machine
    from abbe.compcore.model.start_model import StartOptions


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("new")(new)


def new(
    out: NewModel,
    structure: Annotated[
        str | None,
        typer.Option(
            help='Structure code, workpiece to tool: "w b Y X Z t"; or bridge, gantry, '
            "horizontal-arm, c-frame, boring, table-table, table-head, head-head, lathe. "
            "Left out: everything is asked."
        ),
    ] = None,
    name: MachineName = "",
    travel: Annotated[
        list[str] | None,
        typer.Option(help="X=0,700 in mm, rotary axes degrees; one for each axis."),
    ] = None,
    location: Annotated[
        list[str] | None,
        typer.Option(help="C=250,200,0: a point of a rotary axis's line, all axes at zero, mm."),
    ] = None,
    sensor: Annotated[
        list[str] | None,
        typer.Option(help="NAME=ROLE[,AXIS[,UNIT]]: T_x=scale,X or n=speed,,rpm. May be repeated."),
    ] = None,
    two_drives: Annotated[
        list[str] | None,
        typer.Option(
            help="Y=SIGNAL,X,-50,1250: axis Y has two drives, apart along X, master at -50 and "
            "slave at 1250 mm; SIGNAL (mm) is how far the slave is ahead. May be repeated."
        ),
    ] = None,
    play: Annotated[
        bool, typer.Option("--play", help="Lines will be measured in both directions.")
    ] = False,
    rotary_motions: Annotated[
        bool,
        typer.Option("--rotary-motions", help="Rotary axes' own motions will be measured."),
    ] = False,
    tool_lengths: Annotated[
        bool, typer.Option("--tool-lengths", help="Tools of different lengths will be used.")
    ] = False,
    shape: Annotated[
        str | None,
        typer.Option(help="Of linear axes' errors: spline:N, polynomial:N; default by travel."),
    ] = None,
    bare: Annotated[
        bool,
        typer.Option(
            "--bare", help="No effects: diagnose --apply finds those that the measurements show."
        ),
    ] = False,
    positioning: Annotated[
        bool,
        typer.Option(
            "--positioning", help="Of each axis its positioning alone, and its play (--play)."
        ),
    ] = False,
    as_json: AsJson = False,
    force: Force = False,
) -> None:
    """Make a model to begin with: structure, travels, sensors; then measure and fit."""
    from abbe.compcore.errors import InputError
    from abbe.compcore.files.model_toml.commented import save_commented
    from abbe.compcore.model.revise import add_effect
    from abbe.compcore.model.start_model import StartOptions, start_model
    from abbe.daemon.answers.model import new as answer
    from abbe.daemon.arguments.model.machine import two_drives_of
    from abbe.daemon.outputs import MODEL, check_outputs

    say = check_outputs([], [(out, MODEL)], force=force, as_json=as_json)
    if bare and (play or rotary_motions or tool_lengths or shape or positioning):
        raise InputError(
            "says which effects the model shall have, beside none at all",
            field="bare",
            expected="--bare without --play, --rotary-motions, --tool-lengths, --shape, "
            "--positioning",
        )
    wanted = StartOptions(play, rotary_motions, tool_lengths, shape, bare, positioning)
    if structure is not None:
        drives = two_drives_of(two_drives or [])
        sensors = [
            *(sensor or []),
            *(f"{keys['signal']}=other,{keys['axis']},mm" for keys in drives),
        ]
        machine = _given(structure, name, travel or [], location or [], sensors)
    elif travel or location or sensor or two_drives:
        raise InputError("which machine?", field="structure", expected="--structure CODE")
    elif not sys.stdin.isatty():
        raise InputError(
            "there is no terminal to ask on",
            field="structure",
            expected="--structure CODE and --travel AXIS=LOW,HIGH for each axis",
        )
    else:
        machine, wanted = _asked(name, wanted)
    model = start_model(machine, wanted)
    for keys in two_drives_of(two_drives or []):
        model = add_effect(model, "two_drives", **keys)
    save_commented(model, out)
    if as_json:
        say(json.dumps(answer.as_json(model, out), ensure_ascii=False))
        return
    for line in answer.as_text(model, out):
        say(line)
    say(f"written: {out}")


def _given(
    structure: str, name: str, travel: list[str], location: list[str], sensor: list[str]
) -> Machine:
    from abbe.daemon.arguments.assignments import split_assignments
    from abbe.daemon.arguments.model.machine import machine_of, sensor_of, structure_of

    code, kind = structure_of(structure)
    return machine_of(
        code,
        name or (kind.title if kind else str(code)),
        split_assignments(travel),
        split_assignments(location),
        [sensor_of(*item) for item in split_assignments(sensor).items()],
    )


def _asked(name: str, wanted: StartOptions) -> tuple[Machine, StartOptions]:
    from abbe.daemon.arguments.model.machine_questions import ask_machine

    return ask_machine(name, wanted)
