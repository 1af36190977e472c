"""Evidence: how strongly the data speak for a candidate, on one scale for all.

Every candidate gets, beside the exact F-test, an evidence in units of −2·ln(likelihood):

    E = ν·dof·ln(χ²₀/χ²₁) − k·ln(ν·n) − cost

the profile likelihood ratio with unknown noise, Schwarz's price of k coefficients (linear ones that
the campaign determines, and non-linear ones), ν the part of the rows that count as independent
(`independence`), and a cost for what makes no physical sense or had to
be picked from many. Candidates that explain equally well are so ordered with the simpler and the
plausible first; differences below `INDISTINCT` are not a distinction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from abbe.compcore.diagnosis.screening.projection.bank import ScreenedCandidate
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.distributions import log_f_beyond
from abbe.compcore.effects.base import Effect
from abbe.compcore.machine.machine import Machine, Signal

INDISTINCT = 10.0
"""Difference in evidence below which two candidates count as confusable (Bayes factor 150)."""

CONVINCING = 12.0
"""Least evidence of an established candidate (Bayes factor 400, beyond all other safeguards)."""

RIGID_BODY = -40.0
"""Cost of an error motion of a rigid axis that the model lacks altogether: every axis has it, and
its shape's many coefficients are no reason to prefer two rarer causes that imitate it. It never
costs less than one coefficient (`price_of`): more motions are not better than fewer."""

IMPLAUSIBLE = 12.0
"""Cost of a fitted parameter outside its plausible range."""


def log_chance(f: float, k: int, dof: int) -> float:
    """Natural logarithm of the chance of so large an F with k and `dof` degrees of freedom."""
    return log_f_beyond(f, k, dof)


@dataclass(frozen=True)
class Evidence:
    """How strongly the data speak for one candidate.

    Attributes
    ----------
    value
        E as above; positive: the data want the candidate.
    f_drop
        Fall of χ² in units of the noise that is left afterwards.
    k, dof
        Coefficients, and degrees of freedom left with them.
    log_tests
        Logarithm of the number of tests made.
    share
        Part of the observations that count as independent.
    """

    value: float
    f_drop: float
    k: int
    dof: int
    log_tests: float
    share: float = 1.0

    @cached_property
    def log_p(self) -> float:
        """Natural logarithm of the F-test's p-value, corrected for the number of tests made."""
        if self.k == 0:
            return 0.0
        f = self.share * self.f_drop / self.k
        log_p = log_chance(f, self.k, max(1, round(self.share * self.dof)))
        return min(0.0, log_p + self.log_tests)

    @property
    def p_value(self) -> float:
        """The corrected p-value."""
        return math.exp(min(0.0, self.log_p))


def weigh(
    basis: Basis, screened: ScreenedCandidate, tests: float, cost: float, nonlinear_count: int
) -> Evidence:
    """Weigh one screened candidate.

    Parameters
    ----------
    basis
        What the model leaves.
    tests
        Number of causes tried together; each choice of non-linear parameters, or detail of the
        same cause, counts as a part of a test (neighbouring choices are alike).
    cost
        Cost in units of E, from `cost_of` or the caller.
    nonlinear_count
        Number of non-linear parameters that were chosen from the data.
    """
    k = screened.rank
    if k == 0 or screened.drop <= 0.0:
        return Evidence(-math.inf, 0.0, 0, 0, 0.0)
    left = max(basis.chi2 - screened.drop, 1e-12 * basis.chi2)
    dof = max(1, basis.dof - k - nonlinear_count)
    scale = left / dof
    log_tests = math.log(max(1.0, tests)) + 0.5 * math.log(screened.tried)
    gain = basis.share * dof * math.log(basis.chi2 / left)
    price = price_of(basis, k + nonlinear_count, cost)
    return Evidence(gain - price, screened.drop / scale, k, dof, log_tests, basis.share)


def weigh_all(
    basis: Basis,
    screened: Sequence[ScreenedCandidate],
    tests: Sequence[float],
    costs: Sequence[float],
    nonlinear_counts: Sequence[int],
) -> list[Evidence]:
    """Weigh many screened candidates that are seen; arguments as of `weigh`, one of each."""
    if not screened:
        return []
    rank = np.array([s.rank for s in screened])
    drop = np.array([s.drop for s in screened])
    tried = np.array([s.tried for s in screened])
    nonlinear = np.asarray(nonlinear_counts)
    left = np.maximum(basis.chi2 - drop, 1e-12 * basis.chi2)
    dof = np.maximum(1, basis.dof - rank - nonlinear)
    log_tests = np.log(np.maximum(1.0, tests)) + 0.5 * np.log(tried)
    one = math.log(basis.independent)
    price = np.maximum((rank + nonlinear) * one + np.asarray(costs), one)
    # where the model leaves nothing there is nothing to explain: those are not seen, below
    with np.errstate(divide="ignore", invalid="ignore"):
        value = basis.share * dof * np.log(basis.chi2 / left) - price
        f_drop = drop / (left / dof)
    found = zip(
        value.tolist(),
        f_drop.tolist(),
        rank.tolist(),
        dof.tolist(),
        log_tests.tolist(),
        (drop > 0.0).tolist(),
        strict=True,
    )
    return [
        Evidence(v, f, k, d, logs, basis.share) if seen else Evidence(-math.inf, 0.0, 0, 0, 0.0)
        for v, f, k, d, logs, seen in found
    ]


