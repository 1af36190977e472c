"""The base of all effects: one physical cause of error, one class, used by everything.

An effect says which error motions it moves (`ErrorMotion`), with which basis functions of the
recorded conditions (`Motion`), and which parameters multiply them (`Parameter`). Prediction, fit,
diagnosis, tables and the live path all read the same `motions`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import (
    ABOUT,
    FUNCTIONAL_POINT,
    INSTRUMENT,
    SPINDLE,
    WORKPIECE,
    AxisLetter,
    Component,
    ErrorMotion,
)
from abbe.compcore.machine.machine import Machine

if TYPE_CHECKING:
    from abbe.compcore.campaign.coverage import Coverage
    from abbe.compcore.effects.expressions.expression import FormulaNode

F64 = NDArray[np.float64]
Scope = Literal["machine", "workpiece", "instrument"]

__all__ = [
    "ABOUT",
    "FUNCTIONAL_POINT",
    "INSTRUMENT",
    "SPINDLE",
    "WORKPIECE",
    "AxisLetter",
    "Component",
    "Effect",
    "ErrorMotion",
    "FittedEffect",
    "Motion",
    "NonlinearParameter",
    "Parameter",
    "Scope",
]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What an effect does to one error motion.

    The error motion is ``columns @ p[parameters] + known`` with p the effect's linear parameters.

    Attributes
    ----------
    error_motion
        The error motion.
    columns
        Shape (n, k): basis functions on the conditions, the motion's unit per unit of parameter.
    first
        Index of the effect's linear parameter that the first column belongs to.
    known
        Shape (n,): what no parameter changes, mm or rad; None: 0.
    """

    error_motion: ErrorMotion
    columns: F64
    first: int = 0
    known: F64 | None = None

    def rows(self, index: NDArray[np.int64]) -> Motion:
        """The same on some of the rows."""
        known = None if self.known is None else self.known[index]
        return Motion(self.error_motion, self.columns[index], self.first, known)

    @property
    def parameters(self) -> slice:
        """Which of the effect's linear parameters the columns belong to."""
        return slice(self.first, self.first + self.columns.shape[1])

    def amount(self, coefficients: F64) -> F64:
        """How much it moves or turns, (n,) mm or rad, with the effect's linear parameters."""
        amount = self.columns @ coefficients[self.parameters]
        return amount if self.known is None else amount + self.known


@dataclass(frozen=True, slots=True)
class Parameter:
    """A linear parameter of an effect.

    Attributes
    ----------
    name, unit, description
        Unit inside the code (mm, rad, 1/K, rad/K, …).
    plausible
        Range of a sound machine, in `unit`; a fitted value outside it is doubted.
    convention
        Whether any value is as sound as any other, as where an encoder counts from.
    extent
        Whether it is a place, a period, a lever or a path: a length that people read in mm.
    """

    name: str
    unit: str
    plausible: tuple[float, float]
    description: str = ""
    convention: bool = False
    extent: bool = False


@dataclass(frozen=True, slots=True)
class NonlinearParameter:
    """A parameter on which the columns themselves depend: a time constant, a period, a moment.

    Attributes
    ----------
    bounds
        Least and greatest value that the fit may try, in `unit`.
    starts
        Values at which to begin, in `unit`: dense enough that one of them lies in the valley of the
        best value. Look at the cost on all of them and refine from the best few.
    plausible
        Range of a sound machine, in `unit`.
    smooth
        Whether the columns change smoothly with it. Where not (the moment of a step), derivatives
        say nothing and only a search finds it.
    extent
        As `Parameter.extent`.
    """

    name: str
    unit: str
    bounds: tuple[float, float]
    starts: tuple[float, ...]
    plausible: tuple[float, float]
    description: str = ""
    smooth: bool = True
    extent: bool = False


class FittedEffect(Protocol):
    """An effect with values, as `abbe.compcore.model.model.Term` is one."""

    @property
    def effect(self) -> Effect:
        """The effect."""

    def coefficients(self, machine: Machine) -> F64:
        """Its linear parameters in the order of its columns, shape (p,)."""

    def nonlinear(self, machine: Machine) -> Mapping[str, float]:
        """Its non-linear parameters by name."""


