"""Local effects: a dent or bump of a guideway or scale, and a joint between two pieces of one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import (
    Component,
    Effect,
    ErrorMotion,
    Motion,
    NonlinearParameter,
    Parameter,
)
from abbe.compcore.effects.keys import FittedUnlessGiven, PositiveUnlessFitted
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.targets import ROTATIONS, TRANSLATIONS, require_linear
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine, own_component

_ERROR = re.compile(r"E_([XYZABC])([XYZUVWR][0-9]?)")
_HALF = float(np.sqrt(1.0 - 0.5 ** (1.0 / 3.0)))
"""Where ``(1 − u²)³`` has fallen to one half."""
_PLACES = 130
"""Places of the travel at which a joint is tried, its ends among them; finer about the best."""


class LocalEffect(Effect):
    """An error motion of one linear axis that is there, or begins, in one place of its travel."""

    axis: str
    error: str
    centre: FittedUnlessGiven = None

    @model_validator(mode="before")
    @classmethod
    def _axis_is_in_the_error(cls, keys: Any) -> Any:
        if isinstance(keys, dict) and "axis" not in keys:
            match = _ERROR.fullmatch(str(keys.get("error", "")))
            if match:
                return {"axis": match[2], **keys}
        return keys

    @model_validator(mode="after")
    def _error_is_of_the_axis(self) -> Self:
        match = _ERROR.fullmatch(self.error)
        if match is None or match[2] != self.axis:
            raise InputError(
                "not an error motion of the axis",
                field="error",
                found=self.error,
                expected="one of " + ", ".join(f"E_{k}{self.axis}" for k in "XYZABC"),
            )
        return self

    @property
    def component(self) -> Component:
        """The component of the error motion."""
        return self.error[2]  # type: ignore[return-value]

    def check(self, machine: Machine) -> None:
        """Linear axes only."""
        super().check(machine)
        require_linear(machine, self.axis, self.kind)


@register
class LocalDefect(LocalEffect):
    """Local defect: a dent or bump of a guideway, seen in one place of the travel only.

    Formula
        ``E = depth·(1 − u²)³`` for ``|u| < 1``, else 0, with ``u = 0.908·(q_a − centre)/width``: a
        smooth bump that has half of its height at centre ± ½ width and ends at centre ± 1.1 width.
    Parameters
    ----------
        depth, the height at the centre, in mm (rad for angles), signed; within ±50 µm or ±100 µrad.
        centre in mm, anywhere in the travel, and width (full width at half height) in mm, both
        fitted unless given. As an error of a carriage a defect is never narrower than the carriage
        rolls over it, and repeats at the distance of its shoes.
    Signals
        None beyond the axis's position.
    Typical causes
        A chip pressed into the guideway, a dent by a dropped part, a butt joint of rails or racks,
        a worn stretch where the machine always works, dirt or a scratch on the scale (E_XX).
    Cure
        Clean and stone or exchange the rail; a table with finer steps there.
    Source
        ISO 230-1:2012 (straightness and angular error motions); the bump is the triweight kernel,
        compact and twice differentiable.
    """

    kind = "local_defect"
    width: PositiveUnlessFitted = None

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The height at the centre."""
        error_motion = ErrorMotion(self.axis, self.component)
        plausible = (-1e-4, 1e-4) if error_motion.rotation else (-0.05, 0.05)
        return (
            Parameter(
                "depth", error_motion.unit, plausible, f"height of the bump in {error_motion}"
            ),
        )

    def nonlinear(self, machine: Machine) -> tuple[NonlinearParameter, ...]:
        """Centre and width unless given."""
        axis = machine.axis(self.axis)
        low, high = axis.travel
        length = high - low
        centres = np.linspace(low, high, 25)
        found = []
        if self.centre is None:
            found.append(
                NonlinearParameter(
                    "centre",
                    "mm",
                    (low, high),
                    tuple(centres),
                    (low, high),
                    "where it lies",
                    extent=True,
                )
            )
        if self.width is None:
            widths = (length / 24, length / 12, length / 6)
            found.append(
                NonlinearParameter(
                    "width",
                    "mm",
                    (length / 100, length / 3),
                    widths,
                    (length / 100, length / 4),
                    "full width at half height",
                    extent=True,
                )
            )
        return tuple(found)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """The bump at the axis's position; held at the ends of the travel."""
        centre = nonlinear["centre"] if self.centre is None else self.centre
        width = nonlinear["width"] if self.width is None else self.width
        position = machine.axis(self.axis).clamp(conditions.position(self.axis))
        u = 2.0 * _HALF / width * (position - centre)
        inside = np.maximum(1.0 - u * u, 0.0)
        bump = inside * inside * inside
        return (Motion(ErrorMotion(self.axis, self.component), bump[:, None]),)

    def kinks(self, machine: Machine) -> dict[str, tuple[float, ...]]:
        """The ends of the travel, and the bump's where they are given."""
        found: tuple[float, ...] = machine.axis(self.axis).travel
        if self.centre is not None and self.width is not None:
            end = 0.5 * self.width / _HALF
            found += (self.centre - end, self.centre, self.centre + end)
        return {self.axis: found}

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[LocalDefect]:
        """Each error motion of each linear axis that moved, translations first."""
        for axis in machine.structure.linear:
            if axis in coverage.moving and coverage.shows(axis, 3):
                for component in (*TRANSLATIONS, *ROTATIONS):
                    yield cls(axis=axis, error=f"E_{component}{axis}")


