"""What a renewed model was before a later campaign, and what of it has changed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from abbe.compcore.effects.base import Effect
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import said


@dataclass(frozen=True)
class Renewal:
    """What a renewed model was, and what of it was let go.

    Attributes
    ----------
    before
        The model as it was.
    let_go
        Its effects of which nothing was taken over, as they have changed.
    variance
        What the variance of a row of the later campaign counted for.
    """

    before: Model
    let_go: tuple[Effect, ...]
    variance: float = 1.0

    def words(self) -> Iterator[str]:
        """Lines for people: what stays, and what was fitted anew."""
        yield said("renewed: what this campaign does not show stays as earlier ones showed it")
        if self.let_go:
            names = "; ".join(e.spec for e in self.let_go)
            yield said("fitted anew, as it has changed: {effects}", effects=names)
