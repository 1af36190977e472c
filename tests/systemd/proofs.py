"""The proofs in their order: each stands on what those before it left behind."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from tests.support.systemd.stage import Stage
from tests.systemd import disk, life, package, unit

Proof = Callable[[Stage], str]

ALL: Sequence[Proof] = (
    package.installed,
    package.configured,
    life.ready,
    life.asked,
    life.confined,
    unit.denied_memory,
    unit.ended_alone,
    life.reload,
    life.frozen,
    life.killed,
    life.stopped,
    disk.slow_disk,
    disk.full_and_read_only,
    disk.damaged,
    life.two,
    life.rebooted,
    life.told,
    package.upgraded,
    package.rolled_back,
    package.backed_up,
    package.one_removed,
    package.removed,
    package.installed_again,
    package.purged,
    package.page_carried_out,
)
SHORT: Sequence[Proof] = (
    package.installed,
    package.configured,
    life.ready,
    life.confined,
    life.killed,
    life.stopped,
    package.removed,
)
LONG: Sequence[Proof] = (
    disk.slow_disk,
    disk.full_and_read_only,
    disk.damaged,
    package.upgraded,
    package.rolled_back,
    package.backed_up,
    package.one_removed,
    package.installed_again,
    package.purged,
    package.page_carried_out,
)
EVERY_TIME: Sequence[Proof] = tuple(proof for proof in ALL if proof not in LONG)
"""What ``make test`` has time for, in a container."""


@dataclass(frozen=True)
class Row:
    """A proof, and what was seen.

    Attributes
    ----------
    claim
        What was to be proved.
    held
        Whether it was.
    seen
        In words.
    took
        s.
    """

    claim: str
    held: bool
    seen: str
    took: float

    def words(self) -> str:
        """Two lines of the table."""
        head = f"{'proved' if self.held else 'FAILED'} {self.took:5.0f} s  {self.claim}"
        return head + "".join(f"\n{'':16}{line}" for line in self.seen.splitlines())


def prove(stage: Stage, proofs: Sequence[Proof]) -> Iterator[Row]:
    """Carry out proofs, also after one that failed."""
    for proof in proofs:
        began = time.monotonic()
        try:
            held, seen = True, proof(stage)
        except Exception:  # noqa: BLE001 - whatever it is, it is no proof
            held, seen = False, traceback.format_exc(limit=-2)
        claim = " ".join((proof.__doc__ or proof.__name__).split())
        yield Row(claim, held, seen, time.monotonic() - began)
