"""A part program: the features of a part, with what they are touched, how warm everything is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.virtual_cmm.features import (
    FEWEST,
    PartCharacteristic,
    TouchedFeature,
    check_characteristic,
)

F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class StylusAtHand:
    """A stylus: offset of its tip, mm, and the tip's radius, mm."""

    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float = 0.0


@dataclass(frozen=True, slots=True)
class ProbeUncertainty:
    """How sure one touch is; standard uncertainties, mm.

    Attributes
    ----------
    repeatability
        Of one touch along its direction, by probe and machine together.
    tip
        Of the calibrated radius of a tip: the same in all touches by one stylus.
    lobing
        Amplitude of a three-lobed dependence on the direction in the plane across the stylus, the
        orientation of which nobody knows.
    """

    repeatability: float = 0.0
    tip: float = 0.0
    lobing: float = 0.0


@dataclass(frozen=True, slots=True)
class SignalState:
    """A signal of the machine while the part is measured, in its own unit.

    Attributes
    ----------
    value
        Its middle.
    sd
        Standard uncertainty of the sensor's calibration: reading less truth, the same all the time.
    varies
        Half of the range in which it lies from part to part; the sensor sees it.
    """

    value: float
    sd: float = 0.0
    varies: float = 0.0


@dataclass(frozen=True, slots=True)
class PartWarmth:
    """The part's thermal expansion while it is measured.

    Attributes
    ----------
    temperature, temperature_sd
        As read, °C, and its standard uncertainty, K.
    expansion, expansion_sd
        Coefficient as it is reckoned with, and its standard uncertainty, 1/K.
    reduced
        Whether lengths are reduced to 20 °C by these.
    """

    temperature: float = 20.0
    temperature_sd: float = 0.0
    expansion: float = 0.0
    expansion_sd: float = 0.0
    reduced: bool = True


@dataclass(frozen=True, eq=False)
class PartProgram:
    """What is touched on a part, with what, how warm everything is, and what is evaluated.

    Attributes
    ----------
    name
        Of the part.
    features, characteristics
        In the file's order.
    styli
        By name.
    probe, warmth
        How sure a touch is; the part's expansion.
    signals
        Signals of the machine by name.
    standing
        Where axes other than X, Y, Z stand, mm (rotary: rad).
    time
        s since the start that the model was fitted with; None: not stated.
    """

    name: str
    features: tuple[TouchedFeature, ...]
    characteristics: tuple[PartCharacteristic, ...]
    styli: Mapping[str, StylusAtHand] = field(default_factory=lambda: {"1": StylusAtHand()})
    probe: ProbeUncertainty = ProbeUncertainty()
    warmth: PartWarmth = PartWarmth()
    signals: Mapping[str, SignalState] = field(default_factory=dict)
    standing: Mapping[str, float] = field(default_factory=dict)
    time: float | None = None

    def __post_init__(self) -> None:
        known: dict[str, TouchedFeature] = {}
        for i, feature in enumerate(self.features):
            where = f"features[{i}]"
            if feature.name in known:
                raise InputError("a name twice", field=f"{where}.name", found=feature.name)
            known[feature.name] = feature
            if len(feature.points) < FEWEST[feature.kind]:
                raise InputError(
                    f"too few points of a {feature.kind}", field=f"{where}.points",
                    found=len(feature.points), expected=f"{FEWEST[feature.kind]} or more",
                )  # fmt: skip
            if feature.stylus not in self.styli:
                raise InputError(
                    "no such stylus", field=f"{where}.stylus", found=feature.stylus,
                    expected="one of " + ", ".join(self.styli),
                )  # fmt: skip
        names: set[str] = set()
        for i, one in enumerate(self.characteristics):
            where = f"characteristics[{i}]"
            if one.name in names:
                raise InputError("a name twice", field=f"{where}.name", found=one.name)
            names.add(one.name)
            check_characteristic(one, known, where)
        if not self.characteristics:
            raise InputError(
                "nothing is evaluated", field="characteristics", expected="one or more"
            )

    @property
    def points(self) -> F64:
        """Nominal surface points of all features one after the other, shape (n, 3), mm."""
        return np.concatenate([f.points for f in self.features])

    @property
    def normals(self) -> F64:
        """Unit vectors out of the material at them, shape (n, 3)."""
        return np.concatenate([f.normals for f in self.features])

    @property
    def offsets(self) -> F64:
        """Offset of the stylus at each of them, shape (n, 3), mm."""
        return np.concatenate(
            [np.tile(self.styli[f.stylus].offset, (len(f.points), 1)) for f in self.features]
        )

    @property
    def tips(self) -> F64:
        """Where the tip's centre is when the surface points are touched, shape (n, 3), mm."""
        radius = np.concatenate(
            [np.full(len(f.points), self.styli[f.stylus].radius) for f in self.features]
        )
        return np.asarray(self.points + radius[:, None] * self.normals)

    def split(self, points: F64) -> dict[str, F64]:
        """Points of all features, shape (..., n, 3), by feature."""
        found, at = {}, 0
        for feature in self.features:
            count = len(feature.points)
            found[feature.name] = points[..., at : at + count, :]
            at += count
        return found
