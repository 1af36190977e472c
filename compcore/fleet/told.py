"""What a diagnosis tells of every cause, strong or weak: so that machines can be laid together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.findings import Findings
from abbe.compcore.diagnosis.screening.pool import WeighedCandidate
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.effects.base import Effect, Parameter
from abbe.compcore.fleet.mixture import ToldOfCause

F64 = NDArray[np.float64]

_SEEN = 1e-3
"""Least part of a column outside the model's span for it to be seen (as `Basis` has it)."""
_MOST_COLUMNS = 4
"""Parameters of a cause that is looked for together; what has more is a curve, a machine's own."""


@dataclass(frozen=True)
class TriedEffect:
    """An effect that was tried.

    Attributes
    ----------
    effect
        It.
    cost
        What makes it less likely before any data are seen, in −2·ln.
    parameters
        Its linear parameters on this machine.
    """

    effect: Effect
    cost: float
    parameters: tuple[Parameter, ...]


@dataclass(frozen=True, eq=False)
class CampaignTold:
    """What one campaign of one machine tells of all causes.

    Attributes
    ----------
    name
        Of the machine.
    at
        When the campaign was measured; None: not known.
    told
        Spec of each cause that was tried → what the campaign tells of it, beside what is
        established there.
    effects
        Spec → the effect.
    named
        Specs of the causes that this campaign establishes alone.
    """

    name: str
    at: datetime | None
    told: Mapping[str, ToldOfCause]
    effects: Mapping[str, TriedEffect]
    named: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class DiagnosedMachine(CampaignTold):
    """The same, with the diagnosis that it comes from.

    Attributes
    ----------
    findings
        The diagnosis.
    """

    findings: Findings

    def without_findings(self) -> CampaignTold:
        """What is told alone: some numbers for each cause."""
        return CampaignTold(self.name, self.at, self.told, self.effects, self.named)

    def beside(self, specs: Sequence[str]) -> DiagnosedMachine:
        """The same after causes joined its model, by their specs; those it cannot see stay out."""
        return diagnosed(self.name, self.at, self.findings, joined=specs)


def diagnosed(
    name: str, at: datetime | None, findings: Findings, *, joined: Sequence[str] = ()
) -> DiagnosedMachine:
    """What a diagnosis tells of all causes.

    Parameters
    ----------
    name, at
        As `DiagnosedMachine` has them.
    findings
        A diagnosis of the machine's model and one campaign.
    joined
        Specs of causes that are taken into its model first.
    """
    pool, basis = findings.pool, findings.basis
    every = {_spec(f): f for f in findings.ranked}
    for f in (f for e in findings.established if (f := e.found)):
        every[_spec(f)] = f
    established = {_spec(e.found): e.found for e in findings.established}
    taken = established | {s: every[s] for s in joined if s in every}
    after = pool.joined(basis, taken.values())
    told: dict[str, ToldOfCause] = {}
    effects: dict[str, TriedEffect] = {}
    for spec, found in every.items():
        if spec in joined:
            continue
        own = after
        if spec in taken:
            own = pool.joined(basis, [f for s, f in taken.items() if s != spec])
        if one := _told(found, pool.found_columns(found), own):
            told[spec] = one
            effect, machine = found.candidate.effect, pool.machine
            effects[spec] = TriedEffect(effect, found.candidate.cost, effect.linear(machine))
    return DiagnosedMachine(name, at, told, effects, tuple(established), findings)


def _spec(found: WeighedCandidate) -> str:
    return found.candidate.effect.spec


def _told(found: WeighedCandidate, columns: F64, basis: Basis) -> ToldOfCause | None:
    if columns.shape[1] > _MOST_COLUMNS:
        return None
    left = basis.project(columns)
    norms = np.linalg.norm(columns, axis=0)
    if not norms.all() or (np.linalg.norm(left, axis=0) < _SEEN * norms).any():
        return None
    # neighbours in time whose residuals are alike say less than as many strangers
    weight = basis.share * basis.dof / basis.chi2 if basis.chi2 > 0.0 else 0.0
    price = found.candidate.nonlinear_count * math.log(basis.independent)
    return ToldOfCause(weight * left.T @ left, weight * left.T @ basis.residual, price)
