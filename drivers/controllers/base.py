"""The controller contract: what a dialect of tables must say and do.

A controller is one file with one class: what it can hold (`capability`), its syntax both ways
(`_format`, `_parse`), what its numbers mean (`sign`), how a table is activated, and how sure Abbe
is of each (`trust`). ``CONTRIBUTING.md`` shows one in a page.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError

from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import DISPLACEMENT, ROTATION, TRAVEL, TRAVEL_ROTARY, Range
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.tables.capability import Capability
from abbe.compcore.tables.table import Sign, Table
from abbe.compcore.units import in_digits
from abbe.compcore.validation import invalid_key

F64 = NDArray[np.float64]
CONTROLLER_GROUP = "abbe.controllers"

_SLACK = 1e-3
"""Part of a step by which a table may read back differently."""


class Confidence(StrEnum):
    """How sure Abbe is of something about a controller."""

    TRIED = "tried"
    """Run on the controller itself, and seen."""
    DOCUMENTED = "documented"
    """Read in the maker's own manual."""
    UNVERIFIED = "unverified"
    """From third parties, derived, or from memory: try it on the machine first."""


@dataclass(frozen=True, slots=True)
class Trust:
    """How sure Abbe is of a controller's dialect, aspect by aspect.

    Attributes
    ----------
    syntax, sign, activation
        How sure of each.
    note
        What exactly is not sure, for people.
    """

    syntax: Confidence
    sign: Confidence
    activation: Confidence
    note: str = ""

    @property
    def least(self) -> Confidence:
        """The least of the three."""
        order = list(Confidence)
        return max((self.syntax, self.sign, self.activation), key=order.index)

    def as_dict(self) -> dict[str, str]:
        """For JSON."""
        found = {k: str(getattr(self, k)) for k in ("syntax", "sign", "activation")}
        return found | ({"note": self.note} if self.note else {})


@dataclass(frozen=True, slots=True)
class Cannot:
    """A form of tables that a control has and Abbe does not write, with the reason.

    Attributes
    ----------
    what
        Control and function, for people.
    why
        What would have to be known.
    """

    what: str
    why: str


def _assigned(value: object) -> object:
    """``X:0,Y:1`` → ``{"X": "0", "Y": "1"}``."""
    if not isinstance(value, str):
        return value
    found = {}
    for part in value.split(","):
        key, colon, item = (p.strip() for p in part.partition(":"))
        if not colon:
            raise ValueError(f"{part!r} is not AXIS:VALUE")
        found[key] = item
    return found


def _listed(value: object) -> object:
    """``X,Y`` → ``("X", "Y")``."""
    return tuple(p.strip() for p in value.split(",")) if isinstance(value, str) else value


PerAxis = Annotated[dict[str, int], BeforeValidator(_assigned)]
"""Axis → whole number; on a command line ``X:1,Y:2``."""
NumberPerAxis = Annotated[dict[str, float], BeforeValidator(_assigned)]
"""Axis → number; on a command line ``X:1000,Y:2000``."""
NamePerAxis = Annotated[dict[str, str], BeforeValidator(_assigned)]
"""Axis → name; on a command line ``X:X1,Y:Y1``."""
AxisNames = Annotated[tuple[str, ...], BeforeValidator(_listed)]
"""Axes; on a command line ``X,Y``."""


