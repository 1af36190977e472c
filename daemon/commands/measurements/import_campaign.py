"""``abbe import-campaign``: other measuring systems' files to a campaign; says the sign assumed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.measurements.foreign_layout import ForeignLayout
from abbe.daemon.arguments.options import Force

if TYPE_CHECKING:
    from collections.abc import Callable

    from abbe.compcore.campaign.campaign import Campaign
    from abbe.compcore.machine.machine import Machine


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("import-campaign")(import_campaign)


def import_campaign(
    file: Annotated[Path, typer.Argument(help="The file to import.", metavar="FILE")],
    layout: Annotated[ForeignLayout, typer.Option("--as", help="What the file is.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Campaign.", metavar="OUT.csv")],
    axis: Annotated[
        str | None, typer.Option(help="The axis that moved (rtl: else the file's own).")
    ] = None,
    component: Annotated[
        str | None,
        typer.Option(help="What was measured: X Y Z along, A B C about; else positioning."),
    ] = None,
    at: Annotated[
        str, typer.Option(help="Where the other axes stood: Y=450,Z=-180 (mm, rotary degrees).")
    ] = "",
    tool: Annotated[str, typer.Option(help="Tool or probe offset x,y,z in mm.")] = "0,0,0",
    setup: Annotated[str, typer.Option(help="Name of the set-up; else the file's.")] = "",
    sd: Annotated[
        float | None,
        typer.Option(
            callback=within(1e-6, 1e5, "µm or µrad"),
            help="Standard uncertainty of a reading, µm or µrad.",
        ),
    ] = None,
    signal: Annotated[
        list[str] | None, typer.Option(help="NAME=VALUE, the same throughout; may be repeated.")
    ] = None,
    sign: Annotated[
        int, typer.Option(help="-1 where the file's sign is opposite to the one assumed.")
    ] = 1,
    unit: Annotated[
        str | None, typer.Option(help="Unit of the deviations: um, mm, mrad, arcsec, ...")
    ] = None,
    normalised: Annotated[
        bool | None,
        typer.Option(
            "--normalised/--not-normalised",
            help="rtl: readings are normalised to 20 °C (and are turned back), or not.",
        ),
    ] = None,
    expansion: Annotated[
        float | None,
        typer.Option(
            callback=within(-100.0, 100.0, "ppm/K"),
            help="rtl: coefficient with which they were normalised, ppm/K; else the file's.",
        ),
    ] = None,
    material_temperature: Annotated[
        float | None,
        typer.Option(
            callback=within(-30.0, 100.0, "°C"),
            help="rtl: temperature at which they were normalised, °C; else the file's.",
        ),
    ] = None,
    plane: Annotated[str | None, typer.Option(help="ballbar: XY, YZ or ZX.")] = None,
    centre: Annotated[
        str | None, typer.Option(help="ballbar: centre in the plane, mm: 350,450.")
    ] = None,
    radius: Annotated[
        float | None,
        typer.Option(callback=within(0.1, 1e5, "mm"), help="ballbar: nominal radius, mm."),
    ] = None,
    nest: Annotated[
        str | None, typer.Option(help="rtest: what carries the sensors, spindle or table.")
    ] = None,
    placed: Annotated[
        bool, typer.Option("--placed", help="rtest: spheres are where the file states it.")
    ] = False,
    structure: Annotated[
        str | None, typer.Option(help='map: the structure code, such as "w b Y X Z t".')
    ] = None,
    measured: Annotated[
        list[str] | None,
        typer.Option(
            help="log: COLUMN=Z along (X Y Z) or COLUMN=A about (A B C), @x,y,z for its tool "
            "offset; points: the columns of the points, COLUMN=X, =Y, =Z; repeated."
        ),
    ] = None,
    zero: Annotated[
        str | None,
        typer.Option(
            help="tpoint: AZIMUTH,ELEVATION added to what was read, degrees, as the import of "
            "another night of the same telescope said; else found from the stars."
        ),
    ] = None,
    model: Annotated[
        Path | None, typer.Option(help="Model file: checks that every axis has its position.")
    ] = None,
    visits: Annotated[
        Path | None,
        typer.Option(
            help='iso230-2, rtl, points: targets that abbe measure followed (reads = "file"), with '
            "which the file's readings are matched; --setup says which of its set-ups."
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Import runs, an rtl, a ball bar test, a map, lengths, plates, tracker points, logs, stars."""
    from abbe.compcore.campaign.suspicions import (
        of_unknown_thermometers,
        of_values,
        without_zeros,
    )
    from abbe.compcore.files.campaign_file import write_campaign
    from abbe.compcore.files.model_file import load_model
    from abbe.compcore.sentences import counted
    from abbe.daemon.answers.measurements.foreign_file import ForeignOptions, read_foreign
    from abbe.daemon.arguments.measurements.foreign_placing import foreign_placing
    from abbe.daemon.outputs import CAMPAIGN, check_outputs

    say = check_outputs([file, model, visits], [(output, CAMPAIGN)], force=force)
    machine = None if model is None else load_model(model).machine
    rotation = (component or axis or "X")[0] in "ABC"
    placing = foreign_placing(at, tool, setup, sd, signal or [], sign, rotation=rotation)
    options = ForeignOptions(
        axis=axis,
        component=component,
        unit=unit,
        normalised=normalised,
        expansion=None if expansion is None else expansion * 1e-6,
        material_temperature=material_temperature,
        plane=plane,
        centre=centre,
        radius=radius,
        nest=nest,
        placed=placed,
        structure=structure,
        measured=measured or [],
        zero=zero,
    )
    if visits is not None and layout is ForeignLayout.POINTS:
        _points(file, visits, setup, machine, output, unit, say)
        return
    campaign = read_foreign(layout, file, placing, None if visits else machine, options)
    if visits is not None:
        from abbe.compcore.files.importers.lines.matched import write_matched
        from abbe.compcore.files.visited_targets import VisitedTargets

        followed = VisitedTargets.read(visits, setup)
        count = write_matched(campaign, followed, output, str(campaign.metadata[0]["notes"]))
        words = counted(count, "1 reading", "{n} readings")
        say(f"{words} of {file} matched with set-up {followed.setup} → {output}")
        return
    write_campaign(campaign, output)
    suspected = of_values(campaign, without_zeros(campaign))
    for suspicion in (*suspected, *of_unknown_thermometers(campaign)):
        say(f"SUSPICIOUS: {suspicion}")
    for note in str(campaign.metadata[0]["notes"]).split("; "):
        say(note)
    words = counted(campaign.n, "1 row", "{n} rows")
    say(f"{words} in {_setups(campaign)} → {output}")


def _points(
    file: Path,
    visits: Path,
    setup: str,
    machine: Machine | None,
    output: Path,
    unit: str | None,
    say: Callable[[str], None],
) -> None:
    """A tracker's points, matched with the poses that `abbe measure` followed."""
    from abbe.compcore.files.importers.points_matched import reads_points, write_points
    from abbe.compcore.files.visited_targets import VisitedTargets
    from abbe.compcore.sentences import counted

    if machine is None:
        raise typer.BadParameter("needed for this kind of file", param_hint="--model")
    followed = VisitedTargets.read(visits, setup)
    if not reads_points(followed):
        raise typer.BadParameter(
            f"no set-up that a tracker reads: {followed.setup}", param_hint="--setup"
        )
    count, notes = write_points([(file, followed)], machine, output, unit or "mm")
    for note in notes:
        say(note)
    words = counted(count, "1 reading", "{n} readings")
    say(f"{words} of {file} matched with set-up {followed.setup} → {output}")


def _setups(campaign: Campaign) -> str:
    names = list(campaign.setups)
    return f"set-up {names[0]}" if len(names) == 1 else f"{len(names)} set-ups"
