"""Between a computed correction and the controller; ``guard.py`` says what it promises."""

from abbe.daemon.guard.direction import GuardState
from abbe.daemon.guard.guard import Decision, Guard
from abbe.daemon.guard.limits import ALL, DIRECTIONS, Correction, GuardLimits, Vec3

__all__ = [
    "ALL",
    "DIRECTIONS",
    "Correction",
    "Decision",
    "Guard",
    "GuardLimits",
    "GuardState",
    "Vec3",
]
