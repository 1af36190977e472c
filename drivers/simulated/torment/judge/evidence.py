"""Evidence: the messages on the wire with their times; all that the checker sees."""

from __future__ import annotations

import io
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from abbe.drivers.simulated.torment.loop import Moment

AXES = ("X", "Y", "Z")
EVERYTHING = frozenset((*AXES, "number", "heartbeat", "status", "T_x"))
"""All that one picture of the machine can tell."""


@dataclass(frozen=True, slots=True)
class ShownPicture:
    """One picture of the machine, as an answer that Abbe may believe carried it.

    Attributes
    ----------
    number
        Sample number.
    sampled
        Monotonic time at which the machine was there, s.
    sent
        When the last byte of the answer went out.
    place
        As shown, mm.
    beat
        The machine's heartbeat, not wrapped.
    status
        Its status word.
    temperature
        Of the X scale, °C, as shown; NaN: broken.
    frozen
        The picture is an old one, and its heartbeat is the only thing that tells.
    mirrored
        What was held when what is held began to appear where positions are; the machine stands.
    covers
        What of it the answer stated.
    """

    number: int
    sampled: float
    place: tuple[float, float, float]
    beat: int
    status: int
    temperature: float
    frozen: bool = False
    mirrored: tuple[float, float, float] | None = None
    sent: float = 0.0
    covers: frozenset[str] = EVERYTHING


@dataclass(frozen=True, slots=True)
class Taken:
    """One message that the controller took: what it has from then on.

    Attributes
    ----------
    moment
        Between which times it can have come.
    values
        X, Y, Z (mm), status, heartbeat, echo: those that it held.
    """

    moment: Moment
    values: dict[str, float]


class Judge(Protocol):
    """A judge of the messages on the wire."""

    def sent(self, shown: ShownPicture) -> None:
        """An answer that may be believed went out as a whole."""

    def taken(self, taken: Taken) -> None:
        """The controller took a message."""

    def overwritten(self, now: float) -> None:
        """Somebody else wrote into the registers that are Abbe's."""


class WireLog:
    """Every message with its time, one line each, into a file.

    Parameters
    ----------
    path
        The file.
    begin
        Monotonic time that counts as 0, s.
    """

    def __init__(self, path: Path, begin: float) -> None:
        self._begin = begin
        self._path = path
        self._file: io.TextIOWrapper | None = None

    def open(self) -> None:
        """Begin the file; nothing is noted before."""
        self._file = self._path.open("w", encoding="utf-8")

    def say(self, arrow: str, data: bytes | str) -> None:
        """Note bytes (`<` came, `>` went) or a word."""
        if self._file is None:
            return
        text = data if isinstance(data, str) else f"{data[:120].hex(' ')}  {data[:120]!r}"
        self._file.write(f"{time.monotonic() - self._begin:10.4f} {arrow} {text}\n")

    def close(self) -> None:
        """End the file."""
        if self._file is not None:
            self._file.close()
            self._file = None
