"""``abbe import-campaign``: other measuring systems' files to a campaign; says the sign assumed."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.force import Force

if TYPE_CHECKING:
    from abbe.compcore.campaign.campaign import Campaign
    from abbe.compcore.files.importers.placing import ForeignPlacing
    from abbe.compcore.machine.machine import Machine
    from abbe.compcore.machine.structure import Structure


class ForeignLayout(StrEnum):
    """The layout of a foreign file."""

    ISO230_2 = "iso230-2"
    RTL = "rtl"
    BALLBAR = "ballbar"
    MAP = "map"
    LENGTHS = "lengths"
    PLATE = "plate"
    RTEST = "rtest"


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
    model: Annotated[
        Path | None, typer.Option(help="Model file: checks that every axis has its position.")
    ] = None,
    force: Force = False,
) -> None:
    """Import runs, a Renishaw rtl, a ball bar test, a map, lengths, plates, or a rotary test."""
    from abbe.compcore.campaign.suspicions import of_values, without_zeros
    from abbe.compcore.files.campaign_file import write_campaign
    from abbe.compcore.files.model_file import load_model
    from abbe.compcore.machine.plausible import TRAVEL
    from abbe.daemon.arguments.assignments import number
    from abbe.daemon.outputs import CAMPAIGN, check_outputs

    say = check_outputs([file, model], [(output, CAMPAIGN)], force=force)
    machine = None if model is None else load_model(model).machine
    rotation = (component or axis or "X")[0] in "ABC"
    placing = _placing(at, tool, setup, sd, signal or [], sign, rotation=rotation)
    if layout is ForeignLayout.ISO230_2:
        from abbe.compcore.files.importers.iso230_table import import_iso230_table

        campaign = import_iso230_table(
            file, _needed(axis, "axis"), placing, component=component, unit=unit, machine=machine
        )
    elif layout is ForeignLayout.RTL:
        from abbe.compcore.files.importers.laser_environment import Normalisation
        from abbe.compcore.files.importers.rtl import import_rtl

        campaign = import_rtl(
            file,
            placing,
            axis=axis,
            component=component,
            unit=unit,
            machine=machine,
            normalisation=Normalisation(
                normalised, None if expansion is None else expansion * 1e-6, material_temperature
            ),
        )
    elif layout is ForeignLayout.BALLBAR:
        from abbe.compcore.files.importers.ballbar import import_ballbar

        middle = None
        if centre is not None:
            a, b = _split(centre, 2, "centre")
            middle = number("centre", a, "mm", TRAVEL), number("centre", b, "mm", TRAVEL)
        campaign = import_ballbar(
            file, placing, plane=plane, centre=middle, radius=radius, unit=unit, machine=machine
        )
    elif layout is ForeignLayout.RTEST:
        from abbe.compcore.files.importers.rtest import RotaryTestOptions, import_rtest

        if machine is None:
            raise typer.BadParameter("needed for this kind of file", param_hint="--model")
        options = RotaryTestOptions(nest, None, axis, unit, placed)
        campaign = import_rtest(file, machine, placing, options)
    elif layout in (ForeignLayout.LENGTHS, ForeignLayout.PLATE):
        from abbe.compcore.files.importers.artefact_rows import import_lengths, import_plates

        artefact = import_lengths if layout is ForeignLayout.LENGTHS else import_plates
        campaign = artefact(file, machine, placing)
    else:
        from abbe.compcore.files.importers.map_rows import import_map_rows

        campaign = import_map_rows(file, _structure(structure, machine), placing)
    write_campaign(campaign, output)
    for suspicion in of_values(campaign, without_zeros(campaign)):
        say(f"SUSPICIOUS: {suspicion}")
    for note in str(campaign.metadata[0]["notes"]).split("; "):
        say(note)
    say(f"{campaign.n} rows in {_setups(campaign)} → {output}")


def _setups(campaign: Campaign) -> str:
    names = list(campaign.setups)
    return f"set-up {names[0]}" if len(names) == 1 else f"{len(names)} set-ups"


def _structure(code: str | None, machine: Machine | None) -> Structure:
    from abbe.compcore.machine.structure import Structure

    if code is None and machine is not None:
        return machine.structure
    return Structure.parse(_needed(code, "structure"))


def _needed(value: str | None, option: str) -> str:
    if value is None:
        raise typer.BadParameter("needed for this kind of file", param_hint=f"--{option}")
    return value


def _split(text: str, count: int, field: str) -> list[str]:
    from abbe.compcore.errors import InputError

    parts = text.split(",")
    if len(parts) != count:
        raise InputError(f"not {count} numbers", field=field, found=text)
    return parts


def _placing(
    at: str,
    tool: str,
    setup: str,
    sd: float | None,
    signals: list[str],
    sign: int,
    *,
    rotation: bool,
) -> ForeignPlacing:
    from math import radians

    from abbe.compcore.errors import InputError
    from abbe.compcore.files.importers.placing import ForeignPlacing
    from abbe.compcore.machine.plausible import TRAVEL, TRAVEL_ROTARY, signal_range
    from abbe.compcore.machine.structure import is_rotary
    from abbe.daemon.arguments.assignments import number, split_assignments, tool_offset

    if sign not in (1, -1):
        raise typer.BadParameter("1 or -1", param_hint="--sign")
    positions = {}
    for name, text in split_assignments(at.split(",") if at else []).items():
        if not name or name[0] not in "XYZUVWABC":
            raise InputError("not the name of an axis", field="at", found=name)
        rotary = is_rotary(name)
        allowed = TRAVEL_ROTARY if rotary else TRAVEL
        value = number(name, text, "degrees" if rotary else "mm", allowed)
        positions[name] = radians(value) if is_rotary(name) else value
    recorded = {
        n: number(n, v, "its unit", signal_range(None))
        for n, v in split_assignments(signals).items()
    }
    uncertainty = None if sd is None else sd * (1e-6 if rotation else 1e-3)
    return ForeignPlacing(positions, tool_offset("tool", tool), setup, uncertainty, recorded, sign)
