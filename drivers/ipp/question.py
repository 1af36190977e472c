"""Questions to an I++ DME server, and how channels are found in the answers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from abbe.drivers.ipp.config import IppChannelConfig, IppConfig
from abbe.drivers.ipp.grammar import Named, Value, by_name, shown
from abbe.drivers.link import LinkProtocolError
from abbe.drivers.pace import Pace
from abbe.drivers.quarantine import Member
from abbe.drivers.scaled import ScaledNumber

_FIRST_AGAIN, _ONCE_AGAIN = 0.05, 1.0
"""s before what was refused is asked again: for positions the second time, for anything else."""


@dataclass(frozen=True, slots=True)
class Field:
    """The place of a channel's number in an answer, and its conversion.

    Attributes
    ----------
    name
        The name in front of the brackets.
    item
        Which value in them, from 1.
    scaled
        How the number becomes the value.
    """

    name: str
    item: int
    scaled: ScaledNumber

    def value(self, answer: Mapping[str, tuple[Value, ...]]) -> float:
        """The channel's value.

        Raises
        ------
        LinkProtocolError
            When the answer does not have it.
        """
        values = answer.get(self.name)
        if values is None:
            found = ", ".join(answer) or "nothing"
            raise LinkProtocolError(f"the answer has no {self.name}; it has {found}")
        if len(values) < self.item:
            raise LinkProtocolError(
                f"{self.name} has {len(values)} values, and number {self.item} is wanted"
            )
        value = values[self.item - 1]
        if isinstance(value, Named) and value.name.upper() == "NULL":
            raise LinkProtocolError(f"the server has no value for {self.name} (NULL)")
        if not isinstance(value, float):
            raise LinkProtocolError(f"{self.name}: found {shown(value)}, expected a number")
        number = self.scaled.value_of(value)
        if not math.isfinite(number):
            raise LinkProtocolError(f"{self.name}: {value:g} is too large")
        return number


class IppQuestion(Member):
    """One question to the server: a command that is sent again and again.

    Attributes
    ----------
    method
        The command's name.
    command
        All of it.
    pace
        When it is due.
    fields
        Channel → where it stands in the answer.
    vital
        Whether there are no positions without it.
    refused
        Why the server does not answer it, for people; empty when it does.
    """

    __slots__ = (
        "_again_at",
        "_refusals",
        "command",
        "fields",
        "method",
        "pace",
        "refused",
        "vital",
    )

    def __init__(
        self,
        method: str,
        arguments: tuple[str, ...],
        every: float,
        fields: dict[str, Field],
        *,
        vital: bool = False,
    ) -> None:
        self.method = method
        self.command = f"{method}({', '.join(arguments)})"
        super().__init__(self.command)
        self.pace = Pace(every)
        self.fields = fields
        self.vital = vital
        self.accepted()

    def accepted(self) -> None:
        """The server answers it, as far as is known."""
        self.refused = ""
        self._refusals = 0
        self._again_at = -math.inf

    def refuse(self, why: str, now: float, longest: float) -> str:
        """Take note that the server refused it; hands back when it is asked again, for people.

        A refusal may last a moment. What there are no positions without is asked again at once and
        then less and less often (at most every `longest` s); anything else, which would only stop
        the server again, once.
        """
        self.refused = why
        self._refusals += 1
        if self.vital:
            again = _FIRST_AGAIN * 2.0 ** min(self._refusals - 2, 30) if self._refusals > 1 else 0.0
            self._again_at = now + min(again, longest)
            return "asked again"
        self._again_at = now + _ONCE_AGAIN if self._refusals == 1 else math.inf
        return "asked once again" if self._refusals == 1 else "not asked again"

    def may_be_asked(self, now: float) -> bool:
        """Whether it was not refused, or it is time to ask again."""
        return now >= self._again_at

    def named(self, data: tuple[Value, ...]) -> dict[str, tuple[Value, ...]]:
        """An answer by name.

        Raises
        ------
        LinkProtocolError
            When it is not of the form ``Name(…), Name(…)``.
        """
        return by_name(data, self.method)


def _field(section: IppChannelConfig) -> Field:
    name = section.axis or section.prop or section.scale_temperature or ""
    return Field(name, section.item, section)


def positions(config: IppConfig, every: float | None) -> IppQuestion:
    """``Get`` for all axes of that pace, of any pace when None: one answer, one moment."""
    chosen = {
        name: section
        for name, section in config.channels.items()
        if section.axis is not None and every in (None, section.period)
    }
    axes = tuple(dict.fromkeys(f"{section.axis}()" for section in chosen.values()))
    fields = {name: _field(section) for name, section in chosen.items()}
    return IppQuestion("Get", axes, every or 0.0, fields, vital=True)


def questions(config: IppConfig) -> tuple[IppQuestion, ...]:
    """All questions of a configuration.

    One ``Get`` and one ``GetScaleTemperatures`` for all channels of the same pace; a ``GetProp``
    for each property, because one that the server does not know spoils the whole command.
    """
    made: list[IppQuestion] = []
    if config.move_report is None:
        paces = {s.period: None for s in config.channels.values() if s.axis is not None}
        made += [positions(config, every) for every in paces]
    groups: dict[tuple[str, float], dict[str, Field]] = {}
    for name, section in config.channels.items():
        if section.prop is not None:
            groups.setdefault((section.prop, section.period), {})[name] = _field(section)
    made += [
        IppQuestion("GetProp", (f"{prop}()",), every, fields)
        for (prop, every), fields in groups.items()
    ]
    scales: dict[float, dict[str, Field]] = {}
    for name, section in config.channels.items():
        if section.scale_temperature is not None:
            scales.setdefault(section.period, {})[name] = _field(section)
    for every, fields in scales.items():
        axes = tuple(dict.fromkeys(f"{field.name}()" for field in fields.values()))
        made.append(IppQuestion("GetScaleTemperatures", axes, every, fields))
    return tuple(made)


def coordinate_system(data: tuple[Value, ...]) -> str:
    """The name in an answer to ``GetCoordSystem()``: ``CoordSystem(MachineCsy)``, or bare.

    Raises
    ------
    LinkProtocolError
        When there is none.
    """
    values = data
    while len(values) == 1:
        (only,) = values
        if isinstance(only, str):
            return only
        if not isinstance(only, Named):
            break
        if only.values is None:
            return only.name
        values = only.values
    raise LinkProtocolError(f"found {', '.join(map(shown, data))!r}, expected a coordinate system")
