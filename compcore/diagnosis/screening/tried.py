"""How many causes were tried: what the chance of finding one by luck is corrected for.

Hundreds of rare causes, each as unlikely as the next, share one chance of a false alarm
(Bonferroni). That every axis errs in its six ways, that axes are not quite square, scales not quite
right, is expected of every machine: where a model lacks such a motion altogether it is looked for
first, among its like, and not as one of hundreds of guesses. So a catalogue that grows by rare
causes hides no plain one (gatekeeping: families of hypotheses in an order laid down beforehand;
Westfall and Krishen, Journal of Statistical Planning and Inference 99 (2001), 25-40).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from abbe.compcore.diagnosis.screening.candidates import Candidate


@dataclass(frozen=True, slots=True)
class Tried:
    """How many causes were tried, each in whatever detail.

    Attributes
    ----------
    expected
        Those that every machine has (`Candidate.expected`).
    further
        All others.
    """

    expected: int
    further: int

    @classmethod
    def among(cls, candidates: Sequence[Candidate]) -> Tried:
        """Count the causes among candidates."""
        expected = {c.cause for c in candidates if c.expected}
        return cls(len(expected), len({c.cause for c in candidates} - expected))

    def beside(self, candidates: Sequence[Candidate]) -> list[float]:
        """The tests that each candidate is one of.

        Details of one cause are as alike as neighbouring choices of a non-linear parameter, and
        count like those: by their root.
        """
        details = Counter(c.cause for c in candidates)
        return [
            (self.expected if c.expected else self.further) * math.sqrt(details[c.cause])
            for c in candidates
        ]
