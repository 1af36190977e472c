"""The file of a part program: features, how they are touched, what is evaluated of them.

docs/uncertainty.md is its page. As TOML, or as a CSV of touched points with the same keys behind
``#`` at its top.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from abbe.compcore.errors import InputError
from abbe.compcore.files.part_points import MOST_POINTS, csv_document
from abbe.compcore.files.text.bounded_text import read_bounded
from abbe.compcore.files.text.toml_bounds import MOST_BYTES
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import position_range, signal_range
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.virtual_cmm.features import (
    ANGULAR,
    ElementKind,
    PartCharacteristic,
    Quantity,
    TouchedFeature,
)
from abbe.compcore.virtual_cmm.part_program import (
    PartProgram,
    PartWarmth,
    ProbeUncertainty,
    SignalState,
    StylusAtHand,
)
from abbe.compcore.virtual_cmm.touched_patterns import (
    FeatureName,
    PlacedPattern,
    from_pattern,
    from_points,
)

_UM = 1e-3
_Number = Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e6)]
_Sd = Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=1e4)]
_Vector = tuple[_Number, _Number, _Number]
_Name = Annotated[str, Field(min_length=1, max_length=60, pattern=r"^[^\x00-\x1f\"\\,]+$")]
_Size = Annotated[float, Field(ge=1e-3, le=1e5)]
_MOST = 500


class _PartSection(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class StylusSection(_PartSection):
    """``[styli.NAME]``: mm."""

    offset: _Vector = (0.0, 0.0, 0.0)
    radius: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0


class ProbeSection(_PartSection):
    """``[probe]``: standard uncertainties and an amplitude, µm."""

    repeatability: _Sd = 0.0
    tip: _Sd = 0.0
    lobing: _Sd = 0.0


class SignalStateSection(_PartSection):
    """``[signals]``: ``T_x = 20.5``, or ``T_x = { value = 20.5, sd = 0.05, varies = 1.0 }``."""

    value: _Number
    sd: _Sd = 0.0
    varies: _Sd = 0.0


class WarmthSection(_PartSection):
    """``[part]``: °C, K, ppm/K; where it lies, mm."""

    temperature: Annotated[float, Field(ge=-50.0, le=200.0)] = 20.0
    temperature_sd: Annotated[float, Field(ge=0.0, le=50.0)] = 0.0
    expansion: Annotated[float, Field(ge=-5.0, le=100.0)] = 0.0
    expansion_sd: Annotated[float, Field(ge=0.0, le=50.0)] = 0.0
    reduced: bool = True
    origin: _Vector = (0.0, 0.0, 0.0)
    x: _Vector = (1.0, 0.0, 0.0)
    z: _Vector = (0.0, 0.0, 1.0)


class FeatureSection(_PartSection):
    """``[[features]]``: by its points, or by a pattern; the part's coordinates, mm and degrees."""

    name: _Name
    kind: ElementKind
    stylus: str = ""
    surface: _Sd = 0.0
    points: Annotated[tuple[_Vector, ...], Field(max_length=MOST_POINTS)] = ()
    normals: Annotated[tuple[_Vector, ...], Field(max_length=MOST_POINTS)] = ()
    at: _Vector | None = None
    axis: _Vector = (0.0, 0.0, 1.0)
    diameter: _Size | None = None
    inside: bool = False
    count: Annotated[int, Field(ge=1, le=MOST_POINTS)] | None = None
    start: _Number = 0.0
    span: Annotated[float, Field(ge=1.0, le=360.0)] = 360.0
    length: _Size | None = None
    levels: Annotated[int, Field(ge=2, le=100)] = 2
    size: tuple[_Size, _Size] | None = None
    grid: tuple[Annotated[int, Field(ge=1, le=100)], Annotated[int, Field(ge=1, le=100)]] = (3, 3)


class CharacteristicSection(_PartSection):
    """``[[characteristics]]``; tolerance: the zone's whole width, µm, of angles µrad."""

    name: _Name
    what: Quantity
    of: Annotated[tuple[str, ...], Field(min_length=1, max_length=2)]
    datums: Annotated[tuple[str, ...], Field(max_length=3)] = ()
    along: _Vector | None = None
    tolerance: Annotated[float, Field(gt=0.0, le=1e6)] | None = None


