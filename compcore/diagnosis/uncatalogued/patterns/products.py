"""Products of recorded quantities, and smooth functions of one or two of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial, reduce
from itertools import combinations, combinations_with_replacement

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from abbe.compcore.diagnosis.uncatalogued.patterns.pattern import CandidatePattern, Rows
from abbe.compcore.diagnosis.uncatalogued.patterns.variables import PatternVariable, term_of
from abbe.compcore.effects.base import ErrorMotion
from abbe.compcore.sentences import listed, said

F64 = NDArray[np.float64]

SURFACE_DEGREE = 4
_DEGREES: Mapping[str, tuple[int, ...]] = {
    "signal": (2, 8),
    "difference": (2,),
    "time": (8, 20),
}
"""Of smooth functions of one quantity; a restless drift takes many."""


def products(
    quantities: Sequence[PatternVariable], on: ErrorMotion, order: int = 3
) -> Iterator[CandidatePattern]:
    """Products of up to `order` recorded quantities, each pair or triple of different families.

    A position may be squared, a signal or the time only where it stands alone; two signals make a
    product of their own, each counted from anywhere.
    """
    for count in range(1, order + 1):
        for chosen in combinations_with_replacement(quantities, count):
            names = [v.name for v in chosen]
            squared = {v.name for v in chosen if names.count(v.name) > 1}
            families = Counter(v.family for v in chosen)
            alone = count == 2 and (bool(squared) or families["signal"] == 2)
            if any(v.name in squared and v.family == "direction" for v in chosen):
                continue
            slow = families["signal"] + families["difference"] + families["time"]
            if (slow > 1 and not alone) or (count == 1 and families["difference"]):
                continue
            parts = [chosen]
            if families["signal"] == 2 and not squared:
                parts += [chosen[:1], chosen[1:]]
            values = partial(_products, parts)
            terms = tuple(term_of(part) for part in parts)
            depends = tuple(dict.fromkeys(n for v in chosen for n in v.recorded))
            form = _product_form(tuple(dict.fromkeys(names)), squared)
            yield CandidatePattern(depends, form, on, len(parts), values, terms, tuple(names))


def surfaces(
    quantities: Sequence[PatternVariable], on: ErrorMotion, degree: int = SURFACE_DEGREE
) -> Iterator[CandidatePattern]:
    """Smooth functions of one quantity, and of each pair with a position in it.

    A function of one position alone is an error motion of that axis: the catalogue has it, as such
    or as more detail of what the model has.
    """
    for v in quantities:
        for most in _DEGREES.get(v.family, ()):
            values = partial(_smooth, v, most)
            form = said("smooth function of {what}", what=v.name)
            yield CandidatePattern(v.recorded, form, on, most, values, made_of=(v.name,))
    smooth = [v for v in quantities if v.family not in ("direction", "difference")]
    for a, b in combinations(smooth, 2):
        if a.family != "position":
            continue
        values = partial(_surface, a, b, degree)
        form = said("smooth function of {one} and {other}", one=a.name, other=b.name)
        yield CandidatePattern((a.name, b.name), form, on, degree**2, values)
    for a in (q for q in quantities if q.family == "position"):
        for b in (q for q in quantities if q.family in ("signal", "difference")):
            values = partial(_times_smooth, b, a, degree)
            form = said(
                "proportional to {one}, by a smooth function of {other}", one=b.name, other=a.name
            )
            depends, made_of = (a.name, *b.recorded), (a.name, b.name)
            yield CandidatePattern(
                depends, form, on, degree + 1, values, made_of=made_of, once=(b.name,)
            )
    for v in (q for q in quantities if q.family == "direction"):
        for w in (q for q in smooth if q.family in ("position", "signal")):
            values = partial(_times_smooth, v, w, degree)
            form = said(
                "smooth function of {what}, of opposite sign in the two directions", what=w.name
            )
            yield CandidatePattern((w.name, v.name), form, on, degree + 1, values, once=(v.name,))


def with_product(pattern: CandidatePattern, factors: Sequence[PatternVariable]) -> CandidatePattern:
    """A pattern with one more column, a product of quantities."""

    def values(rows: Rows) -> F64:
        return np.hstack([pattern.values(rows), _products([factors], rows)])

    terms = (*pattern.terms, term_of(factors))
    return replace(pattern, width=pattern.width + 1, values=values, terms=terms)


def _products(parts: Sequence[Sequence[PatternVariable]], rows: Rows) -> F64:
    columns = [reduce(np.multiply, (v.value[rows] for v in part)) for part in parts]
    return columns[0][:, None] if len(columns) == 1 else np.stack(columns, axis=1)


def _smooth(v: PatternVariable, degree: int, rows: Rows) -> F64:
    return _f64(chebyshev.chebvander(v.value[rows], degree)[:, 1:])


def _surface(a: PatternVariable, b: PatternVariable, degree: int, rows: Rows) -> F64:
    one = chebyshev.chebvander(a.value[rows], degree)[:, 1:, None]
    two = chebyshev.chebvander(b.value[rows], degree)[:, None, 1:]
    return _f64(one * two).reshape(len(one), -1)


def _times_smooth(v: PatternVariable, w: PatternVariable, degree: int, rows: Rows) -> F64:
    return _f64(chebyshev.chebvander(w.value[rows], degree) * v.value[rows, None])


def _f64(values: ArrayLike) -> F64:
    return np.asarray(values, dtype=np.float64)


def _product_form(names: Sequence[str], squared: set[str]) -> str:
    parts = [f"{n}²" if n in squared else n for n in names]
    if len(parts) == 1:
        return said("proportional to {what}", what=parts[0])
    return said("product of {what}", what=listed(parts))
