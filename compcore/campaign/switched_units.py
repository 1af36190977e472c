"""A thermometer that was switched from °C to °F, or back, in the middle of a campaign."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import BODIES
from abbe.compcore.sentences import said
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_JUMP = 15.0
"""K: no body of a machine warms by more from one reading to the next."""
_AGREES = 2.0
"""K by which the reading after the jump may differ from the one before it in the other unit."""
_SOON = 60.0
"""s between two readings that a body cannot have warmed in."""


def switched_thermometers(campaign: Campaign, machine: Machine) -> Iterator[str]:
    """Of every thermometer of a body that is in °C the first place where it goes on in °F."""
    for name, values in campaign.conditions.signals.items():
        signal = machine.signals.get(name)
        if signal is not None and signal.unit == "degC" and signal.role in BODIES:
            yield from of_switched_units(campaign, name, values)


def of_switched_units(campaign: Campaign, name: str, values: F64) -> Iterator[str]:
    """The first place where a thermometer's readings go on in the other unit.

    Parameters
    ----------
    name, values
        The signal and its readings in the campaign's rows, (n,), as °C; NaN where none.
    """
    conditions = campaign.conditions
    known = np.flatnonzero(np.isfinite(values))
    run = np.zeros(campaign.n, dtype=np.int64) if conditions.run is None else conditions.run
    time = conditions.time if campaign.clocked else np.zeros(campaign.n)
    rows = known[np.lexsort((known, time[known], run[known]))]
    one, other = values[rows[:-1]], values[rows[1:]]
    near = (run[rows[1:]] == run[rows[:-1]]) & (time[rows[1:]] - time[rows[:-1]] <= _SOON)
    near &= np.abs(other - one) > _JUMP
    up = np.abs(other - _fahrenheit(one)) < _AGREES * 1.8
    down = np.abs(one - _fahrenheit(other)) < _AGREES * 1.8
    found = np.flatnonzero(near & (up | down))
    if not len(found):
        return
    k = int(found[0])
    yield said(
        "{name} reads {before} in line {line} and {after} in line {next}: was it switched "
        "{to}? Write all of its readings in °C",
        name=name, before=in_digits(float(one[k]), 3), line=int(campaign.line[rows[k]]),
        after=in_digits(float(other[k]), 3), next=int(campaign.line[rows[k + 1]]),
        to=said("to °F") if up[k] else said("from °F to °C"),
    )  # fmt: skip


def _fahrenheit(celsius: F64) -> F64:
    return 1.8 * celsius + 32.0
