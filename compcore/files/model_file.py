"""The model file ``*.toml``, format ``abbe-model/1``: load and save, exact in both directions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import tomli_w

from abbe.compcore.effects.base import Effect, NonlinearParameter, Parameter
from abbe.compcore.effects.registry import make_effect
from abbe.compcore.errors import AbbeError, InputError, require_type
from abbe.compcore.files import formats
from abbe.compcore.files.model_toml.packed_covariance import pack_symmetric, unpack_symmetric
from abbe.compcore.files.model_toml.sections import (
    MachineSection,
    ParameterSection,
    check_covariance,
    check_parameter,
    read_sections,
    shaped,
)
from abbe.compcore.files.text.atomic import write_together
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.machine import Axis, Machine, Signal, Vec3, nominal_direction
from abbe.compcore.machine.structure import Structure, is_rotary
from abbe.compcore.model.model import Model, Switch, Term, Value
from abbe.compcore.units import to_internal


def load_model(path: str | Path) -> Model:
    """Read a model file.

    Raises
    ------
    InputError
        Naming file, line, key, what was found and what was expected.
    """
    return parse_model(TomlSource.read(path))


def parse_model(source: TomlSource, grids: Mapping[str, str] | None = None) -> Model:
    """A model from TOML text; raises as `load_model`.

    `grids`: name → text of grids' files that are at hand; others are read beside the model.
    """
    file = read_sections(source)
    try:
        machine = _machine(file.machine)
        terms = tuple(
            _term(source, i, section, machine, grids) for i, section in enumerate(file.effects)
        )
        fit = dict(file.fit)
        packed = fit.pop("covariance", None)
        model = Model(machine, terms, file.machine.composition, fit, tuple(file.history))
        if packed is None:
            return model
        kept = [
            stays
            for section, term in zip(file.effects, terms, strict=True)
            for stays in _kept(section.get("parameters", {}), term, machine)
        ]
        covariance = unpack_symmetric(packed, len(kept))
        check_covariance(covariance)
        return replace(model, covariance=covariance[np.ix_(kept, kept)])
    except InputError as error:
        if error.file not in (None, source.file):
            raise  # another file's, such as a grid's
        raise source.located(error) from None


def _kept(section: Mapping[str, Any], term: Term, machine: Machine) -> list[bool]:
    """Whether each of an effect's parameters in the covariance of a file is one of a machine."""
    linear = len(term.effect.linear(machine)) if term.values else 0
    gone = sum(name in section for name in term.effect.of_a_run)
    return [True] * linear + [False] * gone + [True] * (len(term.values) - linear)


def _machine(section: MachineSection) -> Machine:
    axes = {}
    for name, axis in section.axes.items():
        direction = axis.direction or nominal_direction(name)
        if not any(direction):
            raise InputError(
                "not a unit vector",
                field=f"machine.axes.{name}.direction",
                found=list(direction),
                expected="three components of a vector of length 1",
            )
        scale = math.pi / 180.0 if is_rotary(name) else 1.0
        point: Vec3
        if isinstance(axis.rotation_point, tuple):
            point = axis.rotation_point
        else:
            x, y, z = (axis.rotation_point * d for d in direction)
            point = (x, y, z)
        axes[name] = Axis(
            name,
            (axis.travel[0] * scale, axis.travel[1] * scale),
            rotation_point=point,
            location=axis.location,
            direction=direction,
            error_acts=axis.error_acts,
        )
    signals = {
        name: Signal(name, s.unit, s.role, s.axis, s.location)
        for name, s in section.signals.items()
    }
    try:
        structure = Structure.parse(section.structure)
    except InputError as error:
        raise InputError(
            error.problem, field="machine.structure", found=error.found, expected=error.expected
        ) from None
    return Machine(
        section.name,
        structure,
        axes,
        signals,
        section.reference_temperature,
        section.serial,
    )


