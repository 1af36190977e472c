"""Lines of the simulated I++ DME server, read and written, and the faults they can have."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

_ARGUMENT = re.compile(r"\s*([A-Za-z][\w.]*)\(\s*([^()]*?)\s*\)\s*(?:,|$)")


class IppCommandError(Exception):
    """A command is answered by an error."""

    def __init__(self, severity: int, number: int, text: str) -> None:
        super().__init__(text)
        self.severity, self.number, self.text = severity, number, text


@dataclass
class IppFaults:
    """What is wrong with the server; counts go down by one for each command.

    Attributes
    ----------
    silent_until
        No answers before this time (monotonic, s).
    late, lateness
        So many commands are answered so much (s) later, the next ones meanwhile at once.
    split
        Whether every byte goes out in a packet of its own.
    untaken, incomplete, bare
        So many commands lack their ``&``, their ``%``, their data.
    garbage
        Text sent in front of each answer.
    errors
        Errors for the next commands: severity, number, text.
    mute_reports
        Whether move reports stay away.
    """

    silent_until: float = 0.0
    late: int = 0
    lateness: float = 0.0
    split: bool = False
    untaken: int = 0
    incomplete: int = 0
    bare: int = 0
    garbage: str = ""
    errors: list[tuple[int, int, str]] = field(default_factory=list)
    mute_reports: bool = False


def error_line(tag: str, severity: int, number: int, cause: str, text: str) -> str:
    """An error as it is sent."""
    return f'{tag} ! Error({severity}, {number:04d}, "{cause}", "{text}")'


def named_arguments(text: str) -> list[tuple[str, str]]:
    """``X(), Time(0.5)`` as names with what stands in their brackets.

    Raises
    ------
    IppCommandError
        When they are not of this form.
    """
    found, at = [], 0
    while at < len(text):
        match = _ARGUMENT.match(text, at)
        if match is None:
            raise IppCommandError(3, 502, "Incorrect arguments")
        found.append((match[1], match[2]))
        at = match.end()
    if not found:
        raise IppCommandError(3, 502, "Incorrect arguments")
    return found


def shown(value: object) -> str:
    """A property's value as it is sent."""
    return f'"{value}"' if isinstance(value, str) else f"{value}"
