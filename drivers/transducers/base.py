"""The base of all transducers: one raw number in, one physical value out, or a named fault.

A transducer is pure arithmetic on one channel: counts to mm, ohms to °C, mA to anything. The
core, `Transducer.value`, is a plain float → float that raises `SensorFaultError` when the raw
number is no measurement; `Transducer.convert` wraps it for the pipeline, where a fault becomes
a sample of quality BAD with the fault's name as its reason. A broken wire is never a
temperature.
"""

from __future__ import annotations

import enum
import math
from abc import ABC, abstractmethod

from pydantic import BaseModel, ConfigDict

from abbe.drivers.link import Quality, Sample


class TransducerFault(enum.Enum):
    """The fault of a raw number that is no measurement; the value is the wording for people."""

    BROKEN_WIRE = "broken wire"
    SHORT_CIRCUIT = "short circuit"
    OUT_OF_RANGE = "out of range"
    TRANSMITTER_ALARM = "transmitter alarm"
    COUNT_JUMP = "count jump"
    NOT_REFERENCED = "not referenced"
    NOT_A_NUMBER = "not a number"


class SensorFaultError(ValueError):
    """A raw number that is no measurement.

    Attributes
    ----------
    fault
        Which fault it is.
    detail
        What was found and where the limit lies, e.g. ``4.2 MΩ, above 1 MΩ``.
    """

    def __init__(self, fault: TransducerFault, detail: str) -> None:
        super().__init__(f"{fault.value}: {detail}")
        self.fault = fault
        self.detail = detail


class TransducerConfig(BaseModel):
    """Base of all transducer sections of a configuration; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class Transducer(ABC):
    """One channel's conversion, forward and back.

    Attributes
    ----------
    unit
        Unit of the value: ``mm``, ``rad``, ``degC``, or what the configuration names.
    raw_unit
        Unit in which the raw number must arrive: ``count``, ``ohm``, ``mA``, ...
    """

    unit: str
    raw_unit: str

    @abstractmethod
    def value(self, raw: float) -> float:
        """Physical value of a raw number.

        Raises
        ------
        SensorFaultError
            When the raw number is no measurement; names the fault.
        """

    @abstractmethod
    def inverse(self, value: float) -> float:
        """Raw number that stands for a physical value: `value` backwards.

        Raises
        ------
        SensorFaultError
            When the value cannot be expressed (outside the sensor's or the counter's range).
        """

    def convert(self, raw: Sample) -> Sample:
        """Convert a sample; one that is not good passes with its quality and reason."""
        if raw.quality is not Quality.GOOD:
            return raw
        try:
            return Sample(self.value(raw.value), raw.time)
        except SensorFaultError as fault:
            return Sample(math.nan, raw.time, Quality.BAD, str(fault))


def require_number(raw: float) -> None:
    """Refuse NaN and infinities, which a device may send as float registers."""
    if not math.isfinite(raw):
        raise SensorFaultError(TransducerFault.NOT_A_NUMBER, f"the device sent {raw}")
