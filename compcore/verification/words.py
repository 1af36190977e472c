"""What takes weight from a verification, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from abbe.compcore.sentences import said
from abbe.compcore.verification.fitted import FittedPart
from abbe.compcore.verification.verify import Verification

_NAMED = 6


def listed(names: Sequence[str]) -> str:
    """Some names, and how many more there are.

    >>> listed(["a", "b"]), listed(list("abcdefgh"))
    ('a, b', 'a, b, c, d, e, f and 2 more')
    """
    more = len(names) - _NAMED
    these = ", ".join(names[:_NAMED])
    return said("{these} and {n} more", these=these, n=more) if more > 0 else these


def verification_warnings(found: Verification) -> Iterator[str]:
    """What takes weight from a verification, in sentences."""
    rows = [v.after.setup for v in found.lines if v.fitted is FittedPart.ROWS]
    rows += [p.setup for p in found.placed if p.fitted is FittedPart.ROWS]
    points = [v.after.setup for v in found.lines if v.fitted is FittedPart.POINTS]
    if rows:
        yield said(
            "NO VERIFICATION: the model was fitted to the readings of {setups}; what is left there "
            "says how close the fit is, and proves nothing",
            setups=listed(rows),
        )
    if points:
        yield said(
            "fitted lines: the model was fitted to the same targets of {setups}; ISO/TR 16907, "
            "11.3, asks for other lines and other points",
            setups=listed(points),
        )
    if found.fitted_before:
        yield said(
            "the model was fitted to what was measured before ({setups}): what it says of these "
            "lines is no foretelling",
            setups=listed(found.fitted_before),
        )
    if found.missing:
        yield said(
            "not measured of the check plan in one go: {setups}", setups=listed(found.missing)
        )
    other = [
        v.after.setup for v in found.lines if v.foretold is not None and v.foretold.agrees is False
    ]
    other += [p.setup for p in found.placed if p.agrees is False]
    if other:
        yield said(
            "the model does not foretell {setups} within both uncertainties: abbe diagnose says "
            "what is missing or has changed",
            setups=listed(other),
        )
    if not found.measured:
        yield said(
            "the state after is computed, measured less foretold: that the machine's controller "
            "does the same is proven by measuring with the compensation active"
        )
    axes = found.comparison.problem.model.machine.structure.axes
    unseen = [a for a in axes if not any(a in v.after.name for v in found.lines)]
    if found.placed and not found.lines:
        yield said(
            "no line was measured: what is judged is what these set-ups show, not the axes over "
            "their travels"
        )
    if unseen and found.lines:
        yield said("no line moves {axes}", axes=listed(unseen))
    cold = [
        v.after.setup for v in found.lines if not v.after.rotary and v.after.temperature is None
    ]
    if cold:
        yield said(
            "no thermometer tells how warm {setups} was: its lengths are taken to be at 20 °C, and "
            "expansion counts with the thermometer's uncertainty alone",
            setups=listed(cold),
        )
    if found.same_gauges:
        yield said(
            "the model was fitted to the same artefact: what its calibration is wrong by is in "
            "both, and shows here as little as there"
        )