class ControllerOptions(BaseModel):
    """Base of every controller's options; unknown names are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    invert: bool = False
    """Turn the sign of every number round, where a test on the machine shows that it must be."""


class Controller(ABC):
    """One dialect of tables, for one machine.

    Parameters
    ----------
    machine
        The machine whose tables they are.
    options
        What differs from machine to machine: axis numbers, counts, sizes of memory.
    """

    name: ClassVar[str]
    """What ``--controller`` takes."""
    title: ClassVar[str]
    """Maker and product, for people."""
    sign: ClassVar[str]
    """What the numbers in the files mean, in a sentence with the words error or compensation."""
    source: ClassVar[str]
    """Where the syntax and the sign come from."""
    trust: ClassVar[Trust]
    cannot: ClassVar[tuple[Cannot, ...]] = ()
    """What the same maker's controls hold besides and Abbe does not write, and why."""
    Options: ClassVar[type[ControllerOptions]] = ControllerOptions

    def __init__(self, machine: Machine, options: ControllerOptions | None = None) -> None:
        self.machine = machine
        self.options = self.Options() if options is None else options

    @property
    @abstractmethod
    def capability(self) -> Capability:
        """What it can hold."""

    @abstractmethod
    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        """Files for tables of errors in whole steps: name → text."""

    @abstractmethod
    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        """Tables from files; the opposite of `_format`, strict as the controller is."""

    @abstractmethod
    def activation(self) -> tuple[str, ...]:
        """What has to be done at the controller, step by step."""

    def adapted(self, tables: Sequence[Table]) -> tuple[Table, ...]:
        """The tables as this dialect's form holds them, where it holds less than they say."""
        return tuple(tables)

    def write(self, tables: Sequence[Table]) -> dict[str, str]:
        """Files for tables: name → text.

        Parameters
        ----------
        tables
            Of either sign, as `abbe.compcore.tables.projection.project` makes them for this
            controller.

        Raises
        ------
        InputError
            For products, where the controller holds none.
        AbbeError
            When what was written does not read back as what was to be written.
        """
        errors = [t.as_sign(Sign.ERROR) for t in tables]
        products = [t.name for t in errors if t.lever is not None]
        if products and self.capability.form("product") is None:
            raise InputError(
                f"{self.name} as it is set holds no products of two axes' positions",
                found=", ".join(products), expected="tables over single axes",
            )  # fmt: skip
        files = self._format([t.scaled(self._turn) for t in errors])
        self.check(errors, files)
        return files

    def read(self, files: Mapping[str, str]) -> tuple[Table, ...]:
        """The tables of errors that files hold.

        Raises
        ------
        InputError
            Naming file, line, what was found and what was expected.
        """
        with np.errstate(over="ignore", invalid="ignore"):  # believed by none
            found = [t.scaled(self._turn) for t in self._parse(files)]
            for table in found:
                self._believe(table, ", ".join(files))
        return tuple(found)

    def _believe(self, table: Table, file: str) -> None:
        """Raise `InputError` where a table's positions or values cannot be."""
        for axis, nodes in zip(table.inputs, table.nodes, strict=True):
            rotary = is_rotary(axis)
            allowed = TRAVEL_ROTARY if rotary else TRAVEL
            _within(np.degrees(nodes) if rotary else nodes, allowed, table, "position", file)
        rotation = table.output.rotation
        allowed, unit = (ROTATION, 1e6) if rotation else (DISPLACEMENT, 1e3)
        scale = unit * self._reach(table)
        _within(scale * table.forward, allowed, table, "value", file)
        _within(scale * table.downward, allowed, table, "value", file)

    def _step(self, table: Table) -> float:
        """The finest step of such values, mm or rad."""
        steps = (h.step(table.output.rotation) for h in self.capability.holds)
        return min((s for s in steps if s > 0.0), default=0.0)

    def _reach(self, table: Table) -> float:
        """What a table's values are multiplied by at most, mm; 1 without a lever."""
        lever = table.lever
        return 1.0 if lever is None else table.reach(self.machine.axis(lever[0]).travel)

    @property
    def _turn(self) -> float:
        return -1.0 if self.options.invert else 1.0

    def check(self, tables: Sequence[Table], files: Mapping[str, str]) -> None:
        """Compare files, as written or as read back from a controller, with what they are to hold.

        Raises
        ------
        AbbeError
            Naming the first table that differs, by how much.
        """
        found = list(self.read(files))
        for table in tables:
            mine = [t for t in found if t.same_number(table)]
            if len(mine) != 1:
                raise AbbeError(
                    f"{self.name}: {table.name} is in the files {len(mine)} times, not once"
                )
            reach = max(self._reach(t) for t in (table, mine[0]))
            off = table.difference(mine[0]) * reach
            slack = max(1e-9 * max(1e-3, table.largest() * reach), _SLACK * self._step(table))
            if not off <= slack:
                unit = "µrad" if table.output.rotation else "µm"
                factor = 1e6 if table.output.rotation else 1e3
                raise AbbeError(
                    f"{self.name}: {table.name} in the files differs from what was to be written "
                    f"by {in_digits(off * factor)} {unit}"
                )
        wanted = {t.name for t in tables}
        extra = [t.name for t in found if t.name not in wanted and t.largest() > 0.0]
        if extra:
            raise AbbeError(f"{self.name}: the files hold more than was to be written: {extra}")


def with_options(cls: type[Controller], given: Mapping[str, Any]) -> ControllerOptions:
    """A controller's options from what a user gave, texts or numbers.

    Raises
    ------
    InputError
        For an unknown option, or a value that does not fit.
    """
    try:
        return cls.Options.model_validate(dict(given))
    except ValidationError as error:
        raise invalid_key(error, cls.name, cls.Options.model_fields, "option") from None


def _within(values: F64, allowed: Range, table: Table, what: str, file: str) -> None:
    bad = values[~((values >= allowed.low) & (values <= allowed.high))]
    if bad.size:
        raise InputError(
            "not believable", file=file, field=f"{what} of {table.name}",
            found=f"{bad.flat[0]:g}", expected=str(allowed),
        )  # fmt: skip


def both_ways(forward: Table, backward: Table | None) -> Table:
    """One table from those of the two directions, which stand on the same nodes."""
    return forward if backward is None else replace(forward, backward=backward.forward)
