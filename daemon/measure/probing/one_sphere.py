"""One sphere measured: again where signals were lost or its form is bad; or left out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.sphere import FittedSphere
from abbe.compcore.errors import AbbeError
from abbe.daemon.measure.machine_view import SeenMachine
from abbe.daemon.measure.probing.artefact import TouchingWork
from abbe.daemon.measure.probing.touched_sphere import MissedSphereError, SphereToucher

F64 = NDArray[np.float64]
_TRIES = 2


async def one_sphere(
    work: TouchingWork,
    toucher: SphereToucher,
    name: str,
    visit: int,
    where: Callable[[SeenMachine], tuple[F64, F64]],
    radius: float | None,
) -> tuple[FittedSphere, SeenMachine] | None:
    """A sphere and what was seen when it had been touched; None: it is left out, and that is said.

    Parameters
    ----------
    name
        For people: ``ball 3 of p1``.
    where
        What is seen → its middle, and the direction to which it looks.
    radius
        Of the touched points about its middle, mm.

    Raises
    ------
    AbbeError
        When it is missed and nothing may be left out.
    """
    coarse = ""
    for _ in range(_TRIES):
        centre, normal = where(await work.eyes.complete())
        try:
            sphere = await toucher.measure(centre, normal, radius)
        except MissedSphereError as error:
            words = f"{name}: {error}"
            if work.section.missed == "stop":
                raise AbbeError(words) from None
            await toucher.leave(centre, normal, error)
            work.news.event("missed", f"{words}; left out", visit=visit + 1)
            return None
        then = await work.eyes.look()
        if work.eyes.missing(then):
            continue  # what was missing meanwhile is waited for, and the sphere is touched again
        form = sphere.form * 1e3
        if form <= work.section.max_form:
            return sphere, then
        coarse = f"form deviation {form:.1f} µm"
        work.news.event("unsteady", f"{name}: {coarse}; touched again", visit=visit + 1)
    work.news.event("missed", f"{name}: {coarse or 'signals missing'}; left out", visit=visit + 1)
    return None
