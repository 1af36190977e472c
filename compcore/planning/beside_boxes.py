"""Set-ups that a plan leaves out because the tool would enter a keep-out box."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.targets import SurveyTask


@dataclass(frozen=True, slots=True)
class Hindered:
    """A set-up that could be done if it were not for a keep-out box.

    Attributes
    ----------
    what
        What is measured and where, as a plan says it.
    instrument
        The instrument's name for people.
    box
        Number of the first box that the tool would enter, from 1.
    """

    what: str
    instrument: str
    box: int


def hindered(task: SurveyTask, setups: Iterable[PlannedSetup]) -> tuple[Hindered, ...]:
    """Those of some set-ups that a keep-out box alone hinders.

    What the travels do not hold is not among them: no other arrangement of fixtures would help.
    """
    space = task.space
    if not space.keep_out:
        return ()
    open_space = replace(space, keep_out=())
    alone = [replace(space, keep_out=(box,)) for box in space.keep_out]
    found = []
    for setup in setups:
        if open_space.hindrance(task.machine, setup) is not None:
            continue
        in_way = (i for i, s in enumerate(alone, 1) if s.hindrance(task.machine, setup) is not None)
        box = next(in_way, None)
        if box is not None:
            found.append(Hindered(setup.what, setup.instrument.title, box))
    return tuple(found)
