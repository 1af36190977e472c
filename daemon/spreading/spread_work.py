"""Work that can be spread: one function, asked many times, with the contents of files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from time import process_time

from abbe.compcore.errors import AbbeError
from abbe.compcore.linalg import threads_for
from abbe.daemon.spreading.fingerprint import differing, fingerprint

_ROOMS = ("abbe.", "benchmarks.", "tests.support.")
"""Where functions may stand that a worker is asked for by name."""


@dataclass(frozen=True)
class SpreadTask:
    """One question.

    Attributes
    ----------
    function
        ``module:name`` of what answers: a function of (contents, argument) that gives bytes and
        depends on nothing else.
    argument
        What is asked, as text.
    contents
        Name → content of the files that it reads.
    title
        For people: of which block, of which machine.
    """

    function: str
    argument: str
    contents: Mapping[str, bytes] = field(default_factory=dict)
    title: str = ""

    @cached_property
    def hashes(self) -> dict[str, str]:
        """Name → SHA-256 of its content."""
        return {name: hashlib.sha256(body).hexdigest() for name, body in self.contents.items()}

    @cached_property
    def identity(self) -> str:
        """The same for the same question of the same Abbe, and for no other."""
        whole = [self.function, self.argument, self.hashes, fingerprint()]
        return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class TaskPayload:
    """A task on its way to a worker, with what it must find there."""

    function: str
    argument: str
    contents: dict[str, bytes]
    hashes: dict[str, str]
    versions: dict[str, str]

    @classmethod
    def of(cls, task: SpreadTask) -> TaskPayload:
        """Pack a task."""
        return cls(
            task.function, task.argument, dict(task.contents), task.hashes, dict(fingerprint())
        )


@dataclass(frozen=True)
class TaskAnswer:
    """What a worker gives back.

    Attributes
    ----------
    body
        The answer; its SHA-256 is `digest`.
    problem
        Why there is none, in one sentence; empty: there is one.
    seconds
        Processor seconds that it took.
    """

    body: bytes = b""
    digest: str = ""
    problem: str = ""
    seconds: float = 0.0


def perform(payload: TaskPayload) -> TaskAnswer:
    """Answer a question; runs in a worker's process, with one thread of the linear algebra."""
    differs = differing(payload.versions, fingerprint())
    if differs:
        return TaskAnswer(problem=f"a worker has other versions: {differs}")
    for name, body in payload.contents.items():
        if hashlib.sha256(body).hexdigest() != payload.hashes.get(name):
            return TaskAnswer(problem=f"{name} did not arrive as it was sent")
    start = process_time()
    try:
        with threads_for(0):
            body = _function(payload.function)(payload.contents, payload.argument)
    except AbbeError as error:
        return TaskAnswer(problem=str(error), seconds=process_time() - start)
    return TaskAnswer(body, hashlib.sha256(body).hexdigest(), "", process_time() - start)


def _function(name: str) -> Callable[[Mapping[str, bytes], str], bytes]:
    if not name.startswith(_ROOMS):
        raise AbbeError(f"not a function of Abbe: {name}")
    module, _, function = name.partition(":")
    found: Callable[[Mapping[str, bytes], str], bytes] = getattr(import_module(module), function)
    return found