def price_of(basis: Basis, count: int, cost: float) -> float:
    """What a cause of so many coefficients costs; what is expected, at least one coefficient."""
    one = math.log(basis.independent)
    return max(count * one + cost, one)


def cost_of(effect: Effect, machine: Machine, setups: int) -> float:
    """What makes an effect less likely before any data are seen, in units of −2·ln.

    Signals that sit elsewhere than the effect, or of a role that has no way to cause it; one of
    many set-ups picked out; an empirical formula.
    """
    cost = 0.0
    if effect.scope == "instrument":
        cost += 2.0
        # one set-up picked out of many; what holds for several was not picked
        if getattr(effect, "setup", None) or len(getattr(effect, "setups", None) or ()) == 1:
            cost += 2.0 * math.log(max(1, setups))
    if effect.kind == "formula":
        cost += 12.0
    if effect.kind == "local_defect":
        cost += 8.0  # any shape with too few knots looks a little like a dent somewhere
    if effect.kind == "setup_scale":
        cost += 1.0  # one line that is too short is a beam's or a gauge's angle
    if effect.kind == "gravity_flexure" and getattr(effect, "by", None):
        cost += 2.0  # what no other place tells from it sags in its own bearings
    if effect.kind == "reversal_angle":
        cost += 2.0  # one that no lever tells from a backlash is a backlash
    if getattr(effect, "tau", None) == "fit":
        cost += 1.0
    if effect.kind == "thermal_offset" and len(effect.signals_needed()) > 1:
        cost += 3.0  # against another body's warmth: rarer than one body that warms
    if effect.kind == "thermal_tilt":
        cost += 3.0  # one that no lever shows is an offset
    if effect.kind == "cross_angular" and not _carries(machine, effect):
        cost += 3.0
    if effect.kind == "overhang_sag" and getattr(effect, "direction", "") == "X":
        cost += 8.0  # X lies level (ISO 841, 5.3.1), and what bends under weight bends downwards
    signals = [machine.signals[s] for s in effect.signals_needed() if s in machine.signals]
    if signals:
        cost += _signal_cost(effect, signals)
    return cost


def _carries(machine: Machine, effect: Effect) -> bool:
    """Whether the axis that tilts carries the one on whose position the tilt depends.

    On the tool side an axis carries those nearer to the tool, on the workpiece side those nearer to
    the workpiece.
    """
    axis, by = getattr(effect, "axis", ""), getattr(effect, "by", "")
    workpiece, tool = machine.structure.workpiece_side, machine.structure.tool_side
    if axis in tool and by in tool:
        return tool.index(axis) < tool.index(by)
    if axis in workpiece and by in workpiece:
        return workpiece.index(axis) > workpiece.index(by)
    return False


_ROLES: dict[str, tuple[str, ...]] = {
    "scale_expansion": ("scale", "screw"),
    "screw_heating": ("screw", "speed"),
    "thermal_offset": ("spindle", "structure", "ambient", "coolant"),
    "thermal_tilt": ("structure", "ambient", "coolant", "spindle"),
    "thermal_bending": ("structure", "coolant", "spindle", "ambient"),
    "load_bending": ("load",),
    "feed_lag": ("speed",),
    "workpiece_expansion": ("workpiece", "ambient", "coolant"),
    "dead_path": ("air", "ambient"),
    "air_refraction": ("air", "ambient"),
}


def _role_cost(role: str, wanted: tuple[str, ...]) -> float:
    """A role further down the list is a little less likely, one off the list much less."""
    if role in wanted:
        return float(wanted.index(role))
    return _OF_THE_SCALE if role == "scale" else len(wanted) + 2.0


_OF_THE_SCALE = 10.0
"""Cost of a scale's own thermometer for anything but the scale's expansion: it follows the air as
many bodies do and stands for one of them at best."""


def _signal_cost(effect: Effect, signals: list[Signal]) -> float:
    wanted = _ROLES.get(effect.kind)
    cost = 0.0
    if wanted is not None:
        cost += float(np.mean([_role_cost(s.role, wanted) for s in signals]))
    axis = getattr(effect, "axis", None)
    if effect.kind in ("scale_expansion", "screw_heating") and any(
        s.axis not in (None, axis) for s in signals
    ):
        cost += 6.0
    if len(signals) == 2 and effect.kind != "scale_expansion":
        # a difference of two sensors bends or tilts where both sit on the same body
        alike = signals[0].role == signals[1].role and signals[0].axis == signals[1].axis
        cost += 0.0 if alike else 5.0
    return cost
