"""Between a computed correction and the controller; ``guard.py`` says what it promises."""

from daemon.guard.direction import GuardState
from daemon.guard.guard import Decision, Guard
from daemon.guard.limits import ALL, DIRECTIONS, ZERO, GuardLimits, Vec3

__all__ = [
    "ALL",
    "DIRECTIONS",
    "ZERO",
    "Decision",
    "Guard",
    "GuardLimits",
    "GuardState",
    "Vec3",
]
