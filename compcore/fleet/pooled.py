"""Parameters of machines of one type: their mean, how they scatter, and each machine's own.

Random-effects meta-analysis. Machine i's vector of parameters is known as yᵢ with covariance Sᵢ
(its model's own); machines scatter about a mean μ with variances τ². τ² of each parameter by
restricted maximum likelihood (Fisher scoring; W. Viechtbauer, J. Educ. Behav. Stat. 30 (2005)
261), begun at R. DerSimonian and N. Laird's (Control. Clin. Trials 7 (1986) 177). Then, with the
whole covariances and Wᵢ = (Sᵢ + T)⁻¹: μ̂ = (ΣWᵢ)⁻¹ΣWᵢyᵢ by generalized least squares, and each
machine's own, partially pooled: yᵢ − Sᵢ·Wᵢ·(yᵢ − μ̂). The machine that comes next is expected at μ̂
with T + cov(μ̂).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.base import Effect, Parameter
from abbe.compcore.errors import InputError
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]

FEWEST = 2
"""Machines whose parameters can be compared."""
_ROUNDS = 200
_CONVERGED = 1e-10


@dataclass(frozen=True, slots=True)
class SpreadEstimate:
    """How a parameter scatters over machines.

    Attributes
    ----------
    tau2
        Variance of the machines' true values.
    q
        Cochran's Q: the weighted sum of squares about the mean of a plant whose machines do not
        differ; χ² of `dof` where they do not.
    dof
        Machines − 1.
    """

    tau2: float
    q: float
    dof: int


def spread(values: F64, variances: F64) -> SpreadEstimate:
    """The variance between machines, by restricted maximum likelihood.

    Parameters
    ----------
    values, variances
        Of one parameter, one a machine, (m,); variances above 0.
    """
    fixed = 1.0 / variances
    mean = float(fixed @ values) / float(fixed.sum())
    q = float(fixed @ (values - mean) ** 2)
    dof = len(values) - 1
    scaled = float(fixed.sum() - (fixed @ fixed) / fixed.sum())
    tau2 = max(0.0, (q - dof) / scaled)
    for _ in range(_ROUNDS):
        w = 1.0 / (variances + tau2)
        total = float(w.sum())
        mean = float(w @ values) / total
        squares = w * w
        step = (
            float(squares @ ((values - mean) ** 2 - variances)) / float(squares.sum()) + 1.0 / total
        )
        new = max(0.0, step)
        if abs(new - tau2) <= _CONVERGED * (tau2 + float(variances.min())):
            return SpreadEstimate(new, q, dof)
        tau2 = new
    return SpreadEstimate(tau2, q, dof)


@dataclass(frozen=True, eq=False)
class PooledParameter:
    """One parameter over the machines of a type.

    Attributes
    ----------
    effect, parameter
        Which one.
    mean, mean_sd
        Over machines, and how well that is known, unit inside the code.
    spread
        Standard deviation of machines about it (τ).
    q, dof
        As `SpreadEstimate` has them.
    values, sds
        Each machine's own, as its model has it, (m,).
    pooled, pooled_sds
        Each machine's own, with what the others say of it, (m,).
    """

    effect: Effect
    parameter: Parameter
    mean: float
    mean_sd: float
    spread: float
    q: float
    dof: int
    values: F64
    sds: F64
    pooled: F64
    pooled_sds: F64

    @property
    def next_sd(self) -> float:
        """How well the next machine's is known before it is measured."""
        return math.hypot(self.spread, self.mean_sd)

    @property
    def unlike(self) -> F64:
        """How far each machine is from what the others lead one to expect, in its sd, (m,)."""
        return np.asarray((self.values - self.mean) / np.hypot(self.sds, self.next_sd))


@dataclass(frozen=True, eq=False)
class PooledType:
    """All parameters that machines of a type have in common.

    Attributes
    ----------
    names
        Of the machines, (m,).
    parameters
        In the order of the first model's effects.
    mean, covariance
        Of the machine that comes next: (p,) and (p, p).
    left_out
        Specs of effects that not all machines' models have, or have no sd of.
    """

    names: tuple[str, ...]
    parameters: tuple[PooledParameter, ...]
    mean: F64
    covariance: F64
    left_out: tuple[str, ...]


