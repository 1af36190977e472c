"""How a calibration asks a person yes or no, and what counts where nobody is there."""

from __future__ import annotations

from typing import Protocol


class AskPerson(Protocol):
    """Asks a person yes or no; where nobody is there the answer is `default`."""

    def __call__(self, question: str, *, default: bool = True) -> bool:
        """Whether the answer is yes."""
        ...
