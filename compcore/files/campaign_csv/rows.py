"""Rows of a campaign: every cell checked, and brought to the units inside the code."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind, Setup
from abbe.compcore.campaign.nights import stretches_between_nights
from abbe.compcore.campaign.zeros import with_zeros
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv.believable import Believable
from abbe.compcore.files.campaign_csv.columns import TOOL, UNIT_VECTOR, Columns
from abbe.compcore.files.campaign_csv.head import CampaignHead
from abbe.compcore.files.campaign_csv.store import Growing, GrowingNames
from abbe.compcore.files.campaign_csv.table import CsvBlock, cell
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.sentences import said

F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

KINDS = {kind.name.lower(): kind for kind in Kind}
PER_UNIT = {
    Kind.DISPLACEMENT: 1e3,
    Kind.ROTATION: 1e6,
    Kind.DISTANCE: 1.0,
    Kind.BASE_DISTANCE: 1.0,
}
"""What one mm or rad inside the code is in the file: µm, µrad; distances mm."""
DEFAULT_FREE = {True: (), False: ("zero",)}
"""`free` of a set-up that is not listed, by whether it measures distances."""
MOST_GAUGES = 1000
"""Names of gauges that a campaign may have."""
_NO_COMPONENT = 1e6
"""Of a unit vector: the squares of larger numbers may not be numbers any more."""
_LENGTH_TOLERANCE = 1e-3
"""Three decimals of a unit vector's components are enough; its length is made 1 exactly."""

_ONE_OF_KINDS = said("one of {names}", names=", ".join(KINDS))


