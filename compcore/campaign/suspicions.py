"""Suspicions about a campaign: a wrong unit, a turned sign, an absurd uncertainty, said first.

Nothing here is refused: a machine may be that good or that bad. But a fit that is too good is as
suspicious as one that is too bad, and both have causes that are found in a minute once they are
named.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.alike import alike
from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.campaign.copied_rows import of_copies
from abbe.compcore.campaign.likely_units import of_positions
from abbe.compcore.campaign.misplaced_tools import of_tools
from abbe.compcore.campaign.switched_units import of_switched_units
from abbe.compcore.campaign.turned_axes import of_turned_axes
from abbe.compcore.campaign.units_of_set_ups import of_set_ups
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import BODIES, like_fahrenheit, perhaps_fahrenheit
from abbe.compcore.sentences import said
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_FEW = 10
"""Rows below which values say nothing."""
_STILL = 2e-5
"""mm: displacements over a travel that vary by less were hardly read in µm."""
_STILL_ANGLE = 2e-8
"""rad, likewise."""
_WILD, _WILD_ANGLE = 1.0, 5e-3
"""mm and rad: errors that vary by more were hardly read in µm, µrad."""
_TRAVEL = 10.0
"""mm that an axis must have moved for its errors to vary."""
_LITTLE, _MUCH = 0.1, 25.0
"""χ² per degree of freedom beyond which the stated uncertainties are doubted."""
_ENOUGH = 20
"""Degrees of freedom from which on χ² is judged."""
_ALIKE = 0.8
"""Correlation of measured and predicted values from which on their ratio means something."""
_SEEN = 3.0
"""Standard uncertainties that predicted values must differ by, rms, for that."""
_LENGTHS = {"mm": 1e3, "inches": 25.4e3}
_ANGLES = {"mm/m": 1e3, "degrees": 17453.29}
_RATIOS = {
    1e3: "1000: were nm or µm taken for µm or mm",
    1e-3: "1/1000: were mm written where µm belong",
    25.4: "25.4: were they written in thousandths of an inch",
    1.0 / 25.4: "1/25.4: inches and millimetres are confused",
}
_RATIOS_OF_ANGLES = {
    1e3: "1000: nrad and µrad are confused",
    1e-3: "1/1000: were mm/m (mrad) written where µrad belong",
    0.2062648: "0.206: were arc seconds written where µrad belong",
    4.848137: "4.85: µrad were taken for arc seconds",
    5.729578e-5: "1/17453: were degrees written where µrad belong",
}
_TURNED = 0.5
"""From which negative ratio on a sign counts as turned."""
_CLOSE = 0.05
"""Part by which a ratio may be off and still be that of two units."""


def of_values(campaign: Campaign, values: F64) -> Iterator[str]:
    """Measured values that vary far too little, or far too much, for their unit.

    Parameters
    ----------
    values
        Shape (n,): measured values without the set-ups' zeros, mm or rad.
    """
    for kind, name, unit, others, factor, least, most in (
        (Kind.DISPLACEMENT, "displacements", "µm", _LENGTHS, 1e3, _STILL, _WILD),
        (Kind.ROTATION, "rotations", "µrad", _ANGLES, 1e6, _STILL_ANGLE, _WILD_ANGLE),
    ):
        rows = campaign.kind == kind
        if rows.sum() < _FEW or not _moved(campaign, rows):
            continue
        size = float(np.sqrt(np.mean(values[rows] ** 2)))
        if size < least:
            how = (
                "are all 0"
                if size == 0.0
                else f"vary by {in_digits(size * factor, 2)} {unit} rms only"
            )
            yield (
                f"the {name} {how}: the column 'value' is in {unit}; were they written in "
                f"{_in_others(size * factor, unit, others)}?"
            )
        elif size > most:
            yield (
                f"the {name} vary by {in_digits(size * factor)} {unit} rms: no machine errs "
                f"that much; the column 'value' is in {unit}"
            )


def _in_others(size: float, unit: str, others: Mapping[str, float]) -> str:
    """``mm (then 4.2 µm rms) or inches (then 107 µm rms)``; what is 0 is 0 in any unit."""
    if size == 0.0:
        return " or ".join(others)
    return " or ".join(
        f"{other} (then {in_digits(size * times, 2)} {unit} rms)" for other, times in others.items()
    )


def of_campaign(campaign: Campaign, machine: Machine) -> Iterator[str]:
    """What is wrong whatever the model: units of positions, senses, tools, copied rows."""
    yield from of_positions(campaign, machine)
    yield from of_set_ups(campaign, machine)
    yield from of_turned_axes(campaign, machine)
    yield from of_tools(campaign, machine)
    yield from of_copies(campaign)


def without_zeros(campaign: Campaign) -> F64:
    """Measured values less the mean of their set-up and kind, shape (n,), mm or rad."""
    out = campaign.value.copy()
    setup = campaign.conditions.setup
    names = np.zeros(campaign.n, dtype=np.int64)
    if setup is not None:
        names = np.unique(setup, return_inverse=True)[1].reshape(-1)
    group = names * len(Kind) + campaign.kind
    _, index = np.unique(group, return_inverse=True)
    index = index.reshape(-1)
    mean = np.bincount(index, weights=out) / np.bincount(index)
    return np.asarray(out - mean[index])


def of_signals(
    campaign: Campaign, machine: Machine, measured: Mapping[str, tuple[float, float]]
) -> Iterator[str]:
    """Thermometers that seem to read °F, throughout or from some row on.

    `measured`: where each ranged, °C, in the campaigns that the model was fitted to; a heated bed
    that went there from what can only be °C is not asked about again.
    """
    for name, values in campaign.conditions.signals.items():
        signal = machine.signals.get(name)
        known = values[np.isfinite(values)]
        if signal is None or signal.unit != "degC" or signal.role not in BODIES or not len(known):
            continue
        middle = float(np.median(known))
        low, high = measured.get(name, (math.nan, math.nan))
        celsius = not (like_fahrenheit(low) and like_fahrenheit(high))
        if not (celsius and low <= middle <= high):
            yield from perhaps_fahrenheit(name, middle, signal.role)
        yield from of_switched_units(campaign, name, values)


def of_unknown_thermometers(campaign: Campaign) -> Iterator[str]:
    """The same of an imported file's thermometers, which no model knows: ``T_air``, ``T_…``."""
    for name, values in campaign.conditions.signals.items():
        known = values[np.isfinite(values)]
        if name.startswith("T_") and len(known):
            yield from perhaps_fahrenheit(name, float(np.median(known)), "other", "the file")