def _term(
    source: TomlSource,
    index: int,
    section: dict[str, Any],
    machine: Machine,
    grids: Mapping[str, str] | None,
) -> Term:
    keys = dict(section)
    kind = keys.pop("kind", None)
    if not isinstance(kind, str):
        raise source.error("an effect needs its kind", ("effects", index, "kind"), found=kind)
    keys.pop("parameters", None)
    switch = _switch(source, keys.pop("switch", "on"), ("effects", index, "switch"))
    switches = keys.pop("tables", {}) if kind == "error_grid" else {}
    if not isinstance(switches, dict):
        raise source.error(
            "not the switches of tables", ("effects", index, "tables"), found=switches,
            expected='{ E_XX = "off", … }',
        )  # fmt: skip
    try:
        effect = make_effect(kind, keys)
        if kind == "error_grid":
            effect = _with_data(effect, machine, source, grids)
        effect.check(machine)
    except InputError as error:
        if error.file is not None:
            raise
        field = f"effects[{index}]" + (f".{error.field}" if error.field else "")
        raise InputError(
            error.problem, field=field, found=error.found, expected=error.expected
        ) from None
    values = _values(source, index, effect, machine, section.get("parameters", {}))
    term = Term(effect, values, switch)
    for name, stated in switches.items():
        here = ("effects", index, "tables", name)
        try:
            term.require_table(name)
        except InputError as error:
            raise source.error(
                error.problem, here, found=error.found, expected=error.expected
            ) from None
        term = replace(term, tables={**term.tables, name: _switch(source, stated, here)})
    return term


def _switch(source: TomlSource, value: object, key: tuple[str | int, ...]) -> Switch:
    for switch in get_args(Switch):
        if value == switch:
            found: Switch = switch
            return found
    raise source.error("not a switch", key, found=value, expected='"on", "off" or "shown"')


def _with_data(
    effect: Effect, machine: Machine, source: TomlSource, grids: Mapping[str, str] | None
) -> Effect:
    from abbe.compcore.effects.catalogue.error_grid import ErrorGrid
    from abbe.compcore.files.grid_file import load_grid

    folder = None if source.file is None else Path(source.file).parent
    return load_grid(effect, machine, folder, grids) if isinstance(effect, ErrorGrid) else effect


def _values(
    source: TomlSource, index: int, effect: Effect, machine: Machine, section: Any
) -> dict[str, Value]:
    """An effect's parameters, in the units inside the code."""
    here = ("effects", index, "parameters")
    if not isinstance(section, dict):
        raise source.error("wrong kind of value", here, found=section, expected="a section")
    known: dict[str, Parameter | NonlinearParameter] = {}
    known.update({p.name: p for p in effect.linear(machine)})
    known.update({p.name: p for p in effect.nonlinear(machine)})
    values: dict[str, Value] = {}
    for name, raw in section.items():
        path = (*here, name)
        parameter = shaped(source, ParameterSection, raw, path)
        if name in effect.of_a_run:
            continue
        if name not in known:
            raise source.error(
                f"{effect.kind} has no such parameter",
                path,
                found=name,
                expected="one of " + ", ".join(known),
            )
        inside = known[name].unit
        unit = parameter.unit or inside
        try:
            value = to_internal(parameter.value, unit, inside)
            sd = None if parameter.sd is None else to_internal(parameter.sd, unit, inside)
            check_parameter(known[name], value, sd)
        except InputError as error:
            raise source.error(
                error.problem,
                (*path, error.field or "unit"),
                found=error.found,
                expected=error.expected,
            ) from None
        values[name] = Value(value, sd, parameter.measured)
    return values


def _units(effect: Effect, machine: Machine) -> dict[str, str]:
    units = {p.name: p.unit for p in effect.linear(machine)}
    units.update({p.name: p.unit for p in effect.nonlinear(machine)})
    return units