class _PartDocument(_PartSection):
    format: Literal["abbe-part/1"]
    name: Annotated[str, Field(max_length=200)] = ""
    time: _Number | None = None
    styli: Annotated[dict[_Name, StylusSection], Field(max_length=50)] = {}
    probe: ProbeSection = ProbeSection()
    signals: Annotated[dict[str, _Number | SignalStateSection], Field(max_length=1000)] = {}
    part: WarmthSection = WarmthSection()
    features: Annotated[tuple[FeatureSection, ...], Field(min_length=1, max_length=_MOST)]
    characteristics: Annotated[tuple[CharacteristicSection, ...], Field(max_length=_MOST)] = ()


def read_part(path: str | Path, machine: Machine) -> PartProgram:
    """Read a part program for a machine.

    Raises
    ------
    InputError
        Naming file, line and key: for unknown keys, points that determine no feature, signals that
        the machine lacks, points that it does not reach.
    """
    text = read_bounded(path, MOST_BYTES, expected="a part program")
    return parse_part(text, machine, str(path))


def parse_part(text: str, machine: Machine, file: str | None = None) -> PartProgram:
    """As `read_part`, from the file's text.

    Raises
    ------
    InputError
        As `read_part`.
    """
    text = text.replace("\r\n", "\n")
    if text.lstrip().startswith(("#", "feature")) and _is_table(text):
        head, features, line_of = csv_document(text, file)
        source = TomlSource(head, file)
        data = {**source.data, "features": features}
    else:
        source, line_of = TomlSource(text, file), {}
        data = source.data
    try:
        found = _PartDocument.model_validate(data)
    except ValidationError as error:
        raise source.invalid(error) from None
    try:
        program = _program(found, machine)
    except InputError as error:
        raise _located(error, source, line_of) from None
    return program


def _is_table(text: str) -> bool:
    """Whether what does not begin with # is a table of points."""
    for line in text.splitlines():
        if line.strip() and not line.lstrip(' "').startswith("#"):
            return line.split(",")[0].strip().strip('"') == "feature"
    return False


def _located(error: InputError, source: TomlSource, line_of: Mapping[int, int]) -> InputError:
    """With the line: of a table's feature that of its first point."""
    name = error.field or ""
    if line_of and name.startswith("features["):
        number = int(name.removeprefix("features[").partition("]")[0])
        return error.at(file=source.file, line=line_of.get(number))
    return source.located(error)


def _program(found: _PartDocument, machine: Machine) -> PartProgram:
    turn = _turn(found.part)
    origin = np.array(found.part.origin)
    styli = {name: StylusAtHand(s.offset, s.radius) for name, s in found.styli.items()}
    styli = styli or {"1": StylusAtHand()}
    features = []
    for i, section in enumerate(found.features):
        try:
            own = _feature(section, next(iter(styli)), PlacedPattern(origin, turn))
        except InputError as error:
            key = "" if error.field is None else f".{error.field}"
            raise InputError(
                error.problem, field=f"features[{i}]{key}", found=error.found,
                expected=error.expected,
            ) from None  # fmt: skip
        features.append(own)
    if (count := sum(len(f.points) for f in features)) > MOST_POINTS:
        raise InputError("too many points", field="features", found=count,
                         expected=f"{MOST_POINTS} or fewer of all features")  # fmt: skip
    written = [_characteristic(section, turn) for section in found.characteristics]
    probe = found.probe
    program = PartProgram(
        found.name,
        tuple(features),
        tuple(written or _usual(features)),
        styli,
        ProbeUncertainty(probe.repeatability * _UM, probe.tip * _UM, probe.lobing * _UM),
        PartWarmth(
            found.part.temperature,
            found.part.temperature_sd,
            found.part.expansion * 1e-6,
            found.part.expansion_sd * 1e-6,
            found.part.reduced,
        ),
        *_recorded(found, machine),
        found.time,
    )
    _require_reached(program, machine)
    return program


def _turn(part: WarmthSection) -> np.ndarray:
    """Rotation of the part's coordinates into the machine's, (3, 3)."""
    z, x = np.array(part.z), np.array(part.x)
    y = np.cross(z, x)
    size = float(np.linalg.norm(y))
    if size < 1e-6 * max(float(np.linalg.norm(z) * np.linalg.norm(x)), 1e-300):
        raise InputError("x and z point the same way, or nowhere", field="part.x",
                         found=list(part.x), expected="directions across each other")  # fmt: skip
    z, y = z / np.linalg.norm(z), y / size
    return np.stack([np.cross(y, z), y, z], axis=1)


