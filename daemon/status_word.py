"""Abbe's status word: its state for the controller, 16 bits in one register."""

from __future__ import annotations

import enum

from abbe.daemon.guard import ALL, Decision, GuardState


class Status(enum.IntFlag):
    """Bits of the status word; ``docs/daemon.md`` is their page.

    A controller that finds `RUNNING` at 0, or the heartbeat standing still, must take its own
    uncorrected positions.
    """

    RUNNING = 1 << 0
    """Abbe runs and its cycle lives."""
    COMPENSATING = 1 << 1
    """Every direction is corrected in full: the corrected positions are what the model says."""
    HOLDING = 1 << 2
    """At least one direction is on a held correction."""
    RAMPING = 1 << 3
    """At least one direction's correction is being ramped to zero, or back in."""
    SIZE_LIMITED = 1 << 4
    """The computed correction is larger than allowed and was cut."""
    RATE_LIMITED = 1 << 5
    """The computed correction changes faster than allowed."""
    POSITION_FAULT = 1 << 6
    """At least one axis's position is missing, bad or stale."""
    SIGNAL_FAULT = 1 << 7
    """At least one signal (temperature, …) is missing, bad or stale."""
    INTERNAL_FAULT = 1 << 8
    """The compensator failed; the journal says why."""
    ENDING = 1 << 9
    """Abbe was asked to end and ramps the correction to zero."""
    WRITE_FAULT = 1 << 10
    """The controller did not take what was written last, or it is not known whether it did."""
    FOREIGN = 1 << 11
    """Somebody else writes what Abbe writes, or a position is what Abbe wrote itself."""
    X_ACTIVE = 1 << 12
    """X is corrected in full."""
    Y_ACTIVE = 1 << 13
    """Y is corrected in full."""
    Z_ACTIVE = 1 << 14
    """Z is corrected in full."""
    ORIENTED = 1 << 15
    """The rotary axes are corrected in full: the tool's direction is what they can make of it, none
    of it lost near a pole. Always 0 where no rotary axis is corrected."""


STOPPED = 0
"""Written last: Abbe ended; corrected positions are no longer written."""

LARGEST_WITH_TURNS = sum(Status)
"""Largest number that the status word can be where rotary axes are corrected."""
LARGEST = LARGEST_WITH_TURNS - Status.ORIENTED
"""The same where only X, Y and Z are."""

_FIRST_ACTIVE = 12
_RUNNING, _COMPENSATING = int(Status.RUNNING), int(Status.COMPENSATING)
_STATE_BITS = [
    {
        GuardState.OFF: 0,
        GuardState.RISING: int(Status.RAMPING),
        GuardState.ACTIVE: int(active),
        GuardState.HOLDING: int(Status.HOLDING),
        GuardState.FALLING: int(Status.RAMPING),
    }
    for active in (Status.X_ACTIVE, Status.Y_ACTIVE, Status.Z_ACTIVE)
]


_TURN_BITS = {**_STATE_BITS[0], GuardState.ACTIVE: 0}


def status_word(
    decision: Decision, faults: int, not_held: int = 0, *, oriented: bool = True
) -> int:
    """The status word for one cycle.

    Parameters
    ----------
    decision
        What the guard handed out.
    faults
        The bits that the guard does not know of.
    not_held
        Mask of the directions whose last correction the controller did not take.
    oriented
        Whether the rotary axes do all that they can to the tool's direction.
    """
    x, y, z, *turns = decision.states
    bits_x, bits_y, bits_z = _STATE_BITS
    word = faults | _RUNNING | bits_x[x] | bits_y[y] | bits_z[z]
    if turns:
        for state in turns:
            word |= _TURN_BITS[state]
        full = turns.count(GuardState.ACTIVE) == len(turns)
        if full and oriented and not (decision.limited | not_held) >> 3:
            word |= Status.ORIENTED
    if decision.compensating and not not_held:
        return word | _COMPENSATING
    # a direction that is cut, or behind, or was not taken is not corrected in full
    word &= ~(((decision.limited | not_held) & ALL) << _FIRST_ACTIVE)
    if decision.size_limited:
        word |= Status.SIZE_LIMITED
    if decision.rate_limited:
        word |= Status.RATE_LIMITED
    return int(word)


def fault_bits(
    *,
    position: bool,
    signal: bool,
    internal: bool,
    ending: bool,
    write: bool = False,
    foreign: bool = False,
) -> int:
    """The status word's bits for what is wrong, and for the end."""
    word = Status.POSITION_FAULT if position else Status(0)
    if signal:
        word |= Status.SIGNAL_FAULT
    if internal:
        word |= Status.INTERNAL_FAULT
    if ending:
        word |= Status.ENDING
    if write:
        word |= Status.WRITE_FAULT
    if foreign:
        word |= Status.FOREIGN
    return int(word)


def describe(word: int) -> str:
    """The bits that are set, by name."""
    return " ".join(str(bit.name) for bit in Status if word & bit) or "STOPPED"
