"""``abbe program``: a plan's set-ups as a program of a controller."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from abbe.compcore.sentences import counted, said
from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.measurements.plan_reading import Feed, OnlySetups, PlanFile, Stands
from abbe.daemon.arguments.options import Force


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("program")(program)


def program(
    plan: PlanFile,
    controller: Annotated[
        str, typer.Option(help="linuxcnc, fanuc, siemens, heidenhain or ipp.", metavar="NAME")
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="The program.", metavar="FILE")],
    model: Annotated[
        Path | None,
        typer.Option(help="Model, if not the one that the plan names.", metavar="MODEL.toml"),
    ] = None,
    targets: Annotated[
        Path | None, typer.Option(help="List of the targets.", metavar="FILE.csv")
    ] = None,
    setup: OnlySetups = None,
    feed: Feed = 3000.0,
    stands: Stands = None,
    sphere: Annotated[
        float | None,
        typer.Option(
            callback=within(1.0, 500.0, "mm"),
            help="Diameter of a sphere that the control touches, mm.",
        ),
    ] = None,
    tip: Annotated[
        float | None,
        typer.Option(callback=within(0.1, 100.0, "mm"), help="Diameter of the stylus's ball, mm."),
    ] = None,
    sphere_at: Annotated[
        str | None,
        typer.Option(help="Where X, Y, Z stand with the tip on the sphere's top.", metavar="x,y,z"),
    ] = None,
    force: Force = False,
) -> None:
    """Write the program that moves a machine through a plan, target by target.

    An example: abbe program plan.toml --controller linuxcnc -o plan.ngc --targets targets.csv
    """
    from abbe.compcore.errors import InputError
    from abbe.compcore.files.model_file import load_model
    from abbe.compcore.files.plan_file import model_of, read_plan
    from abbe.compcore.files.text.atomic import write_together
    from abbe.compcore.planning.instruments import TOUCHED
    from abbe.compcore.planning.motion import steps_of
    from abbe.compcore.planning.probing.touching import Touching, touching_steps
    from abbe.daemon.arguments.plan_arguments import place_of
    from abbe.daemon.outputs import PROGRAM, TARGETS, check_outputs
    from abbe.drivers.programs.dialect import targets_csv
    from abbe.drivers.programs.dialects import dialect_called

    named = model_of(plan) if model is None else model
    say = check_outputs([plan, named], [(out, PROGRAM), (targets, TARGETS)], force=force)
    dialect = dialect_called(controller)
    machine = load_model(named).machine
    work = read_plan(plan, machine)
    wanted = [s for s in work.setups if not setup or s.name in setup]
    for name in setup or []:
        if name not in {s.name for s in work.setups}:
            raise InputError(
                "the plan has no such set-up",
                file=plan,
                field="setup",
                found=name,
                expected="one of " + ", ".join(s.name for s in work.setups),
            )
    touched = [s.name for s in wanted if s.instrument.key in TOUCHED]
    balls = [s for s in wanted if s.instrument.key == "sphere"]
    if sphere is not None and tip is not None and balls and len(balls) == len(wanted):
        at = None if sphere_at is None else place_of("sphere-at", sphere_at)
        steps = touching_steps(machine, wanted, work.space, Touching(sphere, tip, stands=at))
    elif touched:
        raise InputError(
            "its targets are what a probe touches, and a program would drive into them",
            file=plan,
            field="setup",
            found=", ".join(touched),
            expected="of spheres alone --sphere and --tip, their diameters; else abbe measure "
            "with a section [probing] on a CMM or LinuxCNC, the controller's own probing cycles; "
            "--setup for the others",
        )
    else:
        steps = steps_of(machine, wanted, work.space, stands)
    title = f"{machine.name or 'machine'}, {machine.structure}"
    # all that could be refused comes before anything is written
    contents: dict[Path, str] = {out: dialect.text(steps, machine, title, feed)}
    if targets is not None:
        contents[targets] = targets_csv(steps, machine)
    write_together(contents)
    count = sum(step.kind == "target" for step in steps)
    count += len({step.number for step in steps if step.kind == "touch"})
    say(
        said(
            "{control}: {setups}, {count}, {feed} mm/min",
            control=dialect.title, setups=counted(len(wanted), "1 set-up", "{n} set-ups"),
            count=counted(count, "1 target", "{n} targets"), feed=f"{feed:g}",
        )
    )  # fmt: skip
    if balls:
        say(said("what it writes of its touches: abbe import-campaign --as probed"))
    say(said("before it runs: warm up, tool in, way back free; try it above the machine first"))
    say(said("written: {files}", files=", ".join(map(str, contents))))
