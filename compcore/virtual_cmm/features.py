"""Features of a part, how they are touched, and the figures that are evaluated of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError

F64 = NDArray[np.float64]

ElementKind = Literal["point", "plane", "circle", "sphere", "cylinder"]
Quantity = Literal[
    "distance",
    "diameter",
    "flatness",
    "roundness",
    "sphericity",
    "cylindricity",
    "angle",
    "x",
    "y",
    "z",
    "position",
]
FEWEST: Mapping[str, int] = {"point": 1, "plane": 3, "circle": 3, "sphere": 4, "cylinder": 5}
"""Points that determine an element."""
FORM: Mapping[str, str] = {
    "flatness": "plane",
    "roundness": "circle",
    "sphericity": "sphere",
    "cylindricity": "cylinder",
}
"""Form deviation → the element whose it is."""
ROUND = ("circle", "sphere", "cylinder")
ANGULAR = ("angle",)
"""Quantities in rad; all others are mm."""


@dataclass(frozen=True, eq=False)
class TouchedFeature:
    """One element of a part, and where it is touched.

    Attributes
    ----------
    name
        Its name.
    kind
        The ideal element that is fitted to its points.
    points
        Nominal surface points, shape (n, 3), machine coordinates, mm.
    normals
        Unit vectors out of the material at them, shape (n, 3).
    stylus
        Name of the stylus that touches it.
    centre, axis, radius
        Of the nominal element, (3,) mm, (3,) unit, mm; the axis of a plane is its normal.
    surface_sd
        Standard deviation of the surface about the ideal element, mm.
    """

    name: str
    kind: ElementKind
    points: F64
    normals: F64
    stylus: str
    centre: F64
    axis: F64
    radius: float = 0.0
    surface_sd: float = 0.0


@dataclass(frozen=True, eq=False)
class PartCharacteristic:
    """One figure that is evaluated of the features.

    Attributes
    ----------
    name
        Its name.
    quantity
        What is evaluated. A distance is that of two elements: of points and centres as they lie, or
        along `along`; of planes of the second's middle from the first, along its normal.
        ``position`` is the diameter of the tolerance zone, twice the distance from the nominal
        place (ISO 1101).
    of
        Names of the one or two features.
    datums
        Up to three features that make the coordinate system of x, y, z and position; none: the
        machine's.
    along
        Unit vector, (3,), of a distance along it; None: as it lies.
    tolerance
        Width of the tolerance, mm (angles: rad); None: not stated.
    """

    name: str
    quantity: Quantity
    of: tuple[str, ...]
    datums: tuple[str, ...] = ()
    along: F64 | None = None
    tolerance: float | None = None

    @property
    def angular(self) -> bool:
        """Whether it is an angle, rad, in place of mm."""
        return self.quantity in ANGULAR

    @property
    def one_sided(self) -> bool:
        """Whether it cannot be negative and is 0 on a perfect part: form and position."""
        return self.quantity in FORM or self.quantity == "position"


def check_characteristic(
    one: PartCharacteristic, known: Mapping[str, TouchedFeature], where: str
) -> None:
    """Refuse what cannot be evaluated of these features.

    Raises
    ------
    InputError
        Naming the key below `where`.
    """
    for key in ("of", "datums"):
        for name in getattr(one, key):
            if name not in known:
                raise InputError(
                    "no such feature", field=f"{where}.{key}", found=name,
                    expected="one of " + ", ".join(known),
                )  # fmt: skip
    wanted = 2 if one.quantity in ("distance", "angle") else 1
    if len(one.of) != wanted:
        raise InputError(
            f"{one.quantity} is that of {wanted} feature{'s' * (wanted - 1)}",
            field=f"{where}.of", found=", ".join(one.of),
            expected=f"{wanted} of {', '.join(known)}",
        )  # fmt: skip
    kinds = [known[name].kind for name in one.of]
    allowed: tuple[str, ...] = get_args(ElementKind)
    if one.quantity == "diameter":
        allowed = ROUND
    elif one.quantity in FORM:
        allowed = (FORM[one.quantity],)
    elif one.quantity == "angle":
        allowed = ("plane", "cylinder")
    for name, kind in zip(one.of, kinds, strict=True):
        if kind not in allowed:
            raise InputError(
                f"a {kind} has no {one.quantity}", field=f"{where}.of", found=f"{name}, a {kind}",
                expected="a " + " or ".join(allowed),
            )  # fmt: skip
    if one.datums and known[one.datums[0]].kind not in ("plane", "cylinder"):
        raise InputError(
            "the first datum gives a direction", field=f"{where}.datums",
            found=f"{one.datums[0]}, a {known[one.datums[0]].kind}",
            expected="a plane or a cylinder",
        )  # fmt: skip
    if len(one.datums) == 1 or len(set(one.datums)) != len(one.datums):
        raise InputError(
            "a coordinate system takes two or three datums, each once", field=f"{where}.datums",
            found=", ".join(one.datums),
        )  # fmt: skip
