"""The kinds of torment: how long each lasts and how strong it is."""

from __future__ import annotations

from typing import NamedTuple


class TormentKind(NamedTuple):
    """One kind of torment.

    Attributes
    ----------
    seconds
        Shortest and longest, s.
    amount
        Range of its strength; what it means the kind says.
    text
        What happens.
    """

    seconds: tuple[float, float]
    amount: tuple[float, float]
    text: str


KINDS: dict[str, TormentKind] = {
    "late": TormentKind((0.3, 2.0), (0.03, 1.6), "sampled at once, answered so many s later"),
    "frozen": TormentKind(
        (0.1, 2.5), (0, 0), "a gateway that repeats its last picture of the machine"
    ),
    "heartbeat_frozen": TormentKind((0.8, 2.5), (0, 0), "the machine's heartbeat stands still"),
    "status_lost": TormentKind((0.05, 2.0), (0, 1), "not referenced (below 0.5), or a fault bit"),
    "split": TormentKind((0.3, 2.0), (0.0, 0.03), "answers in pieces, so many s apart"),
    "partial": TormentKind((0.1, 1.0), (0.1, 0.9), "only this share of an answer, then nothing"),
    "wrong_id": TormentKind(
        (0.2, 1.5), (0, 1), "foreign answers; below 0.5 instead, else before the own"
    ),
    "duplicated": TormentKind((0.3, 2.0), (0.0, 0.05), "every answer twice, so many s apart"),
    "swapped": TormentKind((0.3, 1.5), (0, 0), "an answer goes out after the next one's"),
    "refused": TormentKind((0.1, 0.4), (0, 1), "every question is refused"),
    "refused_long": TormentKind(
        (0.6, 3.0), (0, 1), "every question is refused, for longer than hold"
    ),
    "narrow": TormentKind((0.1, 0.5), (0, 1), "questions for more than two values are refused"),
    "flood": TormentKind((0.3, 1.0), (0, 1), "noise and foreign answers, unasked, without end"),
    "silent": TormentKind((0.1, 3.0), (0, 0), "no answer"),
    "reset": TormentKind((0.05, 0.1), (0, 0), "the connection is cut"),
    "away": TormentKind((0.2, 2.0), (0, 0), "the connection is cut and refused"),
    "mirrored": TormentKind((1.5, 3.0), (0, 0), "what is written appears where positions are read"),
    "write_refused": TormentKind((0.2, 5.0), (0, 0), "writes are refused"),
    "write_late": TormentKind(
        (0.2, 2.0), (0.02, 1.5), "writes are taken and answered so many s later"
    ),
    "write_unanswered": TormentKind(
        (0.2, 2.0), (0, 1), "not answered; below 0.5 taken all the same"
    ),
    "foreign": TormentKind((0.1, 2.0), (0, 0), "somebody else writes into Abbe's registers"),
    "sensor_jump": TormentKind((0.02, 3.0), (60.0, 60.0), "X's thermometer shows this, °C"),
    "sensor_bad": TormentKind((0.3, 3.0), (0, 0), "X's thermometer is broken"),
}

LAST = frozenset({"mirrored"})
"""Abbe stops for good, and rightly: one of these, when the machine stands, ends a script."""
