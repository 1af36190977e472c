"""The sections of a model file, as they may stand there: types, and what each number can be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from abbe.compcore.effects.base import NonlinearParameter, Parameter
from abbe.compcore.errors import InputError
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.plausible import (
    POINT,
    REFERENCE_TEMPERATURE,
    SHORTEST_TRAVEL,
    TRAVEL,
    TRAVEL_ROTARY,
    Range,
)
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Composition

F64 = NDArray[np.float64]

_BEYOND = 1e5
"""A parameter beyond this many times what a sound machine shows is no parameter of a machine."""
_BEYOND_SD = 1e6
"""The same of its standard deviation: what cannot be determined may be uncertain by much."""
_NO_COVARIANCE = 1e30
"""No product of two uncertainties, in whatever units, is as large."""


def _within(allowed: Range) -> Callable[[float], float]:
    def check(value: float) -> float:
        if not allowed.holds(value):
            raise InputError("not believable", found=value, expected=str(allowed))
        return value

    return check


Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]
_Coordinate = Annotated[Finite, AfterValidator(_within(POINT))]
_Direction = Annotated[Finite, AfterValidator(_within(Range(-1.0, 1.0, "")))]
_FileVec = tuple[_Coordinate, _Coordinate, _Coordinate]


class _ModelSection(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class ModelAxisSection(_ModelSection):
    """``[machine.axes.NAME]``; mm, rotary degrees."""

    travel: tuple[Finite, Finite]
    rotation_point: _Coordinate | _FileVec = 0.0
    location: _FileVec = (0.0, 0.0, 0.0)
    direction: tuple[_Direction, _Direction, _Direction] | None = None
    error_acts: Literal["before", "after"] | None = None


class _SignalSection(_ModelSection):
    unit: str = "degC"
    role: str = "other"
    axis: str | None = None
    location: str = ""


class MachineSection(_ModelSection):
    """``[machine]``."""

    name: str = ""
    serial: Annotated[str, Field(max_length=200)] = ""
    structure: Annotated[str, Field(max_length=200)]
    reference_temperature: Annotated[Finite, AfterValidator(_within(REFERENCE_TEMPERATURE))] = 20.0
    composition: Composition = "first-order"
    axes: dict[str, ModelAxisSection]
    signals: dict[str, _SignalSection] = {}


class ParameterSection(_ModelSection):
    """``[effects.parameters.NAME]``."""

    value: Finite
    sd: Annotated[Finite, Field(ge=0.0)] | None = None
    unit: str | None = None
    measured: bool = True


class _StatedConditions(BaseModel):
    """Conditions of a campaign, as said and as seen (`abbe.compcore.campaign`)."""

    model_config = ConfigDict(extra="allow", frozen=True, defer_build=True)
    machine: str = ""
    serial: str = ""
    date: str = ""
    operator: str = ""
    instrument: str = ""
    environment: str = ""
    warm_up: str = ""
    load: str = ""
    feed: str = ""
    other_axes: str = ""
    measuring_tool: str = ""
    notes: str = ""
    signals: dict[str, tuple[Finite, Finite]] = {}
    positions: dict[str, tuple[Finite, Finite]] = {}
    tool: list[tuple[Finite, Finite]] = []


class _Measured(BaseModel):
    model_config = ConfigDict(extra="allow", frozen=True, defer_build=True)
    file: str = ""
    sha256: str = ""
    rms: Finite = 0.0
    noise_floor: Finite = 0.0
    conditions: _StatedConditions = _StatedConditions()


class _Record(BaseModel):
    """``[fit]`` or one of ``[[history]]``; keys that nobody here reads may be anything."""

    model_config = ConfigDict(extra="allow", frozen=True, defer_build=True)
    date: str = ""
    campaigns: list[_Measured] = []
    holdout: list[_Measured] = []
    n: Annotated[int, Field(strict=True)] = 0
    rms: Finite = 0.0
    holdout_rms: Finite = 0.0
    noise_floor: Finite = 0.0
    chi2_per_dof: Finite = 0.0
    effects: Annotated[int, Field(strict=True)] = 0
    added: str = ""
    removed: str = ""
    abbe: str = ""


class _Ranges(BaseModel):
    """Where signals, axes and the tool's offset ranged, and how far temperatures were apart."""

    model_config = ConfigDict(extra="allow", frozen=True, defer_build=True)
    signals: dict[str, tuple[Finite, Finite]] = {}
    differences: dict[str, dict[str, tuple[Finite, Finite]]] = {}
    positions: dict[str, tuple[Finite, Finite]] = {}
    tool: list[tuple[Finite, Finite]] = []


