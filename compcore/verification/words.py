"""What takes weight from a verification, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from abbe.compcore.verification.fitted import FittedPart
from abbe.compcore.verification.verify import Verification

_NAMED = 6


def listed(names: Sequence[str]) -> str:
    """Some names, and how many more there are.

    >>> listed(["a", "b"]), listed(list("abcdefgh"))
    ('a, b', 'a, b, c, d, e, f and 2 more')
    """
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def verification_warnings(found: Verification) -> Iterator[str]:
    """What takes weight from a verification, in sentences."""
    rows = [v.after.setup for v in found.lines if v.fitted is FittedPart.ROWS]
    rows += [p.setup for p in found.placed if p.fitted is FittedPart.ROWS]
    points = [v.after.setup for v in found.lines if v.fitted is FittedPart.POINTS]
    if rows:
        yield (
            f"NO VERIFICATION: the model was fitted to the readings of {listed(rows)}; what is "
            "left there says how close the fit is, and proves nothing"
        )
    if points:
        yield (
            f"fitted lines: the model was fitted to the same targets of {listed(points)}; "
            "ISO/TR 16907, 11.3, asks for other lines and other points"
        )
    if found.fitted_before:
        yield (
            f"the model was fitted to what was measured before ({listed(found.fitted_before)}): "
            "what it says of these lines is no foretelling"
        )
    if found.missing:
        yield f"not measured of the check plan in one go: {listed(found.missing)}"
    other = [
        v.after.setup for v in found.lines if v.foretold is not None and v.foretold.agrees is False
    ]
    other += [p.setup for p in found.placed if p.agrees is False]
    if other:
        yield (
            f"the model does not foretell {listed(other)} within both uncertainties: "
            "abbe diagnose says what is missing or has changed"
        )
    if not found.measured:
        yield (
            "the state after is computed, measured less foretold: that the machine's controller "
            "does the same is proven by measuring with the compensation active"
        )
    axes = found.comparison.problem.model.machine.structure.axes
    unseen = [a for a in axes if not any(a in v.after.name for v in found.lines)]
    if found.placed and not found.lines:
        yield (
            "no line was measured: what is judged is what these set-ups show, not the axes over "
            "their travels"
        )
    if unseen and found.lines:
        yield f"no line moves {listed(unseen)}"
    cold = [
        v.after.setup for v in found.lines if not v.after.rotary and v.after.temperature is None
    ]
    if cold:
        yield (
            f"no thermometer tells how warm {listed(cold)} was: its lengths are taken to be "
            "at 20 °C, and expansion counts with the thermometer's uncertainty alone"
        )
