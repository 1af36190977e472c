"""Transducers: from what a device sends to what a model reads, one class per sensor law.

>>> config = TRANSDUCER_CONFIG.validate_python({"type": "pt", "r0": 100.0})
>>> round(make_transducer(config).value(107.7935), 6)
20.0
"""

from __future__ import annotations

from typing import Annotated, assert_never

from pydantic import Field, TypeAdapter

from abbe.drivers.transducers.base import (
    SensorFaultError,
    Transducer,
    TransducerConfig,
    TransducerFault,
)
from abbe.drivers.transducers.degrees import Degrees
from abbe.drivers.transducers.encoder import Encoder, EncoderConfig
from abbe.drivers.transducers.linear import CurrentLoop, CurrentLoopConfig, Linear, LinearConfig
from abbe.drivers.transducers.rtd import Platinum, PtConfig
from abbe.drivers.transducers.table import RTTable, RTTableConfig
from abbe.drivers.transducers.thermistor import (
    BetaConfig,
    NtcRatioConfig,
    SteinhartHartConfig,
    Thermistor,
)

AnyTransducerConfig = Annotated[
    SteinhartHartConfig
    | NtcRatioConfig
    | BetaConfig
    | RTTableConfig
    | PtConfig
    | CurrentLoopConfig
    | LinearConfig
    | EncoderConfig,
    Field(discriminator="type"),
]
"""Every transducer's configuration, told apart by its key ``type``."""

TRANSDUCER_CONFIG: TypeAdapter[AnyTransducerConfig] = TypeAdapter(AnyTransducerConfig)
"""Checks one section of a configuration: ``TRANSDUCER_CONFIG.validate_python({...})``."""


def make_transducer(config: AnyTransducerConfig) -> Transducer:
    """Make the transducer that a configuration describes; one per channel, encoders hold state."""
    match config:
        case SteinhartHartConfig() | NtcRatioConfig() | BetaConfig():
            return Thermistor(config)
        case RTTableConfig():
            return RTTable(config)
        case PtConfig():
            return Platinum(config)
        case CurrentLoopConfig():
            return CurrentLoop(config)
        case LinearConfig():
            return Linear(config)
        case EncoderConfig():
            return Encoder(config)
        case _:
            assert_never(config)


__all__ = [
    "TRANSDUCER_CONFIG",
    "AnyTransducerConfig",
    "BetaConfig",
    "CurrentLoop",
    "CurrentLoopConfig",
    "Degrees",
    "Encoder",
    "EncoderConfig",
    "Linear",
    "LinearConfig",
    "NtcRatioConfig",
    "Platinum",
    "PtConfig",
    "RTTable",
    "RTTableConfig",
    "SensorFaultError",
    "SteinhartHartConfig",
    "Thermistor",
    "Transducer",
    "TransducerConfig",
    "TransducerFault",
    "make_transducer",
]