class _Fit(_Record):
    covariance: str | None = None
    measured: _Ranges = _Ranges()


class ModelSections(_ModelSection):
    """A whole model file; effects are checked by their own classes afterwards."""

    format: Literal["abbe-model/1"]
    machine: MachineSection
    effects: list[dict[str, Any]] = []
    fit: dict[str, Any] = {}
    history: list[dict[str, Any]] = []


Shape = TypeVar("Shape", bound=BaseModel)


def read_sections(source: TomlSource) -> ModelSections:
    """The sections of a model file, what stands in each of the right kind and believable.

    Raises
    ------
    InputError
        Naming file, line, key, what was found and what was expected.
    """
    file = shaped(source, ModelSections, source.data, ())
    for name, axis in file.machine.axes.items():
        if not name or name[0] not in "XYZUVWRABC":
            raise source.error(
                "not the name of an axis",
                ("machine", "axes", name),
                found=name,
                expected="a letter of X Y Z U V W A B C",
            )
        _check_travel(source, name, axis)
    shaped(source, _Fit, file.fit, ("fit",))
    for i, record in enumerate(file.history):
        shaped(source, _Record, record, ("history", i))
    return file


def shaped(
    source: TomlSource, shape: type[Shape], value: Any, prefix: Sequence[str | int]
) -> Shape:
    """A part of the file as the section that it must be; raises as `read_sections`."""
    try:
        return shape.model_validate(value)
    except ValidationError as error:
        raise source.invalid(error, prefix) from None


def _check_travel(source: TomlSource, name: str, axis: ModelAxisSection) -> None:
    path = ("machine", "axes", name, "travel")
    allowed = TRAVEL_ROTARY if is_rotary(name) else TRAVEL
    for end in axis.travel:
        if not allowed.holds(end):
            raise source.error("not believable", path, found=end, expected=str(allowed))
    low, high = axis.travel
    if 0.0 < high - low < SHORTEST_TRAVEL:
        raise source.error(
            "too short a travel",
            path,
            found=[low, high],
            expected=f"at least {SHORTEST_TRAVEL:g} {allowed.unit}",
        )


def check_parameter(
    parameter: Parameter | NonlinearParameter, value: float, sd: float | None
) -> None:
    """Refuse a value or standard deviation that no machine can have; in the units inside the code.

    Raises
    ------
    InputError
        With field ``value`` or ``sd``, what was found and what was expected.
    """
    if isinstance(parameter, NonlinearParameter) and parameter.bounds[0] > 0.0 >= value:
        raise InputError(
            "not believable", field="value", found=value, expected=f"above 0 {parameter.unit}"
        )
    largest = max(map(abs, parameter.plausible))
    if not 0.0 < largest < np.inf:
        return
    for field, number, times in (("value", value, _BEYOND), ("sd", sd, _BEYOND_SD)):
        if number is not None and not abs(number) <= times * largest:
            low, high = parameter.plausible
            raise InputError(
                "not believable",
                field=field,
                found=number,
                expected=f"within ±{times * largest:g} {parameter.unit}; "
                f"a sound machine shows {low:g} to {high:g}",
            )


def check_covariance(covariance: F64) -> None:
    """Refuse what is no covariance: not finite, or a variance below 0, (p, p).

    Raises
    ------
    InputError
        Naming the key.
    """
    if not (np.abs(covariance) < _NO_COVARIANCE).all():
        raise InputError(
            "the covariance holds what is none", field="fit.covariance", expected="finite numbers"
        )
    variance = np.diag(covariance)
    if (variance < 0.0).any():
        raise InputError(
            "a variance below 0",
            field="fit.covariance",
            found=float(variance.min()),
            expected="0 or more",
        )