class CampaignRows:
    """The rows of one file, checked and gathered."""

    def __init__(self, machine: Machine, head: CampaignHead, columns: Columns) -> None:
        self._machine = machine
        self._head = head
        self.columns = columns
        self._believable = Believable(columns, machine)
        self._numbers = {name: Growing() for name in columns.numbers}
        self._names = {name: GrowingNames() for name in ("setup", "base", "base2", "tool", "gauge")}
        self._kind: list[NDArray[np.int8]] = []
        self._line: list[NDArray[np.int64]] = []
        self._block: CsvBlock

    def add(self, block: CsvBlock) -> None:
        """Check some rows and keep them.

        Raises
        ------
        InputError
            Naming file, line, column, what was found and what was expected.
        """
        if not block.text:
            return
        self._block = block
        kind = self._kinds()
        point = kind != Kind.BASE_DISTANCE
        self._check_names(kind)
        numbers = {name: block.numbers[:, i] for i, name in enumerate(self.columns.numbers)}
        self._check_numbers(numbers, point)
        self._check_tools(numbers, point)
        self._check_gauges(numbers)
        self._check_unit_vectors(numbers, (kind == Kind.DISPLACEMENT) | (kind == Kind.ROTATION))
        for bad, column, problem, expected in self._believable.wrong(numbers, kind):
            self._refuse(bad, column, problem, expected)
        for name, values in numbers.items():
            self._numbers[name].extend(values)
        for name, store in self._names.items():
            if name in block.names:
                store.extend(block.names[name])
            else:
                store.blank(len(block.text))
        self._kind.append(kind)
        self._line.append(block.line)

    def _refuse(self, bad: Mask, column: str, problem: str, expected: str) -> None:
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(
                problem,
                file=self.columns.file,
                line=int(self._block.line[row]),
                field=column,
                found=cell(self._block.text[row], self.columns, column),
                expected=expected,
            )

    def _kinds(self) -> NDArray[np.int8]:
        names = self._block.names["kind"]
        kind = names.each([KINDS.get(text, -1) for text in names.unique], np.int8)
        self._refuse(kind < 0, "kind", "unknown kind", _ONE_OF_KINDS)
        return kind

    def _check_names(self, kind: NDArray[np.int8]) -> None:
        names = self._block.names
        self._refuse(~names["setup"].where(bool), "setup", "a row without a set-up", "a name")
        for column, needs in (
            ("base", kind >= Kind.DISTANCE),
            ("base2", kind == Kind.BASE_DISTANCE),
        ):
            if column not in names:
                if needs.any():
                    raise self.columns.missing(column, said("distances are measured from it"))
                continue
            self._refuse(
                needs & ~names[column].where(bool),
                column,
                "a distance without a base point",
                "a base point's name",
            )
            self._declared(column, dict.fromkeys(self._head.bases), "bases", "position")
        rows = np.flatnonzero(kind == Kind.BASE_DISTANCE)
        if len(rows):
            ends = [np.array(names[c].unique)[names[c].codes[rows]] for c in ("base", "base2")]
            same = np.zeros(len(kind), dtype=np.bool_)
            same[rows] = ends[0] == ends[1]
            self._refuse(same, "base2", "a distance from a base point to itself", "another base")
        if "tool" in names:
            self._declared("tool", dict.fromkeys(self._head.tools), "tools", "offset")

    def _declared(self, column: str, known: dict[str, None], section: str, key: str) -> None:
        self._refuse(
            self._block.names[column].where(lambda name: bool(name) and name not in known),
            column,
            "not declared at the top of the file",
            said(
                "one of {names}; a section {section} with {key} declares one",
                names=", ".join(known) or said("none declared"),
                section=f"[{section}.NAME]",
                key=f"{key} = [x, y, z]",
            ),
        )

    def _check_numbers(self, numbers: dict[str, F64], point: Mask) -> None:
        columns = self.columns
        self._refuse(np.isnan(numbers["value"]), "value", "a blank cell", "a number")
        self._refuse(
            ~point & (numbers["value"] <= 0.0), "value", "not a distance", "a number above 0, mm"
        )
        signals = columns.signals
        spindle = (columns.spindle,) if columns.spindle else ()
        clock = ("time",) if "time" in columns else ()
        read = [name for name in signals if name not in self._head.seen]
        for name in (*clock, *columns.positions.values(), *spindle, *read):
            self._refuse(point & np.isnan(numbers[name]), name, "a blank cell", "a number")
        if "sd" in numbers:
            self._refuse(
                numbers["sd"] <= 0.0,
                "sd",
                "not a standard uncertainty",
                "a number above 0, or a blank cell where none is known",
            )
        for name in columns.directions.values():
            direction = numbers[name]
            np.copyto(direction, 0.0, where=np.isnan(direction))
            self._refuse(
                ~np.isin(direction, (-1.0, 0.0, 1.0)),
                name,
                "not a direction",
                "1, -1, or 0 for not moved or unknown",
            )

    def _check_tools(self, numbers: dict[str, F64], point: Mask) -> None:
        names = self._block.names.get("tool")
        named = np.zeros(point.shape, dtype=np.bool_) if names is None else names.where(bool)
        for i, column in enumerate(TOOL):
            if column not in numbers:
                continue
            value = numbers[column]
            blank = np.isnan(value)
            self._refuse(blank & point & ~named, column, "a blank cell", "a number, mm")
            np.copyto(value, 0.0, where=blank)
            if names is not None:
                tools = self._head.tools
                offsets = [tools[name].offset[i] if name else 0.0 for name in names.unique]
                offset = names.each(offsets, np.float64)
                self._refuse(
                    named & (value != 0.0) & (value != offset),
                    column,
                    "a named tool's offset stands in its section, not here",
                    "a blank cell or 0 where column 'tool' names a tool",
                )

    def _check_gauges(self, numbers: dict[str, F64]) -> None:
        columns, names = self.columns, self._block.names.get("gauge")
        if ("gauge" in columns) != ("gauge_sd" in columns):
            lacking = "gauge_sd" if "gauge" in columns else "gauge"
            raise columns.missing(lacking, said("a gauge has its name and its uncertainty"))
        if names is None:
            return
        named, blank = names.where(bool), np.isnan(numbers["gauge_sd"])
        self._refuse(named & blank, "gauge_sd", "a blank cell", "a number where a gauge is named")
        self._refuse(~named & ~blank, "gauge", "an uncertainty of no gauge", "the gauge's name")
        with np.errstate(invalid="ignore"):
            negative = named & (numbers["gauge_sd"] <= 0.0)
        self._refuse(negative, "gauge_sd", "not a standard uncertainty", "a number above 0")
        if len(self._names["gauge"].names.keys() | set(names.unique)) > MOST_GAUGES:
            raise InputError(
                "too many gauges", file=columns.file, field="gauge",
                expected=said(
                    "at most {n}: rows that share an error share its name", n=MOST_GAUGES
                ),
            )  # fmt: skip

    def _check_unit_vectors(self, numbers: dict[str, F64], component: Mask) -> None:
        for column in UNIT_VECTOR:
            if column not in numbers:
                if component.any():
                    raise self.columns.missing(column)
                continue
            value = numbers[column]
            self._refuse(component & np.isnan(value), column, "a blank cell", "a number")
            np.copyto(value, 0.0, where=~component)
        if not component.any():
            return
        for column in UNIT_VECTOR:
            huge = component & (np.abs(numbers[column]) > _NO_COMPONENT)
            self._refuse(huge, column, "not a component of a unit vector", "-1 to 1")
        u = np.stack([numbers[column] for column in UNIT_VECTOR], axis=1)
        length = np.linalg.norm(u, axis=1)
        wrong = component & (np.abs(length - 1.0) > _LENGTH_TOLERANCE)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InputError(
                "not a unit vector",
                file=self.columns.file,
                line=int(self._block.line[row]),
                field="ux, uy, uz",
                found=f"({', '.join(f'{x:g}' for x in u[row])}) of length {length[row]:.6g}",
                expected="a vector of length 1",
            )
        rounded = component & (np.abs(length - 1.0) > 1e-12)
        for column in UNIT_VECTOR:
            np.divide(numbers[column], length, out=numbers[column], where=rounded)

    def campaign(self, name: str, sha256: str) -> Campaign:
        """All rows, in the units inside the code.

        Raises
        ------
        InputError
            When there are no rows, or a set-up that is not listed mixes distances and errors.
        """
        columns = self.columns
        if not self._kind:
            raise InputError(
                "no rows", file=columns.file, line=columns.line, expected="a row below the header"
            )
        kind = np.concatenate(self._kind)
        n = len(kind)
        setups = self._setups(kind)
        per_unit = np.array([PER_UNIT[k] for k in Kind])[kind]
        numbers = self._numbers
        base_rows = kind == Kind.BASE_DISTANCE
        positions = {}
        for axis, column in columns.positions.items():
            q = numbers[column].take()
            q = np.deg2rad(q) if self._machine.axes[axis].rotary else q
            q[base_rows & np.isnan(q)] = self._machine.axes[axis].middle
            positions[axis] = q
        tool_name = self._names["tool"].take()
        u = np.zeros((n, 3))
        for i, column in enumerate(UNIT_VECTOR):
            if column in numbers:
                u[:, i] = numbers[column].take()
        spindle = None
        if columns.spindle:
            spindle = np.deg2rad(_carried(numbers[columns.spindle].take()))
        # no clock is made of the order of rows
        time = _carried(numbers["time"].take()) if "time" in columns else np.zeros(n)
        signals, unseen = self._signals(~base_rows)
        conditions = Conditions(
            positions=positions,
            directions={a: numbers[c].take() for a, c in columns.directions.items()},
            tool=self._tools(tool_name),
            time=time,
            signals=signals,
            spindle_angle=spindle,
            run=np.zeros(n, dtype=np.int64),
            stretch=stretches_between_nights(time),
            setup=self._names["setup"].take(),
            u=u,
            base=self._names["base"].take(),
        )
        sd = numbers["sd"].take() / per_unit if "sd" in numbers else np.full(n, np.nan)
        if self._head.zeros_at and "time" not in columns:
            raise columns.missing("time", said("set-ups count from other zeros from some times on"))
        made = Campaign(
            name=name,
            conditions=conditions,
            kind=kind,
            value=numbers["value"].take() / per_unit,
            sd=sd,
            base2=self._names["base2"].take(),
            tool_name=tool_name,
            line=np.concatenate(self._line),
            setups=setups,
            bases=self._head.bases,
            tools=self._head.tools,
            files={columns.file: sha256},
            metadata=(self._head.metadata,),
            spindle=self._machine.structure.spindle if columns.spindle else None,
            unseen=unseen,
            **self._gauges(per_unit),
        )
        return with_zeros(made, self._head.zeros_at)

    def _signals(self, point: Mask) -> tuple[dict[str, F64], dict[str, tuple[str, int]]]:
        """Every signal's values; of those seen in a part of the rows only, the first row without.

        What a measurement saw beside the signals is one where the machine declares it.
        """
        signals, unseen, lines = {}, {}, np.concatenate(self._line)
        for name in self.columns.signals:
            values = self._numbers[name].take()
            if name in self._head.seen and name not in self._machine.signals:
                continue
            blank = point & np.isnan(values)
            if blank.any():
                unseen[name] = (self.columns.file, int(lines[np.argmax(blank)]))
            else:
                signals[name] = _carried(values)
        return signals, unseen

    def _gauges(self, per_unit: F64) -> dict[str, Any]:
        if "gauge" not in self.columns:
            return {}
        return {
            "gauge": self._names["gauge"].take(),
            "gauge_sd": np.nan_to_num(self._numbers["gauge_sd"].take()) / per_unit,
        }

    def _tools(self, tool_name: NDArray[np.str_]) -> F64:
        offset = np.zeros((len(tool_name), 3))
        for i, column in enumerate(TOOL):
            if column in self._numbers:
                offset[:, i] = self._numbers[column].take()
        for tool in self._head.tools.values():
            offset[tool_name == tool.name] = tool.offset
        return offset

    def _setups(self, kind: NDArray[np.int8]) -> dict[str, Setup]:
        store = self._names["setup"]
        codes = store.codes()
        distances = kind >= Kind.DISTANCE
        with_distances = set(np.unique(codes[distances]).tolist())
        with_errors = set(np.unique(codes[~distances]).tolist())
        setups = {}
        for name, code in store.names.items():
            free = self._head.free.get(name)
            if free is None:
                if code in with_distances and code in with_errors:
                    row = int(np.argmax(codes == code))
                    raise InputError(
                        "a set-up that is not listed mixes distances with other kinds",
                        file=self.columns.file,
                        line=int(np.concatenate(self._line)[row]),
                        field="setup",
                        found=name,
                        expected=said(
                            "{section} with its free, or two set-ups", section=f"[setups.{name}]"
                        ),
                    )
                free = DEFAULT_FREE[code in with_distances]
            setups[name] = Setup(name, free)
        return setups


def _carried(values: F64) -> F64:
    """Blanks (allowed on base distances only) take the row's before, the first the next one's."""
    blank = np.isnan(values)
    if not blank.any():
        return values
    if blank.all():
        return np.zeros_like(values)
    last = np.maximum.accumulate(np.where(blank, -1, np.arange(len(values))))
    last[last < 0] = int(np.argmin(blank))
    return values[last]