def _feature(section: FeatureSection, first: str, placed: PlacedPattern) -> TouchedFeature:
    stylus = section.stylus or first
    named = FeatureName(section.name, section.kind, stylus, section.surface * _UM)
    if section.points:
        if section.at is not None or section.count is not None:
            raise InputError("points and a pattern", field="points", expected="one of the two")
        if len(section.normals) not in (1, len(section.points)):
            raise InputError(
                "a direction for each point, or one for all", field="normals",
                found=len(section.normals), expected=f"1 or {len(section.points)}",
            )  # fmt: skip
        normals = np.broadcast_to(np.array(section.normals), (len(section.points), 3))
        return from_points(np.array(section.points), normals, placed, named)
    return from_pattern(
        placed, named, at=section.at, axis=section.axis, diameter=section.diameter,
        inside=section.inside, count=section.count, start=math.radians(section.start),
        span=math.radians(section.span), length=section.length, levels=section.levels,
        size=section.size, grid=section.grid,
    )  # fmt: skip


def _characteristic(section: CharacteristicSection, turn: np.ndarray) -> PartCharacteristic:
    along = None
    if section.along is not None:
        size = float(np.linalg.norm(section.along))
        if size < 1e-9:
            raise InputError("not a direction", field="along", found=list(section.along))
        along = turn @ (np.array(section.along) / size)
    tolerance = section.tolerance
    if tolerance is not None:
        tolerance *= 1e-6 if section.what in ANGULAR else _UM
    return PartCharacteristic(
        section.name, section.what, section.of, section.datums, along, tolerance
    )


_USUAL: Mapping[str, tuple[Quantity, ...]] = {
    "plane": ("flatness",),
    "circle": ("diameter", "roundness"),
    "sphere": ("diameter", "sphericity"),
    "cylinder": ("diameter", "cylindricity"),
}


def _usual(features: list[TouchedFeature]) -> list[PartCharacteristic]:
    """Size and form of each feature, and the distance of each from the one before it."""
    found = []
    before: TouchedFeature | None = None
    for feature in features:
        found += [
            PartCharacteristic(f"{what} {feature.name}", what, (feature.name,))
            for what in _USUAL.get(feature.kind, ())
        ]
        if before is not None:
            names = (before.name, feature.name)
            found.append(PartCharacteristic(f"distance {' – '.join(names)}", "distance", names))
        before = feature
    return found


def _recorded(
    found: _PartDocument, machine: Machine
) -> tuple[dict[str, SignalState], dict[str, float]]:
    """Signals by name, and where axes other than X, Y, Z stand, mm (rotary: rad)."""
    signals: dict[str, SignalState] = {}
    standing: dict[str, float] = {}
    for name, given in found.signals.items():
        state = given if isinstance(given, SignalStateSection) else SignalStateSection(value=given)
        where = f"signals.{name}"
        if name in machine.axes and name not in "XYZ":
            allowed = position_range(machine.axes[name])
            standing[name] = math.radians(state.value) if is_rotary(name) else state.value
        elif name in machine.signals:
            allowed = signal_range(machine.signals[name])
            signals[name] = SignalState(state.value, state.sd, state.varies)
        else:
            known = [*machine.signals, *(a for a in machine.axes if a not in "XYZ")]
            raise InputError(
                "the model knows no such signal or axis", field=where, found=name,
                expected="one of " + (", ".join(known) or "none"),
            )  # fmt: skip
        if not allowed.holds(state.value):
            raise InputError(
                "not believable", field=where, found=state.value, expected=str(allowed)
            )
    return signals, standing


def _require_reached(program: PartProgram, machine: Machine) -> None:
    at = program.tips - program.offsets
    for k, axis in enumerate("XYZ"):
        if axis not in machine.axes:
            continue
        low, high = machine.axes[axis].travel
        names = [f.name for f in program.features for _ in f.points]
        outside = np.maximum(low - at[:, k], at[:, k] - high)
        row = int(np.argmax(outside))
        if outside[row] > 1e-6:
            number = [f.name for f in program.features].index(names[row])
            raise InputError(
                f"the machine does not reach it: {axis} would stand at {at[row, k]:.6g}",
                field=f"features[{number}]", found=names[row],
                expected=f"{low:g} to {high:g} mm: [part] origin and the stylus's offset place it",
            )  # fmt: skip