def save_model(model: Model, path: str | Path) -> None:
    """Write a model file, atomically; `load_model` gives back an equal model.

    The files of its grids are written beside it where they are not there yet.

    Raises
    ------
    InputError
        When the file cannot be written.
    AbbeError
        When `load_model` would refuse it: nothing is written then.
    """
    require_type(model, Model, "model")
    text = format_model(model)
    grids: dict[str, str] = {}
    missing: dict[Path, str] = {}
    if any(effect.kind == "error_grid" for effect in model.effects):
        from abbe.compcore.files.grid_file import files_to_write, grid_files

        grids, missing = grid_files(model.effects), files_to_write(model.effects, path)
    try:
        parse_model(TomlSource(text), grids)
    except InputError as error:
        raise AbbeError(
            f"{path}: not written, as no such model can be read again: {error}"
        ) from None
    write_together({**missing, Path(path): text})


def format_model(model: Model) -> str:
    """The text of a model file."""
    return tomli_w.dumps(document_of(model))


def document_of(model: Model) -> dict[str, Any]:
    """What a model file holds, section by section."""
    machine = model.machine
    section: dict[str, Any] = {
        "name": machine.name,
        **({"serial": machine.serial} if machine.serial else {}),
        "structure": str(machine.structure),
        "reference_temperature": machine.reference_temperature,
    }
    if model.composition != "first-order":
        section["composition"] = model.composition
    section["axes"] = {name: _axis_table(axis) for name, axis in machine.axes.items()}
    if machine.signals:
        section["signals"] = {
            s.name: {"unit": s.unit, "role": s.role}
            | ({"axis": s.axis} if s.axis else {})
            | ({"location": s.location} if s.location else {})
            for s in machine.signals.values()
        }
    document: dict[str, Any] = {"format": formats.MODEL, "machine": section}
    document["effects"] = [_effect_table(term, machine) for term in model.terms]
    if model.fit or model.covariance is not None:
        document["fit"] = dict(model.fit)
        if model.covariance is not None:
            document["fit"]["covariance"] = pack_symmetric(model.covariance)
    if model.history:
        document["history"] = [dict(record) for record in model.history]
    return document


def _axis_table(axis: Axis) -> dict[str, Any]:
    low, high = axis.travel
    if axis.rotary:
        low, high = _exact_degrees(low), _exact_degrees(high)
    table: dict[str, Any] = {"travel": [low, high]}
    if any(axis.rotation_point):
        table["rotation_point"] = list(axis.rotation_point)
    if any(axis.location):
        table["location"] = list(axis.location)
    if axis.direction != nominal_direction(axis.name):
        table["direction"] = list(axis.direction)
    if axis.error_acts is not None:
        table["error_acts"] = axis.error_acts
    return table


def _exact_degrees(angle: float) -> float:
    """Degrees that read back as the very same radians: conversion must not drift a file."""
    scale = math.pi / 180.0
    degrees = angle / scale
    for candidate in (
        round(degrees, 9),
        degrees,
        np.nextafter(degrees, math.inf),
        np.nextafter(degrees, -math.inf),
    ):
        if float(candidate) * scale == angle:
            return float(candidate)
    return degrees


def _effect_table(term: Term, machine: Machine) -> dict[str, Any]:
    table: dict[str, Any] = {"kind": term.effect.kind, **term.effect.where()}
    if term.values:
        units = _units(term.effect, machine)
        table["parameters"] = {
            name: {"value": v.value}
            | ({} if v.sd is None else {"sd": v.sd})
            | {"unit": units[name]}
            | ({} if v.measured else {"measured": False})
            for name, v in term.values.items()
        }
    if term.switch != "on":
        table["switch"] = term.switch
    if term.tables:
        table["tables"] = dict(term.tables)
    return table


def summary(model: Model) -> Mapping[str, Any]:
    """The model's one-line record for a descendant's ``[[history]]``."""
    return {k: model.fit[k] for k in _KEPT if k in model.fit} | {"effects": len(model.terms)}


_KEPT = (
    "date",
    "campaigns",
    "rms",
    "noise_floor",
    "chi2_per_dof",
    "n",
    "added",
    "removed",
    "holdout",
    "holdout_rms",
    "map",
    "sha256",
    "convention",
    "abbe",
)
"""What of a ``[fit]`` section a descendant remembers."""