def of_chi2(
    chi2_per_dof: float,
    dof: int,
    *,
    stated: bool,
    repeats: bool = False,
    what: str | None = None,
) -> Iterator[str]:
    """χ² per degree of freedom far from 1.

    Parameters
    ----------
    stated
        Whether anything but the residuals themselves says how uncertain the rows are.
    repeats
        Whether that is the scatter of repeated readings alone, which may hold what the model
        explains: that less is left is then not suspicious.
    what
        The rows that are meant, ``lengths`` or ``rotations``; None for all of them together.
    """
    if not stated or dof < _ENOUGH or not math.isfinite(chi2_per_dof):
        return
    if repeats and chi2_per_dof < 1.0:
        return
    times = math.sqrt(chi2_per_dof)
    of = said("χ²/dof") if what is None else said("χ²/dof of {what}", what=what)
    if chi2_per_dof < _LITTLE:
        yield said(
            "{of} is {chi2}: {by} than the stated uncertainties say. They are too "
            "large, the values are in another unit, or rows were smoothed or copied",
            of=of,
            chi2=in_digits(chi2_per_dof, 2),
            by=said("{times} times less is left", times=in_digits(1 / times))
            if times > 0.0
            else said("nothing is left"),
        )
    elif chi2_per_dof > _MUCH and repeats:
        yield said(
            "{of} is {chi2}: what is left is {times} times the scatter of repeated readings. The "
            "model lacks something, or a sign or a unit is wrong",
            of=of,
            chi2=in_digits(chi2_per_dof),
            times=in_digits(times),
        )
    elif chi2_per_dof > _MUCH:
        yield said(
            "{of} is {chi2}: what is left is {times} times the stated "
            "uncertainties. The model lacks something, a sign or a unit is wrong, "
            "or the uncertainties are too small",
            of=of,
            chi2=in_digits(chi2_per_dof),
            times=in_digits(times),
        )


def of_ratio(campaign: Campaign, measured: F64, predicted: F64, weight: F64) -> Iterator[str]:
    """Measured values that are a multiple, or the opposite, of what a model predicts.

    Parameters
    ----------
    measured, predicted
        Shape (n,): mm or rad, both without what the set-ups leave unknown.
    weight
        Shape (n,): one over the standard uncertainty.
    """
    setup = campaign.conditions.setup
    for kind, name, ratios in (
        (Kind.DISPLACEMENT, "displacements", _RATIOS),
        (Kind.ROTATION, "rotations", _RATIOS_OF_ANGLES),
    ):
        rows = campaign.kind == kind
        whole = _ratio(measured, predicted, weight, rows)
        if whole is not None and whole < -_TURNED:
            yield f"{name}: {_SIGN} ({in_digits(whole)} times)"
        elif setup is not None:
            turned = [
                str(setup[own[0]])
                for own in sorted(alike(setup), key=lambda r: int(r[0]))
                if (_ratio(measured, predicted, weight, own[rows[own]]) or 1.0) < -_TURNED
            ]
            if turned:
                yield f"{name}: {_SIGN} in the set-up{'s' * (len(turned) > 1)} {_list(turned)}"
        for ratio, words in ratios.items():
            if whole is not None and abs(abs(whole) / ratio - 1.0) < _CLOSE:
                yield f"{name}: measured is predicted times {words}?"


_SIGN = (
    "measured is the opposite of predicted. Is it nominal − actual, a compensation, or an artefact "
    "that was measured? (error = actual − indicated)"
)


def _ratio(measured: F64, predicted: F64, weight: F64, rows: NDArray[np.generic]) -> float | None:
    """Measured over predicted, where the two go together over some of the rows."""
    m, p = measured[rows] * weight[rows], predicted[rows] * weight[rows]
    if len(m) < _FEW or float(np.sqrt(np.mean(p**2))) < _SEEN:
        return None
    size = float(np.linalg.norm(m) * np.linalg.norm(p))
    if size == 0.0 or abs(float(m @ p)) < _ALIKE * size:
        return None
    return float(m @ p / (p @ p))


def _moved(campaign: Campaign, rows: NDArray[np.bool_]) -> bool:
    return any(
        float(np.ptp(q[rows])) > _TRAVEL
        for axis, q in campaign.conditions.positions.items()
        if axis[0] in "XYZUVWR"
    )


def _list(names: list[str]) -> str:
    shown = ", ".join(names[:6])
    return shown if len(names) <= 6 else f"{shown} and {len(names) - 6} more"