@register
class Joint(LocalEffect):
    """Joint: beyond one place of the travel an axis stands a step further, as of two scale tapes.

    ``number`` tells several joints of one error motion apart: 2, 3, … up to 9, in no order.

    Formula
        ``E = step·(3u² − 2u³)``, ``u = ½ + (q_a − centre)/over`` held within 0 … 1: nothing below
        the joint, the whole step beyond it.
    Parameters
    ----------
        step in mm (rad for angles), signed; within ±50 µm or ±100 µrad. centre in mm, fitted unless
        given: it is known to within the two targets between which it lies. over in mm, 10 unless
        given: as long as a scale's reading head looks, or a pinion's tooth.
    Signals
        None beyond the axis's position.
    Typical causes
        A scale of several tapes or sections, or a rack of several pieces, whose joint is wider or
        narrower than the pitch; a reference mark or a signal period missed there at each pass. Of
        rails or bed sections that do not meet (E_ZX, E_BX, …), by hand: a carriage goes over it as
        long as it is itself, which ``over`` says.
    Cure
        Set the joint again by a gauge or a piece of scale laid over it; a table with a point on
        each side, as near to the joint as the controller allows.
    Source
        ISO 230-2 (targets close enough to see it); makers' instructions for mounting scale tapes
        and racks in sections.
    """

    kind = "joint"
    over: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = 10.0
    number: Annotated[int, Field(ge=2, le=9)] | None = None

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The step."""
        error_motion = ErrorMotion(self.axis, self.component)
        plausible = (-1e-4, 1e-4) if error_motion.rotation else (-0.05, 0.05)
        return (Parameter("step", error_motion.unit, plausible, f"step of {error_motion}"),)

    def nonlinear(self, machine: Machine) -> tuple[NonlinearParameter, ...]:
        """Where it lies, unless given: what lies between the same two targets looks the same."""
        if self.centre is not None:
            return ()
        ends = machine.axis(self.axis).travel
        starts = tuple(float(q) for q in np.linspace(*ends, _PLACES)[1:-1])
        return (
            NonlinearParameter(
                "centre", "mm", ends, starts, ends, "where it lies", smooth=False, extent=True
            ),
        )

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """The step at the axis's position; held at the ends of the travel."""
        centre = nonlinear["centre"] if self.centre is None else self.centre
        position = machine.axis(self.axis).clamp(conditions.position(self.axis))
        u = np.clip((position - centre) / self.over + 0.5, 0.0, 1.0)
        beyond = u * u * (3.0 - 2.0 * u)
        return (Motion(ErrorMotion(self.axis, self.component), beyond[:, None]),)

    def kinks(self, machine: Machine) -> dict[str, tuple[float, ...]]:
        """The ends of the travel, and those of the step where its place is given."""
        found: tuple[float, ...] = machine.axis(self.axis).travel
        if self.centre is not None:
            found += (self.centre - 0.5 * self.over, self.centre + 0.5 * self.over)
        return {self.axis: found}

    def next_one(self) -> Joint | None:
        """Another joint of the same error motion, at a place of its own."""
        following = (self.number or 1) + 1
        return self.model_copy(update={"number": following}) if following <= 9 else None

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[Joint]:
        """The scale or rack of each linear axis that moved."""
        for axis in machine.structure.linear:
            if axis in coverage.moving and coverage.shows(axis, 2):
                yield cls(axis=axis, error=f"E_{own_component(axis)}{axis}")
