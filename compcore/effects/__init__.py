"""The effects: one file per family, found through the registry.

Families are imported when they are first asked for: a first correction needs two or three of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from compcore.effects.base import Channel, Effect, Motion, NonlinearParameter, Parameter
from compcore.effects.registry import (
    effect_class,
    effect_kinds,
    load_families,
    make_effect,
    register,
)

if TYPE_CHECKING:
    from compcore.effects.dynamic import FeedLag
    from compcore.effects.elastic import CrossAngular, LoadBending, OverhangSag
    from compcore.effects.events import Drift, Event, WarmUp
    from compcore.effects.formula import Formula
    from compcore.effects.instrument import InstrumentDrift, LengthBias, SensorOffset
    from compcore.effects.laser import AirRefraction, Cosine, DeadPath
    from compcore.effects.linear_axes import Angular, Positioning, Scale, Squareness, Straightness
    from compcore.effects.local import LocalDefect
    from compcore.effects.periodic import Cyclic
    from compcore.effects.reversal import Backlash, ReversalAngle
    from compcore.effects.rotary_axes import (
        RotaryAxial,
        RotaryLocation,
        RotaryPositioning,
        RotaryRadial,
        RotaryTilt,
        SpindleSquareness,
    )
    from compcore.effects.setup import SetupFrame, SetupSlope, SetupZero
    from compcore.effects.thermal import ScaleExpansion, ScrewHeating, ThermalOffset
    from compcore.effects.thermal_angles import ThermalBending, ThermalTilt
    from compcore.effects.workpiece import WorkpieceExpansion

__all__ = [
    "AirRefraction",
    "Angular",
    "Backlash",
    "Channel",
    "Cosine",
    "CrossAngular",
    "Cyclic",
    "DeadPath",
    "Drift",
    "Effect",
    "Event",
    "FeedLag",
    "Formula",
    "InstrumentDrift",
    "LengthBias",
    "LoadBending",
    "LocalDefect",
    "Motion",
    "NonlinearParameter",
    "OverhangSag",
    "Parameter",
    "Positioning",
    "ReversalAngle",
    "RotaryAxial",
    "RotaryLocation",
    "RotaryPositioning",
    "RotaryRadial",
    "RotaryTilt",
    "Scale",
    "ScaleExpansion",
    "ScrewHeating",
    "SensorOffset",
    "SetupFrame",
    "SetupSlope",
    "SetupZero",
    "SpindleSquareness",
    "Squareness",
    "Straightness",
    "ThermalBending",
    "ThermalOffset",
    "ThermalTilt",
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
