"""A model with the knots that the evidence is for, from a fit on the raster."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.knots.choice import KnotChoice, choice_of
from abbe.compcore.fitting.knots.evidence import KnotEvidence, KnotSet
from abbe.compcore.fitting.knots.search import best_set
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]

_FEWEST = 6
"""Knots at equal distances, at least, of the wider fit that says how sure the curves are."""


def with_knots(
    model: Model, problem: Problem, theta: F64, chi2: float, dof: int
) -> tuple[Model, Model, tuple[KnotChoice, ...]]:
    """The model with the knots that the evidence is for; a wider one; how sure the choice is.

    Parameters
    ----------
    model
        With effects of shape ``spline:auto``.
    problem, theta
        The fit of `on_raster` of it.
    chi2, dof
        What that leaves, and its degrees of freedom.

    Returns
    -------
    found, wide
        The model with its knots, and with as many as its richest curve for every curve, at equal
        distances, from which `widened` takes the covariance; neither is fitted.
    choices
        What each effect got.
    """
    evidence = KnotEvidence.of(model, problem, theta, chi2, dof)
    chosen = best_set(evidence)
    found = _model(evidence, model, chosen)
    choices = (
        choice_of(evidence, e, chosen, found.effects[c.term]) for e, c in enumerate(evidence.curves)
    )
    return found, _evenly(evidence, model, max(_FEWEST, *map(len, chosen))), tuple(choices)


def _model(evidence: KnotEvidence, model: Model, chosen: KnotSet) -> Model:
    """A model with the knots of a set."""
    terms = list(model.terms)
    for curve, own in zip(evidence.curves, chosen, strict=True):
        knots = tuple(float(curve.places[j]) for j in own)
        terms[curve.term] = curve.with_knots(model.terms[curve.term], knots)
    return replace(model, terms=tuple(terms), covariance=None)


def _evenly(evidence: KnotEvidence, model: Model, count: int) -> Model:
    """A model with so many knots for each curve at equal distances, or about so."""
    chosen = []
    for curve in evidence.curves:
        places = np.arange(1, count + 1) * (len(curve.places) + 1) / (count + 1)
        chosen.append(tuple(int(j) - 1 for j in np.unique(np.rint(places))))
    return _model(evidence, model, tuple(chosen))
