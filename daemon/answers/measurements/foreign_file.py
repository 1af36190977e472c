"""Files of other measuring systems, each layout by its importer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import typer

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.placing import ForeignPlacing
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import TRAVEL, TRAVEL_ROTARY
from abbe.compcore.machine.structure import Structure
from abbe.daemon.arguments.assignments import number, split_assignments, tool_offset
from abbe.daemon.arguments.measurements.foreign_layout import ForeignLayout


@dataclass(frozen=True, kw_only=True)
class ForeignOptions:
    """Options that only some layouts take; None where they are not given.

    Attributes
    ----------
    axis, component, unit
        What moved, what was measured, and the unit of the deviations.
    normalised, expansion, material_temperature
        Laser: whether and how readings were normalised (1/K, °C).
    plane, centre, radius
        Ball bar: its circle, mm.
    nest, placed
        Test of rotary axes: what carries the sensors; whether spheres are where the file states.
    structure
        Map: the structure code.
    measured
        Log: column → what it measures, as typed.
    zero
        Stars: what is added to azimuth and elevation as read, degrees, as typed.
    """

    axis: str | None = None
    component: str | None = None
    unit: str | None = None
    normalised: bool | None = None
    expansion: float | None = None
    material_temperature: float | None = None
    plane: str | None = None
    centre: str | None = None
    radius: float | None = None
    nest: str | None = None
    placed: bool = False
    structure: str | None = None
    measured: Sequence[str] = ()
    zero: str | None = None


def read_foreign(
    layout: ForeignLayout,
    file: Path,
    placing: ForeignPlacing,
    machine: Machine | None,
    options: ForeignOptions,
) -> Campaign:
    """A foreign file as a campaign.

    Parameters
    ----------
    machine
        Of the model, where one is given: then every axis must have its position.

    Raises
    ------
    InputError
        Naming file, line, what was found and expected.
    typer.BadParameter
        When an option that the layout needs is not given.
    """
    return _READERS[layout](file, placing, machine, options)


_Reader = Callable[[Path, ForeignPlacing, Machine | None, ForeignOptions], Campaign]


def _runs(
    file: Path, placing: ForeignPlacing, machine: Machine | None, options: ForeignOptions
) -> Campaign:
    from abbe.compcore.files.importers.lines.iso230_table import import_iso230_table

    axis = _needed(options.axis, "axis")
    return import_iso230_table(
        file, axis, placing, component=options.component, unit=options.unit, machine=machine
    )


def _laser(
    file: Path, placing: ForeignPlacing, machine: Machine | None, options: ForeignOptions
) -> Campaign:
    from abbe.compcore.files.importers.lines.laser_environment import Normalisation
    from abbe.compcore.files.importers.lines.rtl import import_rtl

    return import_rtl(
        file,
        placing,
        axis=options.axis,
        component=options.component,
        unit=options.unit,
        machine=machine,
        normalisation=Normalisation(
            options.normalised, options.expansion, options.material_temperature
        ),
    )


def _ball_bar(
    file: Path, placing: ForeignPlacing, machine: Machine | None, options: ForeignOptions
) -> Campaign:
    from abbe.compcore.files.importers.ballbar import import_ballbar

    middle = None
    if options.centre is not None:
        parts = options.centre.split(",")
        if len(parts) != 2:
            raise InputError("not 2 numbers", field="centre", found=options.centre)
        a, b = (number("centre", part, "mm", TRAVEL) for part in parts)
        middle = a, b
    return import_ballbar(
        file,
        placing,
        plane=options.plane,
        centre=middle,
        radius=options.radius,
        unit=options.unit,
        machine=machine,
    )


def _rotary_test(
    file: Path, placing: ForeignPlacing, machine: Machine | None, options: ForeignOptions
) -> Campaign:
    from abbe.compcore.files.importers.rotary.rotary_test import RotaryTestOptions
    from abbe.compcore.files.importers.rotary.rtest import import_rtest

    if machine is None:
        raise typer.BadParameter("needed for this kind of file", param_hint="--model")
    own = RotaryTestOptions(options.nest, None, options.axis, options.unit, options.placed)
    return import_rtest(file, machine, placing, own)


def _probed(
    file: Path, placing: ForeignPlacing, machine: Machine | None, _: ForeignOptions
) -> Campaign:
    from abbe.compcore.files.importers.rotary.probed import import_probed

    if machine is None:
        raise typer.BadParameter("needed for this kind of file", param_hint="--model")
    return import_probed(file, machine, placing)


def _lengths(
    file: Path, placing: ForeignPlacing, machine: Machine | None, _: ForeignOptions
) -> Campaign:
    from abbe.compcore.files.importers.artefacts.artefact_rows import import_lengths

    return import_lengths(file, machine, placing)


def _plates(
    file: Path, placing: ForeignPlacing, machine: Machine | None, _: ForeignOptions
) -> Campaign:
    from abbe.compcore.files.importers.artefacts.artefact_rows import import_plates

    return import_plates(file, machine, placing)


def _map(
    file: Path, placing: ForeignPlacing, machine: Machine | None, options: ForeignOptions
) -> Campaign:
    from abbe.compcore.files.importers.map_rows import import_map_rows

    if options.structure is None and machine is not None:
        structure = machine.structure
    else:
        structure = Structure.parse(_needed(options.structure, "structure"))
    return import_map_rows(file, structure, placing)


def _log(
    file: Path, placing: ForeignPlacing, machine: Machine | None, options: ForeignOptions
) -> Campaign:
    from abbe.compcore.files.importers.log import LoggedReading, import_log
    from abbe.compcore.files.importers.placing import component_of

    measured = {}
    for column, text in split_assignments(options.measured).items():
        component, at, tool = text.partition("@")
        measured[column] = LoggedReading(
            component_of("X", component or "?"), tool_offset("measured", tool) if at else None
        )
    return import_log(file, placing, measured=measured, unit=options.unit, machine=machine)


def _tracker(
    file: Path, placing: ForeignPlacing, machine: Machine | None, options: ForeignOptions
) -> Campaign:
    from abbe.compcore.files.importers.tracker import import_points

    if machine is None:
        raise typer.BadParameter("needed for this kind of file", param_hint="--model")
    columns = {of: column for column, of in split_assignments(options.measured).items()}
    if columns and set(columns) != set("XYZ"):
        raise typer.BadParameter(
            "COLUMN=X, COLUMN=Y and COLUMN=Z for a tracker's points", param_hint="--measured"
        )
    return import_points(
        file,
        machine,
        placing,
        measured=[columns[of] for of in "XYZ"] if columns else None,
        unit=options.unit or "mm",
        tool_known=any(placing.tool),
    )


def _tpoint(
    file: Path, placing: ForeignPlacing, machine: Machine | None, options: ForeignOptions
) -> Campaign:
    from abbe.compcore.files.importers.tpoint import import_tpoint

    zero = None
    if options.zero is not None:
        parts = options.zero.split(",")
        if len(parts) != 2:
            raise InputError("not 2 numbers", field="zero", found=options.zero)
        azimuth, elevation = (number("zero", part, "degrees", TRAVEL_ROTARY) for part in parts)
        zero = azimuth, elevation
    return import_tpoint(file, placing, zero=zero, machine=machine)


_READERS: Mapping[ForeignLayout, _Reader] = {
    ForeignLayout.ISO230_2: _runs,
    ForeignLayout.RTL: _laser,
    ForeignLayout.BALLBAR: _ball_bar,
    ForeignLayout.MAP: _map,
    ForeignLayout.LENGTHS: _lengths,
    ForeignLayout.PLATE: _plates,
    ForeignLayout.RTEST: _rotary_test,
    ForeignLayout.PROBED: _probed,
    ForeignLayout.LOG: _log,
    ForeignLayout.POINTS: _tracker,
    ForeignLayout.TPOINT: _tpoint,
}


def _needed(value: str | None, option: str) -> str:
    if value is None:
        raise typer.BadParameter("needed for this kind of file", param_hint=f"--{option}")
    return value
