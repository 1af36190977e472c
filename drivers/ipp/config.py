"""The configuration section of an I++ DME link: a server, and what is asked of it.

::

    [links.cmm]
    driver = "ipp"
    host = "192.168.0.20"
    [links.cmm.channels]
    x = { axis = "X" }
    T_x = { scale_temperature = "X", every = 5.0 }
    T_part = { property = "Part.Temperature", unit = "degC", every = 5.0 }

``docs/ipp.md`` is the user's page on each key.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from abbe.drivers.quarantine import QuarantineConfig
from abbe.drivers.scaled import ScaledNumber

_STRICT = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

Axis = Literal["X", "Y", "Z", "R", "Tool.A", "Tool.B", "Tool.C"]
"""What ``Get`` and ``OnMoveReportE`` know: linear axes, rotary table, angles of the probe head."""
Coordinates = Literal[
    "MachineCsy", "MoveableMachineCsy", "MultipleArmCsy", "RotaryTableVarCsy", "PartCsy", "any"
]

_SIGNALS_EVERY = 1.0


class IppChannelConfig(ScaledNumber):
    """One value: of an axis, of a property, or the temperature of a scale."""

    model_config = _STRICT

    axis: Axis | None = None
    """A position, by ``Get`` or from the move report."""
    prop: Annotated[
        str | None, Field(alias="property", pattern=r"^[A-Za-z]\w*(\.[A-Za-z]\w*)*$")
    ] = None
    """A property, by ``GetProp``, e.g. ``Part.Temperature``; the key is ``property``."""
    scale_temperature: Literal["X", "Y", "Z", "R", "A", "B", "C"] | None = None
    """The temperature of an axis's scale, by ``GetScaleTemperatures``."""
    item: Annotated[int, Field(ge=1)] = 1
    """Which number of a property that has several, from 1."""
    every: Annotated[float, Field(ge=0)] | None = None
    """s between two questions; 0 asks at every call. Default 0 for an axis, else 1."""
    unit: str | None = None
    """Unit of the value; default mm for X, Y, Z, deg for angles, degC for scale temperatures."""

    @property
    def period(self) -> float:
        """Time between two questions, s."""
        if self.every is not None:
            return self.every
        return 0.0 if self.axis is not None else _SIGNALS_EVERY

    @property
    def value_unit(self) -> str:
        """Unit of the value; empty when it is not known."""
        if self.unit is not None:
            return self.unit
        if self.scale_temperature is not None:
            return "degC"
        if self.axis is None:
            return ""
        return "mm" if self.axis in ("X", "Y", "Z") else "deg"

    @model_validator(mode="after")
    def _consistent(self) -> IppChannelConfig:
        given = {
            "axis": self.axis, "property": self.prop, "scale_temperature": self.scale_temperature,
        }  # fmt: skip
        kinds = [kind for kind, value in given.items() if value is not None]
        if len(kinds) != 1:
            raise ValueError(
                "needs one of axis, property, scale_temperature"
                + (f"; found {' and '.join(kinds)}" if kinds else "")
            )
        if self.item != 1 and self.prop is None:
            raise ValueError("item: only for a property")
        return self


class MoveReportConfig(BaseModel):
    """Positions that the server sends by itself, by ``OnMoveReportE``."""

    model_config = _STRICT

    time: Annotated[float, Field(ge=0.1)]
    """s after which a position is reported even if the machine stands still."""
    distance: Annotated[float, Field(gt=0)]
    """mm of motion after which one is reported."""
    within: Annotated[float, Field(gt=0)] | None = None
    """s without a report after which positions count as missing; default three times `time`."""

    @property
    def wait_limit(self) -> float:
        """Time without a report after which positions count as missing, s."""
        return 3.0 * self.time if self.within is None else self.within

    @model_validator(mode="after")
    def _patient(self) -> MoveReportConfig:
        if self.wait_limit <= self.time:
            raise ValueError(
                f"within {self.within:g} s is not more than time {self.time:g} s: a machine that "
                "stands still would count as silent"
            )
        return self


class IppConfig(QuarantineConfig):
    """One I++ DME server and what is asked of it. Times are in s."""

    model_config = _STRICT

    host: Annotated[str, Field(min_length=1)]
    port: Annotated[int, Field(ge=1, le=65535)] = 1294
    timeout: Annotated[float, Field(gt=0, le=60)] = 1.0
    """For a command to be completed."""
    reconnect_min: Annotated[float, Field(gt=0)] = 0.5
    reconnect_max: Annotated[float, Field(gt=0)] = 10.0
    coordinates: Coordinates = "MachineCsy"
    """The coordinate system that positions must be in; ``any``: it is not asked."""
    coordinates_every: Annotated[float, Field(ge=0)] = 1.0
    """Between two looks at it."""
    clear_errors: bool = False
    """Whether the link sends ``ClearAllErrors()`` by itself."""
    move_report: MoveReportConfig | None = None
    """Positions sent by the server; none: asked for."""
    max_waiting: Annotated[int, Field(ge=1)] = 16
    """Calls that may wait for the server; one more is turned away at once."""
    channels: Annotated[dict[str, IppChannelConfig], Field(min_length=1)]

    @property
    def axes(self) -> tuple[Axis, ...]:
        """All axes that some channel wants, each once."""
        return tuple(dict.fromkeys(c.axis for c in self.channels.values() if c.axis is not None))

    def every(self, channel: str) -> float:
        """Time between two values of a channel, s; 0: at every call."""
        section = self.channels[channel]
        if section.axis is not None and self.move_report is not None:
            return self.move_report.time
        return section.period

    @model_validator(mode="after")
    def _reports_fit(self) -> IppConfig:
        if self.move_report is None:
            return self
        if not self.axes:
            raise ValueError("move_report: no channel has an axis to be reported")
        for name, channel in self.channels.items():
            if channel.axis is not None and channel.every is not None:
                raise ValueError(
                    f"channel {name!r}: every does not go with move_report, whose time and "
                    "distance say how often"
                )
        return self
