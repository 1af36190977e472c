"""The parameters of a cause as its table shows them: a curve's coefficients in one row."""

from __future__ import annotations

import re

import numpy as np

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.diagnosis.explain import amount, parameter
from abbe.compcore.diagnosis.findings import Established
from abbe.compcore.diagnosis.screening.parameters import Estimate
from abbe.compcore.diagnosis.verdict import Diagnosis
from abbe.daemon.report.page import number

_CURVE = 3
"""So many coefficients are a curve."""
_LARGEST = "the curve's largest deviation where it was measured"
_OUTSIDE = "  ← outside"


def parameter_row(estimate: Estimate) -> list[str]:
    """A parameter, as it would be fitted, what is plausible, and what it is."""
    e = estimate
    return [
        e.name,
        parameter(e).split(" = ", 1)[1] if e.measured else "not measured",
        f"{amount(e.range[0], e)} … {amount(e.range[1], e)}" + ("" if e.plausible else _OUTSIDE),
        e.description,
    ]


def parameter_rows(diagnosis: Diagnosis, established: Established) -> list[list[str]]:
    """The parameters of a cause, a row each; the coefficients of a curve in one.

    They trade with each other, with zeros and slopes: each alone is hardly known, however well the
    curve is.
    """
    curve = []
    if isinstance(getattr(established.effect, "shape", None), str):
        curve = [e for e in established.estimates if re.fullmatch(r"c[0-9]+", e.name)]
    if len(curve) < _CURVE:
        return [parameter_row(e) for e in established.estimates]
    sizes = [
        f"{number(size * factor, 3)} {unit}"
        for rotations, unit, factor in ((False, "µm", 1e3), (True, "µrad", 1e6))
        if (size := largest_of(diagnosis, established, rotations=rotations))
    ]
    low, high = curve[0].range
    row = [
        f"{curve[0].name} … {curve[-1].name}",
        ", ".join(sizes),
        f"{amount(low, curve[0])} … {amount(high, curve[0])}"
        + ("" if all(e.plausible for e in curve) else _OUTSIDE),
        _LARGEST,
    ]
    return [row, *(parameter_row(e) for e in established.estimates if e not in curve)]


def largest_of(diagnosis: Diagnosis, established: Established, *, rotations: bool) -> float:
    """The largest error of a cause that the campaign shows, mm or rad."""
    campaign = diagnosis.result.problem.campaign
    shown = campaign.kind == (Kind.ROTATION if rotations else Kind.DISPLACEMENT)
    return float(np.abs(established.signature[shown]).max(initial=0.0))
