"""Readings that are doubtful: of another sign or unit, frozen, slipped between two targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from abbe.compcore.units import in_digits

_LENGTHS = {"m": 1e3, "mm": 1.0, "µm": 1e-3, "nm": 1e-6, "inches": 25.4}
"""What an instrument may read in, mm."""
_INCH = 25.4
_SLOW = (0.0, 0.5)
"""Factors that a read-out shows, too, that is slow or was reset meanwhile."""
_NEAR = 0.02
"""Part by which a factor may be off."""
_SHORT = 0.5
"""Part of a nominal distance by which one may be off, mm or m mixed up are not."""
_IN_A_ROW = 6
"""Targets at which the very same is read."""
_FEW, _TINY = 4, 0.05
"""Targets by which it is told that readings are too small, and that part of their uncertainty."""


def not_followed(
    way: Sequence[float], moved: Sequence[float], unit: str = "mm", channel: str = ""
) -> str:
    """That a reading does not follow the machine, what may be wrong, and what to do.

    Parameters
    ----------
    way
        What the reading, less what a perfect machine shows, has changed by since the last target,
        mm; each direction.
    moved
        What a perfect machine shows has changed by.
    unit, channel
        In which it is configured to be read, and what it is read from.
    """
    words, factor = _moves(way, moved)
    why = "" if factor is None else _why(factor, unit, channel)
    return f"{words}: {why or 'is it set up along this line, and read in its own unit?'}"


def known_fault(
    way: Sequence[float],
    moved: Sequence[float],
    unit: str = "mm",
    channel: str = "",
    *,
    slow: bool = False,
) -> str:
    """The same where what is wrong is known by how a reading moves; else empty.

    `slow`: it may be a read-out that is slow, or was reset on the way.
    """
    words, factor = _moves(way, moved)
    if factor is None or (slow and any(_is(factor, f) for f in _SLOW)):
        return ""
    why = _why(factor, unit, channel)
    return f"{words}: {why}" if why else ""


def _moves(way: Sequence[float], moved: Sequence[float]) -> tuple[str, float | None]:
    """By how much a reading and the machine have moved, in words, and the one over the other."""
    k = max(range(len(way)), key=lambda i: abs(way[i]))
    read = way[k] + moved[k]
    words = f"has moved by {read:+.4f} mm, the machine along it by {moved[k]:+.4f} mm"
    return words, read / moved[k] if moved[k] else None


def _why(factor: float, unit: str, channel: str) -> str:
    """What it comes from that a reading moves so much more or less, and what to do; or empty."""
    if _is(factor, 0.0):
        return "it stands still: does it see what moves, and is its unit not far too small?"
    turned = factor < 0.0
    own = "µm" if unit == "um" else unit
    size, wrong = abs(factor), ""
    if _is(size, _INCH):
        wrong = "it reads mm that are taken for inches: take the scale of 25.4 out of its channel"
    for name, mm in _LENGTHS.items():
        if name != own and _is(size, _LENGTHS[own] / mm):
            do = f"set it to {own}"
            if name != "inches":
                typed = name.replace("µ", "u")
                do = f'say unit = "{typed}" of its channel {channel}, or {do}'
            wrong = f"it reads {name} that are taken for {own}: {do}"
    if _is(size, 2.0):
        wrong = "it counts every way twice"
    elif _is(size, 0.5):
        wrong = "it counts half of every way"
    sign = "the sign is turned (sign = -1, or 1)"
    if turned and (wrong or _is(size, 1.0)):
        return f"{sign}, and {wrong}" if wrong else sign
    return wrong


def _is(factor: float, wanted: float) -> bool:
    return abs(factor - wanted) <= _NEAR * max(wanted, _NEAR)


def other_unit(values: Sequence[float], nominal: Sequence[float]) -> str:
    """That distances cannot be those of the plan, in words; else empty.

    Parameters
    ----------
    values
        Distances less the nominal ones, mm.
    nominal
        From where the plan has the instrument stand.
    """
    for value, far in zip(values, nominal, strict=True):
        if abs(value) > _SHORT * max(far, 1.0):
            return (
                f"reads {value + far:.3f} mm, where it stands {far:.0f} mm away by the plan: is it "
                "read in its own unit, and does it stand there?"
            )
    return ""


def size_words(size: float, *, angle: bool) -> str:
    """A size (mm or rad) for people: ``54 µm``."""
    return f"{in_digits(size * (1e6 if angle else 1e3))} {'µrad' if angle else 'µm'}"


@dataclass(frozen=True, slots=True)
class _Visit:
    values: tuple[float, ...]
    time: float


@dataclass(frozen=True, slots=True)
class _Repetition:
    """A visit held against the one before it: from the other side or not, by how much, when."""

    turned: bool
    differs: tuple[float, ...]
    since: float


class RepeatedTargets:
    """Targets of one zero that are read more than once: what each visit differs by from another.

    From one target to the next this changes by little, whatever the machine's error: by play that
    is not the same everywhere, by drift of seconds, by scatter. A lost count changes it at once.
    """

    def __init__(self) -> None:
        self._seen: dict[tuple[int, int], _Visit] = {}
        self._times: list[float] = []
        self._last: _Repetition | None = None
        self._undo: tuple[tuple[int, int], _Visit | None, _Repetition | None] | None = None

    def forget(self) -> None:
        """Begin anew, with another zero."""
        self._seen.clear()
        self._times.clear()
        self._last = self._undo = None

    def withdraw(self) -> None:
        """Take the visit that was added last away, once."""
        if self._undo is None:
            return
        at, seen, self._last = self._undo
        self._undo = None
        del self._seen[at]
        if seen is not None:
            self._seen[at] = seen
        self._times.pop()

    def change(self, target: int, sense: int, values: Sequence[float]) -> float:
        """By how much more, or less, a visit differs from an earlier one than the last visit did.

        0 where one of the two was no repetition, mm or rad; `sense` as `SetupVisits` has it.
        """
        now, last = self._repetition(target, sense, values), self._last
        if now is None or last is None or now.turned is not last.turned:
            return 0.0
        return max(abs(a - b) for a, b in zip(now.differs, last.differs, strict=True))

    def perhaps_lost(self, target: int, sense: int, values: Sequence[float]) -> list[float]:
        """Since when earlier visits may have counted from elsewhere, where `change` is large, s.

        The count was lost since the last visit, or between the two earlier visits that this one and
        the last are held against: nobody can tell. The times of the later of those, and of all that
        were between them.
        """
        now, last = self._repetition(target, sense, values), self._last
        if now is None or last is None:
            return []
        first, end = sorted((now.since, last.since))
        return [t for t in self._times if first < t <= end]

    def add(self, target: int, sense: int, values: Sequence[float], time: float) -> None:
        """Take a visit in; `time` is that of its rows, s."""
        self._undo = (target, sense), self._seen.get((target, sense)), self._last
        self._last = self._repetition(target, sense, values)
        self._seen[target, sense] = _Visit(tuple(values), time)
        self._times.append(time)

    def _repetition(self, target: int, sense: int, values: Sequence[float]) -> _Repetition | None:
        same = self._seen.get((target, sense))
        before = same or self._seen.get((target, -sense))
        if before is None:
            return None
        differs = tuple(v - b for v, b in zip(values, before.values, strict=True))
        return _Repetition(same is None, differs, before.time)


class TinyReadings:
    """Notices an instrument of errors whose first targets differ by far less than it can tell.

    An instrument scatters by its uncertainty; one that is read in too small a unit seems not to.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self._seen: list[tuple[float, ...]] = []

    def add(self, values: Sequence[float], sd: float) -> bool:
        """Take a target in; whether the first few have just shown it."""
        self._seen.append(tuple(values))
        if len(self._seen) != _FEW:
            return False
        ranges: list[float] = [
            max(column) - min(column) for column in zip(*self._seen, strict=True)
        ]
        return 0.0 < max(ranges) < _TINY * sd


class SameReadings:
    """Counts targets in a row at which an instrument has read the very same, to the last digit."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self.count = 0
        self._values: tuple[float, ...] = ()

    def add(self, values: Sequence[float]) -> bool:
        """Take a target in; whether they have just become suspiciously many."""
        now = tuple(values)
        self.count = self.count + 1 if now == self._values else 1
        self._values = now
        return self.count == _IN_A_ROW
