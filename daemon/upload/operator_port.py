"""The port through which an upload speaks with its operator."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class OperatorPort:
    """The port to the operator: messages, progress, questions.

    Attributes
    ----------
    tell
        A line for people.
    progress
        Part of a transfer that is done, 0 to 1.
    ask
        Whether to go on; is given what would change.
    restarted
        Asks for a restart of the controller; True once it was done, False when nobody is there.
    """

    tell: Callable[[str], None]
    progress: Callable[[float], None]
    ask: Callable[[list[str]], bool]
    restarted: Callable[[], Awaitable[bool]]
