"""A controller's compensation tables as data: types, number of points, resolution, range."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.tables.field import Lookup

Form = Literal["axis", "cross", "product", "plane", "motions", "grid"]
"""
============ ============================================================================
``axis``     an axis corrected by its own position
``cross``    an axis corrected by another's position
``product``  the same, multiplied by a third axis's position (a lever)
``plane``    an axis corrected by the positions of two
``motions``  the six error motions of an axis; the controller knows the levers
``grid``     a spatial grid of three translations and three rotations
============ ============================================================================
"""

_UNLIMITED = 10_000


@dataclass(frozen=True, slots=True)
class Spacing:
    """Rule for the positions of a table's points: free, equidistant or powers of two.

    Attributes
    ----------
    rule
        ``free``: anywhere. ``equidistant``: at one distance. ``power of two``: equidistant, the
        distance a power of two times `unit`.
    least
        Smallest distance, mm (rotary: rad).
    unit
        Positions are whole multiples of it, mm (rotary: rad); 0: any. For ``power of two`` the
        distance is ``unit·2^n``.
    through_zero
        Whether equidistant points must include the axis's zero.
    powers
        Least and greatest n of ``power of two``.
    """

    rule: Literal["free", "equidistant", "power of two"] = "free"
    least: float = 0.0
    unit: float = 0.0
    through_zero: bool = False
    powers: tuple[int, int] = (0, 0)


@dataclass(frozen=True, slots=True)
class Increment:
    """Rule for incremental tables: each entry is the step from the entry before it.

    Attributes
    ----------
    limit
        Largest entry, in units of resolution × magnification.
    magnifications
        Factors on all entries of one axis that may be chosen.
    """

    limit: int
    magnifications: tuple[int, ...] = (1,)


@dataclass(frozen=True, slots=True)
class Holds:
    """A family of compensation tables that a controller holds (axis, cross, product, plane, grid).

    Attributes
    ----------
    form
        What the tables look up and move.
    types
        Types of ISO/TR 16907, 8.2, that they serve.
    points
        Most points of a table in each direction.
    spacing, rotary_spacing
        Where points may stand on linear and on rotary axes.
    directional
        Whether the two directions of ``inputs[0]`` may have values of their own.
    resolution, rotary_resolution
        Step of the values, mm and rad.
    value_range
        Least and greatest value, mm; None: no limit worth naming.
    increment
        For incremental tables.
    zero_at
        Where the value must be zero: at the axis's ``zero`` (reference), at the first point
        (``start``), or nowhere.
    per_output
        How many of these tables may correct one axis, those that do most; None: any number.
    inputs
        Axes that may be looked up; of a ``plane`` the two in order. None: all.
    outputs
        Axes that may be corrected. None: all.
    takes
        How many of the `Capability.most_tables` one takes, alike both ways and with two directions.
    """

    form: Form
    types: tuple[str, ...]
    points: int = _UNLIMITED
    spacing: Spacing = field(default_factory=Spacing)
    rotary_spacing: Spacing = field(default_factory=Spacing)
    directional: bool = False
    resolution: float = 1e-6
    rotary_resolution: float = 1e-9
    value_range: tuple[float, float] | None = None
    increment: Increment | None = None
    zero_at: Literal["zero", "start"] | None = None
    per_output: int | None = None
    inputs: tuple[str, ...] | None = None
    outputs: tuple[str, ...] | None = None
    takes: tuple[int, int] = (1, 1)

    def serves(self, axis: str, output: str) -> bool:
        """Whether a table of the family may look up one axis and correct another."""
        return (self.inputs is None or axis in self.inputs) and (
            self.outputs is None or output in self.outputs
        )

    def spacing_of(self, axis: str) -> Spacing:
        """The rule for the points on one axis."""
        return self.rotary_spacing if is_rotary(axis) else self.spacing

    def step(self, rotation: bool) -> float:
        """Resolution of the values, mm or, of an angle, rad."""
        return self.rotary_resolution if rotation else self.resolution


@dataclass(frozen=True, slots=True)
class Capability:
    """All families of compensation tables that a controller holds, and how it looks them up.

    Attributes
    ----------
    holds
        Families of tables.
    lookup
        Whether tables are looked up at the indicated or at the commanded position.
    shared_nodes
        Whether all tables of one axis stand on the same points.
    most_tables
        Most tables in all; None: as many as the families allow.
    per_output
        Most tables of all families that correct one axis; None: any number.
    knows_tool
        Whether the controller knows the tool's offset and reckons with it.
    reference
        Axis → its zero in machine coordinates where that is not 0, mm or rad.
    """

    holds: tuple[Holds, ...]
    lookup: Lookup = "command"
    shared_nodes: bool = False
    most_tables: int | None = None
    per_output: int | None = None
    knows_tool: bool = False
    reference: Mapping[str, float] = field(default_factory=dict)

    @property
    def types(self) -> tuple[str, ...]:
        """Types of ISO/TR 16907, 8.2, in order of first mention."""
        return tuple(dict.fromkeys(t for h in self.holds for t in h.types))

    def form(self, form: Form) -> Holds | None:
        """The family of a form; None where the controller has none."""
        return next((h for h in self.holds if h.form == form), None)

    def without(self, form: Form) -> Capability:
        """The capability without the families of a form."""
        return replace(self, holds=tuple(h for h in self.holds if h.form != form))

    def unlimited(self) -> Capability:
        """The same families without limits of points, resolution and range."""
        holds = tuple(
            replace(
                h,
                points=_UNLIMITED,
                spacing=Spacing(),
                rotary_spacing=Spacing(),
                directional=True,
                resolution=0.0,
                rotary_resolution=0.0,
                value_range=None,
                increment=None,
                zero_at=None,
            )
            for h in self.holds
        )
        return replace(self, holds=holds, shared_nodes=False)


RIGID = Capability((Holds("motions", ("L-VOL", "R-VOL"), directional=True),), knows_tool=True)
"""Any controller that holds all error motions of a rigid machine."""
