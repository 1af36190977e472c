"""A cause that some machines have and others have not: how likely, from weak evidence of each.

Machine i tells of a cause's parameters a the information Λᵢ and Λᵢâᵢ = ηᵢ: its campaigns are
``exp(ηᵢᵀa − ½aᵀΛᵢa)`` times as likely as without it. Those that have it have it about alike,
a ~ N(μ, T). Integrated over a (closed form, both Gaussian) that is Bᵢ, and with π the part of the
machines that have it all of them are ``∏(1 − π + π·Bᵢ)`` times as likely as if none had it: a
mixture, whose π, μ and T are found by expectation–maximisation (A. Dempster, N. Laird, D. Rubin, J.
R. Stat. Soc. B 39 (1977) 1). A machine has it by ``πBᵢ/(1 − π + πBᵢ)``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

_ROUNDS = 100
_CONVERGED = 1e-3
"""Rise of ln(likelihood) at which the climb ends."""
_LEAST_PART = 1e-3


@dataclass(frozen=True, eq=False)
class ToldOfCause:
    """What a machine tells of a cause's parameters.

    Attributes
    ----------
    information
        Λ, (k, k).
    weighted
        Λâ, (k,).
    price
        What finding its non-linear parameters costs where the machine has it, in −2·ln.
    """

    information: F64
    weighted: F64
    price: float = 0.0

    @cached_property
    def drop(self) -> float:
        """How far χ² would fall: no prior can make the machine speak more for the cause."""
        found = np.linalg.lstsq(self.information, self.weighted, rcond=1e-10)[0]
        return float(self.weighted @ found)


@dataclass(frozen=True, eq=False)
class Mixture:
    """Which machines have a cause.

    Attributes
    ----------
    gain
        2·ln of how many times as likely all machines are with it.
    part
        π: the part of the machines that have it.
    mean, variances
        μ and the diagonal of T, (k,).
    chances
        Of each machine that it has it, (m,).
    gains
        2·ln(1 − π + π·Bᵢ) of each machine, (m,).
    """

    gain: float
    part: float
    mean: F64
    variances: F64
    chances: F64
    gains: F64


def mixture(told: Sequence[ToldOfCause]) -> Mixture:
    """The likeliest mixture.

    Parameters
    ----------
    told
        One a machine, of the same k parameters.
    """
    scale = _scale(told)
    information = np.array([t.information * np.outer(scale, scale) for t in told])
    weighted = np.array([t.weighted * scale for t in told])
    price = np.array([t.price for t in told])
    order = np.argsort([-t.drop for t in told])
    own = np.array([np.linalg.pinv(i) @ w for i, w in zip(information, weighted, strict=True)])
    m = len(told)
    best: Mixture | None = None
    for count in sorted({2, max(2, m // 3), m}):
        chosen = own[order[:count]]
        start = chosen.mean(axis=0), chosen.var(axis=0) + 0.1
        found = _climbed(information, weighted, price, count / m, *start)
        if best is None or found.gain > best.gain:
            best = found
    assert best is not None  # noqa: S101  (there is at least one machine)
    return replace(best, mean=best.mean * scale, variances=best.variances * scale**2)


def _scale(told: Sequence[ToldOfCause]) -> F64:
    """What a machine knows of each parameter, typically: their unit here."""
    known = np.array([np.diag(t.information) for t in told])
    typical = np.median(known, axis=0)
    return np.asarray(1.0 / np.sqrt(np.where(typical > 0.0, typical, known.max(axis=0) + 1e-300)))


def _climbed(
    information: F64, weighted: F64, price: F64, part: float, mean: F64, variances: F64
) -> Mixture:
    gain = -math.inf
    identity = np.eye(len(mean))
    for _ in range(_ROUNDS):
        turned = np.linalg.inv(identity + variances[:, None] * information)
        known = variances * weighted
        posterior = np.einsum("mij,mj->mi", turned, known + mean)
        # ½ηᵀ(I + TΛ)⁻¹Tη + ηᵀ(I + TΛ)⁻¹μ − ½μᵀΛ(I + TΛ)⁻¹μ + ½ ln|(I + TΛ)⁻¹|
        logs = (
            0.5 * np.einsum("mi,mij,mj->m", weighted, turned, known)
            + np.einsum("mi,mij,j->m", weighted, turned, mean)
            - 0.5 * np.einsum("i,mij,mjk,k->m", mean, information, turned, mean)
            + 0.5 * np.linalg.slogdet(turned)[1]
            - 0.5 * price
        )
        with_it = logs + math.log(part)
        each = np.logaddexp(with_it, math.log1p(-min(part, 1.0 - 1e-12)))
        chances = np.exp(with_it - each)
        now = float(each.sum())
        found = Mixture(2.0 * now, part, mean, variances, chances, 2.0 * each)
        total = float(chances.sum())
        if now - gain < _CONVERGED or total < _LEAST_PART:
            break
        gain = now
        mean = np.asarray(chances @ posterior / total)
        widths = np.einsum("mii->mi", turned * variances)
        variances = np.asarray(chances @ ((posterior - mean) ** 2 + widths) / total)
        part = min(max(total / len(price), _LEAST_PART), 1.0)
    return found