class Effect(BaseModel, ABC):
    """One physical cause of error at one place of the machine.

    The fields of a subclass are its where-keys (formats.md: axis, direction, about, signals, …) as
    they stand in a model file; an unknown key is an error. The docstring of a subclass is its page
    in the catalogue.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    kind: ClassVar[str]
    scope: ClassVar[Scope] = "machine"
    of_the_clock: ClassVar[bool] = False
    """Whether a cause goes by the time and reads no signal, as a drift or an event."""
    carries: ClassVar[bool] = False
    """Whether what it shares with other effects is best named after it: a squareness, a scale."""
    reads_tool: ClassVar[bool] = False
    """Whether the columns depend on the tool's offset (levers not counted)."""
    given: ClassVar[bool] = False
    """Whether all its values are given with it: without parameters, nothing to be fitted."""
    of_a_run: ClassVar[tuple[str, ...]] = ()
    """Parameters that older model files hold and that belong to a run: read over."""
    reads_model: ClassVar[bool] = False
    """Whether the columns follow from the model's other effects (`motions_among`)."""

    @abstractmethod
    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The linear parameters, in the order of the columns."""

    @abstractmethod
    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """The error motions on n rows of conditions, for given non-linear parameters."""

    def nonlinear(self, machine: Machine) -> tuple[NonlinearParameter, ...]:
        """The non-linear parameters that are to be fitted; empty when there are none."""
        return ()

    def search(self, machine: Machine, coverage: Coverage) -> tuple[NonlinearParameter, ...]:
        """As `nonlinear`, with bounds and starts narrowed to what a campaign can show."""
        return self.nonlinear(machine)

    def motions_among(
        self,
        machine: Machine,
        conditions: Conditions,
        nonlinear: Mapping[str, float],
        model: Sequence[FittedEffect],
    ) -> tuple[Motion, ...]:
        """As `motions`, for an effect that acts through the other effects of a model.

        Parameters
        ----------
        model
            The model's terms with their present values; those that are not fitted left out. Only
            effects with `reads_model` look at them.
        """
        return self.motions(machine, conditions, nonlinear)

    def amend(self, machine: Machine, conditions: Conditions, coefficients: F64) -> Conditions:
        """The recorded conditions as, by this effect, they truly were.

        Only an effect that corrects a *reading* (a thermometer's offset) changes anything. Every
        prediction, of campaigns and live, starts from the amended conditions.
        """
        return conditions

    @property
    def settles(self) -> bool:
        """Whether a body stands behind a lag, and so settles when a run begins (`settling`)."""
        return False

    @property
    def began_anywhere(self) -> bool:
        """Whether that body is known not to have been in equilibrium when its run began."""
        return False

    def settling(
        self,
        machine: Machine,
        conditions: Conditions,
        nonlinear: Mapping[str, float],
        since: F64,
    ) -> tuple[Motion, ...]:
        """As `motions`, of bodies that were 1 unit above their signal's lag when the run began.

        Each column per unit of its linear parameter.

        Parameters
        ----------
        since
            Shape (n,), s since each row's run began; infinite where nobody knows.
        """
        return ()

    def check(self, machine: Machine) -> None:
        """Refuse a machine on which this effect makes no sense.

        Raises
        ------
        InputError
            Naming the key, what it says and what the machine has.
        """
        for key in ("axis", "by"):
            axis = self.__dict__.get(key)
            if isinstance(axis, str):
                machine.axis(axis, key)
        for signal in self.signals_needed():
            if signal not in machine.signals:
                raise InputError(
                    "the machine has no such signal",
                    field="signal" if hasattr(self, "signal") else "signals",
                    found=signal,
                    expected="one of " + (", ".join(machine.signals) or "none declared"),
                )

    def signals_needed(self) -> tuple[str, ...]:
        """Names of the recorded signals that this effect reads."""
        fields = self.__dict__  # asking a pydantic model for a field that it lacks is slow
        names = tuple(fields.get("signals") or ())
        single = fields.get("signal")
        return (*names, single) if single else names

    def reads_time(self) -> bool:
        """Whether the columns depend on the time itself, beside what signals say."""
        return self.of_the_clock

    def of_its_day(self) -> bool:
        """Whether it says nothing of another day: what began at a moment of this one."""
        return self.reads_time()

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """Axes on whose position the columns depend (levers not counted)."""
        axis = getattr(self, "axis", None)
        return (axis,) if isinstance(axis, str) else ()

    def directions_used(self) -> tuple[str, ...]:
        """Axes on whose approach direction the columns depend."""
        return ()

    def kinks(self, machine: Machine) -> dict[str, tuple[float, ...]]:
        """Axis → positions (mm or rad) where the slope of a column may jump."""
        return {}

    def repeats(self, machine: Machine, nonlinear: Mapping[str, float]) -> dict[str, float]:
        """Axis → length (mm or rad) after which all columns repeat, anywhere in its travel."""
        return {}

    def misnamed(self, values: Mapping[str, float]) -> bool:
        """Whether fitted values say that it is another one of its kind that acts.

        Parameters
        ----------
        values
            By parameter, mm or rad.
        """
        return False

    def kinks_move(self, machine: Machine) -> bool:
        """Whether slopes jump at positions that move with signals, time or other axes' positions.

        No table can stand for such an effect; the live path follows it point by point.
        """
        return False

    def expressions(
        self, machine: Machine, coefficients: F64
    ) -> tuple[tuple[float, FormulaNode], ...] | None:
        """The error motion as a sum of numbers times expressions, of which bounds are known.

        Returns
        -------
        For linear parameters `coefficients`, shape (k,), in the motion's unit; None for an effect
        whose columns are nowhere narrower than a thousandth of the travel but where it says so
        (`kinks`, `repeats`).
        """
        return None

    def next_one(self) -> Effect | None:
        """The next of its kind at the same place, where a machine may have several; else None."""
        return None

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[Self]:
        """Instances of this kind worth trying on a machine, physically plausible ones first."""
        return ()

    def where(self) -> dict[str, Any]:
        """The where-keys that are set, as a model file holds them."""
        keys = self.model_dump(exclude_defaults=True, mode="json")
        return {key: keys[key] for key in sorted(keys, key=_rank)}

    @property
    def spec(self) -> str:
        """What ``abbe add MODEL`` takes to add this effect; also its name for people.

        >>> from abbe.compcore.effects import Straightness
        >>> Straightness(axis="X", direction="Y", shape="spline:8").spec
        'straightness axis=X direction=Y shape=spline:8'
        """
        parts = [self.kind]
        for key, value in self.where().items():
            parts.append(f"{key}={_typed(value)}")
        return " ".join(parts)


_ORDER = ("axis", "axes", "direction", "about", "channel", "error", "by", "signal", "signals")


def _rank(key: str) -> int:
    return _ORDER.index(key) if key in _ORDER else len(_ORDER)


def _typed(value: object) -> str:
    """A value as one types it on a command line."""
    if isinstance(value, list):
        return ",".join(map(_typed, value))
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value)
