"""Instruments at hand: what they measure, how sure, and how long a set-up and a reading take.

The figures are those of common instruments in a workshop, for planning; a campaign states its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from abbe.compcore.errors import InputError
from abbe.compcore.sentences import said


@dataclass(frozen=True, slots=True)
class PlannedInstrument:
    """An instrument as a plan counts on it.

    Attributes
    ----------
    key
        Its name on the command line.
    title
        For people.
    setup
        Setting it up and aligning it, s.
    reading
        Settling and reading at one target, s.
    sd
        Standard uncertainty of one reading, mm (angles: rad).
    per_length
        What a length adds to it, mm per mm, to be added as squares.
    reach
        The longest line or distance that it measures, mm.
    nearest
        The shortest distance of a reflector that it is planned to look at, mm.
    there
        What a person does when the machine stands before the first target; empty where everything
        is done while the tool is drawn back.
    held
        Whether the tool holds it, so that little more than its range breaks or loses it.
    """

    key: str
    title: str
    setup: float
    reading: float
    sd: float
    per_length: float = 0.0
    reach: float = 40e3
    nearest: float = 0.0
    there: str = ""
    held: bool = False

    def uncertainty(self, length: float) -> float:
        """Standard uncertainty of one reading over a length (mm), mm or rad."""
        return float((self.sd**2 + (self.per_length * length) ** 2) ** 0.5)


_MINUTE = 60.0
_BEAM = "align the beam"
INSTRUMENTS: Mapping[str, PlannedInstrument] = {
    i.key: i
    for i in (
        PlannedInstrument(
            "laser", "laser interferometer", 20 * _MINUTE, 4.0, 3e-4, 5e-7, there=_BEAM
        ),
        PlannedInstrument(
            "straightness",
            "laser with straightness optics",
            30 * _MINUTE,
            5.0,
            8e-4,
            0.0,
            4000.0,
            there=_BEAM,
        ),
        PlannedInstrument(
            "angle", "laser with angle optics", 20 * _MINUTE, 4.0, 1e-6, 0.0, 15e3, there=_BEAM
        ),
        PlannedInstrument("level", "electronic levels", 12 * _MINUTE, 12.0, 2e-6),
        # 3 s: read standing, target by target, as `abbe measure` follows a program
        PlannedInstrument(
            "ball-bar",
            "ball bar",
            12 * _MINUTE,
            3.0,
            7e-4,
            0.0,
            300.0,
            there="put the ball bar on",
            held=True,
        ),
        PlannedInstrument(
            "tracker", "tracking interferometer", 25 * _MINUTE, 5.0, 5e-4, 5e-7, 15e3, 500.0
        ),
        PlannedInstrument(
            "laser-tracker", "laser tracker", 15 * _MINUTE, 5.0, 1e-2, 5e-6, 80e3, 1000.0
        ),
        PlannedInstrument(
            "indicator",
            "indicator on a straightedge",
            15 * _MINUTE,
            6.0,
            1e-3,
            0.0,
            500.0,
            there="let the indicator touch the straightedge",
        ),
        PlannedInstrument(
            "gauge-block", "gauge blocks and a touch probe", 8 * _MINUTE, 10.0, 1e-3, 5e-7, 500.0
        ),
        PlannedInstrument(
            "step-gauge", "step gauge and a touch probe", 12 * _MINUTE, 8.0, 8e-4, 5e-7, 620.0
        ),
        PlannedInstrument(
            "ball-plate", "ball plate and a touch probe", 18 * _MINUTE, 25.0, 1e-3, 5e-7, 400.0
        ),
        PlannedInstrument("sphere", "sphere and a touch probe", 6 * _MINUTE, 25.0, 2e-3),
        PlannedInstrument(
            "r-test",
            "R-test",
            15 * _MINUTE,
            6.0,
            1e-3,
            there="bring sphere and R-test together, near the middle of its range",
            held=True,
        ),
        PlannedInstrument(
            "rotary-calibrator",
            "rotary calibrator, or polygon and autocollimator",
            20 * _MINUTE,
            6.0,
            2.5e-6,
        ),
    )
}
"""Name on the command line → instrument."""

TOUCHED = ("gauge-block", "step-gauge", "ball-plate", "sphere")
"""Artefacts that a probe touches: a target of theirs lies in or on the artefact."""


def instruments_called(names: Sequence[str]) -> tuple[PlannedInstrument, ...]:
    """The instruments of some names, each once; ``all``: every one.

    Raises
    ------
    InputError
        For a name that none has; lists those that there are.
    """
    found: dict[str, PlannedInstrument] = {}
    for name in names:
        if name == "all":
            found.update(INSTRUMENTS)
        elif name in INSTRUMENTS:
            found[name] = INSTRUMENTS[name]
        else:
            raise InputError(
                "no such instrument",
                field="instruments",
                found=name,
                expected=said("some of all, {names}", names=", ".join(INSTRUMENTS)),
            )
    return tuple(found.values())
