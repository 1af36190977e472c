"""The covariance of splines with found knots, from a wider fit whose knots were not picked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from abbe.compcore.fitting.knots.raster import GRID, auto_shape, finds_knots
from abbe.compcore.model.model import Model, Value


def widened(model: Model, wide: Model) -> Model:
    """A fitted model with the covariance of a wider one, whose knots were not picked by the data.

    The fewer knots, the surer they look; but they were picked because they fit. How uncertain a
    curve is says a fit with as many knots at equal distances as the richest of the curves needs.

    Parameters
    ----------
    model
        As fitted, with the knots that were chosen.
    wide
        The same model fitted with the others.
    """
    if model.covariance is None or wide.covariance is None:
        return model
    blocks, at = [], 0
    for term, other in zip(model.terms, wide.terms, strict=True):
        own = slice(at, at + len(other.values))
        at = own.stop
        if not finds_knots(term.effect):
            blocks.append(np.eye(len(term.values)))
            continue
        axis = model.machine.axis(str(getattr(term.effect, "axis", "")))
        q = np.linspace(*axis.travel, GRID)
        few, many = (auto_shape(e, axis).basis(q, axis) for e in (term.effect, other.effect))
        nearest = np.asarray(np.linalg.lstsq(few, many, rcond=None)[0])
        # fewer knots cannot show all of it: the curve's mean variance is kept
        wanted, shown = (
            float(np.einsum("gi,ij,gj->", b, wide.covariance[own, own], b))
            for b in (many, few @ nearest)
        )
        blocks.append(nearest * max(1.0, np.sqrt(wanted / shown)) if shown > 0.0 else nearest)
    rows = np.concatenate([[0], np.cumsum([len(b) for b in blocks])])
    columns = np.concatenate([[0], np.cumsum([b.shape[1] for b in blocks])])
    onto = np.zeros((int(rows[-1]), int(columns[-1])))
    for i, block in enumerate(blocks):
        onto[rows[i] : rows[i + 1], columns[i] : columns[i + 1]] = block
    covariance = onto @ wide.covariance @ onto.T
    covariance = 0.5 * (covariance + covariance.T)
    sd = iter(np.sqrt(np.diag(covariance)))
    values = [{n: Value(v.value, float(next(sd))) for n, v in t.values.items()}
              for t in model.terms]  # fmt: skip
    return replace(model.with_values(values), covariance=covariance)
