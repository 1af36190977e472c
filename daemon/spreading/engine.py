"""What carries tasks out: some at a time, answers as they come, each exactly once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Protocol

from abbe.compcore.errors import AbbeError
from abbe.daemon.spreading.spread_work import SpreadTask, TaskAnswer, TaskPayload, perform

ATTEMPTS = 4
"""How often a task is tried whose worker dies."""

Numbered = tuple[int, SpreadTask]


class WorkLostError(AbbeError):
    """Work ended early and can be gone on with: what carried it out is gone."""


class Engine(Protocol):
    """A way of carrying tasks out."""

    def carry_out(self, tasks: Iterable[Numbered]) -> Iterator[tuple[int, TaskAnswer]]:
        """Carry numbered tasks out; their answers in the order in which they come.

        Raises
        ------
        WorkLostError
            When nothing is left that could go on.
        """


class InThisProcess:
    """One task after the other, here."""

    def carry_out(self, tasks: Iterable[Numbered]) -> Iterator[tuple[int, TaskAnswer]]:
        """See `Engine`."""
        for number, task in tasks:
            yield number, perform(TaskPayload.of(task))