def pooled(models: Sequence[Model], names: Sequence[str]) -> PooledType:
    """Compare the parameters that fitted models of machines of one type have in common.

    Parameters
    ----------
    models, names
        One a machine.

    Raises
    ------
    InputError
        For fewer than two machines, machines of different structure, and models that have no
        fitted effect in common.
    """
    if len(models) < FEWEST:
        raise InputError(
            "machines are compared with each other", found=len(models), expected="two or more"
        )
    first = models[0].machine.structure
    for model, name in zip(models, names, strict=True):
        if str(model.machine.structure) != str(first):
            raise InputError(
                f"{name} is a machine of another structure",
                found=str(model.machine.structure),
                expected=str(first),
            )
    columns = [_columns(model) for model in models]
    everywhere = set(columns[0]).intersection(*columns[1:])
    wanted = [key for key in columns[0] if key in everywhere]
    every = {key[0]: None for found in columns for key in found} | {
        term.effect.spec: None for model in models for term in model.terms
    }
    left_out = tuple(spec for spec in every if spec not in {key[0] for key in wanted})
    if not wanted:
        raise InputError(
            "the models have no fitted effect in common",
            expected="models fitted with the same effects; what differs: " + ", ".join(left_out),
        )
    y = np.array([[found[key].value for key in wanted] for found in columns])
    s = np.array(
        [_covariance(m, [f[k] for k in wanted]) for m, f in zip(models, columns, strict=True)]
    )
    variances = np.array([np.diag(one) for one in s])
    spreads = [spread(y[:, j], variances[:, j]) for j in range(len(wanted))]
    scale = np.sqrt(variances.max(axis=0))
    t = np.diag([e.tau2 for e in spreads])
    mean, mean_cov = _mean(y, s, t, scale)
    own, own_cov = _partially_pooled(y, s, t, mean, mean_cov, scale)
    parameters = tuple(
        PooledParameter(
            columns[0][key].effect, columns[0][key].parameter, float(mean[j]),
            math.sqrt(mean_cov[j, j]), math.sqrt(spreads[j].tau2), spreads[j].q, spreads[j].dof,
            y[:, j], np.sqrt(variances[:, j]), own[:, j], np.sqrt(own_cov[:, j]),
        )
        for j, key in enumerate(wanted)
    )  # fmt: skip
    return PooledType(tuple(names), parameters, mean, t + mean_cov, left_out)


@dataclass(frozen=True, eq=False)
class _FittedColumn:
    """A fitted linear parameter of a model."""

    effect: Effect
    parameter: Parameter
    value: float
    sd: float
    row: int


_Key = tuple[str, str]


def _columns(model: Model) -> dict[_Key, _FittedColumn]:
    """Spec and name → each linear parameter that was fitted, with its row in the covariance."""
    found: dict[_Key, _FittedColumn] = {}
    row = 0
    for term in model.terms:
        linear = term.effect.linear(model.machine)
        if not term.fitted or not term.values:
            continue
        for parameter in linear:
            value = term.values[parameter.name]
            if value.sd is not None and value.sd > 0.0 and value.measured:
                key = (term.effect.spec, parameter.name)
                found[key] = _FittedColumn(term.effect, parameter, value.value, value.sd, row)
            row += 1
        row += len(term.effect.nonlinear(model.machine))
    return found


def _covariance(model: Model, columns: Sequence[_FittedColumn]) -> F64:
    """The covariance of some parameters; of a model without one, by their sds alone."""
    rows = [c.row for c in columns]
    sds = np.array([c.sd for c in columns])
    whole = model.covariance
    if whole is None or max(rows) >= len(whole):
        return np.diag(sds**2)
    part = np.asarray(whole[np.ix_(rows, rows)], dtype=float)
    # a parameter's sd is what its file says; the covariance says how they hang together
    own = np.sqrt(np.maximum(np.diag(part), np.finfo(float).tiny))
    return np.asarray(part / np.outer(own, own) * np.outer(sds, sds))


def _mean(y: F64, s: F64, t: F64, scale: F64) -> tuple[F64, F64]:
    """μ̂ and its covariance; in units of `scale`, so that µm and ppm/K stand beside each other."""
    p = y.shape[1]
    information, vector = np.zeros((p, p)), np.zeros(p)
    for values, own in zip(y, s, strict=True):
        w = np.linalg.pinv((own + t) / np.outer(scale, scale), hermitian=True)
        information += w
        vector += w @ (values / scale)
    covariance = np.linalg.pinv(information, hermitian=True)
    return covariance @ vector * scale, covariance * np.outer(scale, scale)


def _partially_pooled(
    y: F64, s: F64, t: F64, mean: F64, mean_cov: F64, scale: F64
) -> tuple[F64, F64]:
    """Each machine's own parameters with what the others say of them, and their variances."""
    out, variances = np.empty_like(y), np.empty_like(y)
    for i, (values, own) in enumerate(zip(y, s, strict=True)):
        w = np.linalg.pinv((own + t) / np.outer(scale, scale), hermitian=True)
        w /= np.outer(scale, scale)
        shrink = own @ w
        out[i] = values - shrink @ (values - mean)
        # known T; the mean's own uncertainty enters through how much a machine leans on it
        left = own - shrink @ own + shrink @ mean_cov @ shrink.T
        variances[i] = np.maximum(np.diag(left), 0.0)
    return out, variances
