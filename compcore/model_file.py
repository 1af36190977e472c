"""The model file ``*.toml``, format ``abbe-model/1``: load and save, exact in both directions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from compcore.atomic import write_atomically
from compcore.effects.base import Effect
from compcore.effects.registry import make_effect
from compcore.errors import InputError
from compcore.machine import Axis, Machine, Signal, Vec3, nominal_direction
from compcore.model import Composition, Model, Term, Value
from compcore.packed import pack_symmetric, unpack_symmetric
from compcore.structure import Structure, is_rotary
from compcore.toml_source import TomlSource, dotted
from compcore.units import to_internal

FORMAT = "abbe-model/1"
Finite = Annotated[float, Field(allow_inf_nan=False)]
_FileVec = tuple[Finite, Finite, Finite]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _AxisSection(_Section):
    travel: tuple[Finite, Finite]
    rotation_point: Finite | _FileVec = 0.0
    location: _FileVec = (0.0, 0.0, 0.0)
    direction: _FileVec | None = None
    error_acts: Literal["before", "after"] | None = None


class _SignalSection(_Section):
    unit: str = "degC"
    role: str = "other"
    axis: str | None = None
    location: str = ""


class _MachineSection(_Section):
    name: str = ""
    structure: str
    reference_temperature: Finite = 20.0
    composition: Composition = "first-order"
    axes: dict[str, _AxisSection]
    signals: dict[str, _SignalSection] = {}


class _ParameterSection(_Section):
    value: Finite
    sd: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None = None
    unit: str | None = None


class _File(_Section):
    format: Literal["abbe-model/1"]
    machine: _MachineSection
    effects: list[dict[str, Any]] = []
    fit: dict[str, Any] = {}
    history: list[dict[str, Any]] = []


def load_model(path: str | Path) -> Model:
    """Read a model file.

    Raises
    ------
    InputError
        Naming file, line, key, what was found and what was expected.
    """
    return parse_model(TomlSource.read(path))


def parse_model(source: TomlSource) -> Model:
    """A model from TOML text; raises as `load_model`."""
    try:
        file = _File.model_validate(source.data)
    except ValidationError as error:
        raise _told(source, error, ()) from None
    try:
        machine = _machine(file.machine)
        terms = tuple(_term(source, i, section, machine) for i, section in enumerate(file.effects))
        fit = dict(file.fit)
        packed = fit.pop("covariance", None)
        size = sum(len(term.values) for term in terms)
        covariance = None if packed is None else unpack_symmetric(packed, size)
        return Model(machine, terms, file.machine.composition, fit, tuple(file.history), covariance)
    except InputError as error:
        raise source.located(error) from None


def _machine(section: _MachineSection) -> Machine:
    axes = {}
    for name, axis in section.axes.items():
        if not name or name[0] not in "XYZUVWABC":
            raise InputError(
                "not the name of an axis",
                field=f"machine.axes.{name}",
                found=name,
                expected="a letter of X Y Z U V W A B C",
            )
        direction = axis.direction or nominal_direction(name)
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
    )


def _term(source: TomlSource, index: int, section: dict[str, Any], machine: Machine) -> Term:
    keys = dict(section)
    kind = keys.pop("kind", None)
    if not isinstance(kind, str):
        raise source.error("an effect needs its kind", ("effects", index, "kind"), found=kind)
    parameters = keys.pop("parameters", {})
    try:
        effect = make_effect(kind, keys)
        effect.check(machine)
    except InputError as error:
        field = f"effects[{index}]" + (f".{error.field}" if error.field else "")
        raise InputError(
            error.problem, field=field, found=error.found, expected=error.expected
        ) from None
    units = _units(effect, machine)
    values: dict[str, Value] = {}
    for name, raw in parameters.items():
        path = ("effects", index, "parameters", name)
        try:
            parameter = _ParameterSection.model_validate(raw)
        except ValidationError as error:
            raise _told(source, error, path) from None
        if name not in units:
            raise source.error(
                f"{kind} has no such parameter",
                path,
                found=name,
                expected="one of " + ", ".join(units),
            )
        unit = parameter.unit or units[name]
        try:
            value = to_internal(parameter.value, unit, units[name])
            sd = None if parameter.sd is None else to_internal(parameter.sd, unit, units[name])
        except InputError as error:
            raise source.error(
                error.problem, (*path, "unit"), found=error.found, expected=error.expected
            ) from None
        values[name] = Value(value, sd)
    return Term(effect, values)


def _units(effect: Effect, machine: Machine) -> dict[str, str]:
    units = {p.name: p.unit for p in effect.linear(machine)}
    units.update({p.name: p.unit for p in effect.nonlinear(machine)})
    return units


def _told(source: TomlSource, error: ValidationError, prefix: tuple[str | int, ...]) -> InputError:
    first = error.errors()[0]
    path = (*prefix, *first["loc"])
    if first["type"] == "extra_forbidden":
        return source.error("unknown key", path, found=path[-1])
    if first["type"] == "missing":
        return source.error("missing", path, expected=f"a key {dotted(path[-1:])!r}")
    return source.error(first["msg"], path, found=first["input"])


def save_model(model: Model, path: str | Path) -> None:
    """Write a model file, atomically; `load_model` gives back an equal model.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    write_atomically(path, format_model(model))


def format_model(model: Model) -> str:
    """The text of a model file."""
    machine = model.machine
    section: dict[str, Any] = {
        "name": machine.name,
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
    document: dict[str, Any] = {"format": FORMAT, "machine": section}
    document["effects"] = [_effect_table(term, machine) for term in model.terms]
    if model.fit or model.covariance is not None:
        document["fit"] = dict(model.fit)
        if model.covariance is not None:
            document["fit"]["covariance"] = pack_symmetric(model.covariance)
    if model.history:
        document["history"] = [dict(record) for record in model.history]
    return tomli_w.dumps(document)


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
            for name, v in term.values.items()
        }
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
