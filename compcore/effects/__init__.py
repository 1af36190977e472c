"""The effects: one file per family, found through the registry.

Families are imported when they are first asked for: a first correction needs two or three of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from abbe.compcore.effects.base import Effect, ErrorMotion, Motion, NonlinearParameter, Parameter
from abbe.compcore.effects.registry import (
    effect_class,
    effect_kinds,
    load_families,
    make_effect,
    register,
)

if TYPE_CHECKING:
    from abbe.compcore.effects.catalogue.dynamic import FeedLag
    from abbe.compcore.effects.catalogue.elastic import CrossAngular, LoadBending, OverhangSag
    from abbe.compcore.effects.catalogue.error_grid import ErrorGrid
    from abbe.compcore.effects.catalogue.events import Drift, Event, WarmUp
    from abbe.compcore.effects.catalogue.formula import Formula
    from abbe.compcore.effects.catalogue.gravity import GravityFlexure
    from abbe.compcore.effects.catalogue.instruments.gauges import GaugeExpansion
    from abbe.compcore.effects.catalogue.instruments.laser import AirRefraction, Cosine, DeadPath
    from abbe.compcore.effects.catalogue.instruments.probing import ProbeLobing, StylusBending
    from abbe.compcore.effects.catalogue.instruments.readings import InstrumentDrift, LengthBias
    from abbe.compcore.effects.catalogue.instruments.setup import (
        SetupFrame,
        SetupScale,
        SetupSlope,
        SetupZero,
    )
    from abbe.compcore.effects.catalogue.instruments.thermometers import (
        SensorBend,
        SensorGain,
        SensorOffset,
    )
    from abbe.compcore.effects.catalogue.linear.linear_axes import (
        Angular,
        Positioning,
        Scale,
        Squareness,
        Straightness,
    )
    from abbe.compcore.effects.catalogue.linear.local import Joint, LocalDefect
    from abbe.compcore.effects.catalogue.linear.periodic import Cyclic
    from abbe.compcore.effects.catalogue.linear.reversal import (
        Backlash,
        LateralReversal,
        ReversalAngle,
    )
    from abbe.compcore.effects.catalogue.linear.two_drives import TwoDrives
    from abbe.compcore.effects.catalogue.rotary.held import SpindleLocation
    from abbe.compcore.effects.catalogue.rotary.location import RotaryLocation
    from abbe.compcore.effects.catalogue.rotary.motions import (
        RotaryAxial,
        RotaryPositioning,
        RotaryRadial,
        RotaryTilt,
    )
    from abbe.compcore.effects.catalogue.rotary.spindle import SpindleSquareness
    from abbe.compcore.effects.catalogue.temperature.angles import ThermalBending, ThermalTilt
    from abbe.compcore.effects.catalogue.temperature.lengths import ScaleExpansion, ScrewHeating
    from abbe.compcore.effects.catalogue.temperature.shifts import ThermalOffset
    from abbe.compcore.effects.catalogue.workpiece import WorkpieceExpansion

__all__ = [
    "AirRefraction",
    "Angular",
    "Backlash",
    "Cosine",
    "CrossAngular",
    "Cyclic",
    "DeadPath",
    "Drift",
    "Effect",
    "ErrorGrid",
    "ErrorMotion",
    "Event",
    "FeedLag",
    "Formula",
    "GaugeExpansion",
    "GravityFlexure",
    "InstrumentDrift",
    "Joint",
    "LateralReversal",
    "LengthBias",
    "LoadBending",
    "LocalDefect",
    "Motion",
    "NonlinearParameter",
    "OverhangSag",
    "Parameter",
    "Positioning",
    "ProbeLobing",
    "ReversalAngle",
    "RotaryAxial",
    "RotaryLocation",
    "RotaryPositioning",
    "RotaryRadial",
    "RotaryTilt",
    "Scale",
    "ScaleExpansion",
    "ScrewHeating",
    "SensorBend",
    "SensorGain",
    "SensorOffset",
    "SetupFrame",
    "SetupScale",
    "SetupSlope",
    "SetupZero",
    "SpindleLocation",
    "SpindleSquareness",
    "Squareness",
    "Straightness",
    "StylusBending",
    "ThermalBending",
    "ThermalOffset",
    "ThermalTilt",
    "TwoDrives",
    "WarmUp",
    "WorkpieceExpansion",
    "effect_class",
    "effect_kinds",
    "make_effect",
    "register",
]


def __getattr__(name: str) -> Any:
    """An effect class by its name, from whichever family it is in."""
    if name in __all__:
        for module in load_families().values():
            if hasattr(module, name):
                return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
