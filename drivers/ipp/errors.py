"""Errors of an I++ DME server: how severe, whose fault, what to do.

``Error(F1, F2, F3, Text)`` has the severity F1 (0 information, 1 warning, 2 error, 3 critical,
9 fatal), the number F2 (0000 to 7999 defined by I++ DME, the rest proprietary), and the reporting
method F3. From severity 2 on the server refuses further commands until
``ClearAllErrors()``.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

from abbe.drivers.ipp.grammar import Named, parse
from abbe.drivers.link import LinkProtocolError

USE_CLEAR_ALL_ERRORS = 514
"""The server is still in the error state."""

_OWN_FAULT = frozenset({501, 502, 505, 506, 507, 509, 510, 1002, 1004, 1506})
"""The command cannot be carried out on this server, whenever it is sent: unsupported, an argument
or property that it does not know, an axis that it does not have."""


class Severity(enum.IntEnum):
    """F1 of an error."""

    INFORMATION = 0
    WARNING = 1
    ERROR = 2
    CRITICAL = 3
    FATAL = 9


@dataclass(frozen=True, slots=True)
class ServerError:
    """One error as the server reported it.

    Attributes
    ----------
    severity
        Any value between 4 and 8 counts as `Severity.CRITICAL`.
    number
        F2, e.g. 2500.
    cause
        F3, the method.
    text
        For people.
    """

    severity: Severity
    number: int
    cause: str
    text: str

    @property
    def stops(self) -> bool:
        """Whether the server refuses further commands until its errors are cleared."""
        return self.severity >= Severity.ERROR

    @property
    def own_fault(self) -> bool:
        """Whether the same command would only fail again on this server."""
        return self.stops and self.number in _OWN_FAULT

    def __str__(self) -> str:
        """In a line: ``critical error 2500 of GoTo: Machine limit encountered``."""
        noun = {0: "information", 1: "warning", 2: "error", 3: "critical error", 9: "fatal error"}
        cause = f" of {self.cause}" if self.cause else ""
        return f"{noun[self.severity]} {self.number:04d}{cause}: {self.text}"


class StoppedError(LinkProtocolError):
    """A command was answered by an error that stops the server (severity 2, 3).

    Attributes
    ----------
    error
        What the server said.
    """

    def __init__(self, message: str, error: ServerError) -> None:
        super().__init__(message)
        self.error = error


def server_error(text: str) -> ServerError:
    """The error in a response's text.

    >>> str(server_error('Error(3, 2500, "GoTo", "Machine limit encountered")'))
    'critical error 2500 of GoTo: Machine limit encountered'

    What is not of this form is an error all the same: a critical one without a number.
    """
    try:
        values = parse(text)
        if len(values) == 1 and isinstance(values[0], Named) and values[0].name == "Error":
            severity, number, *rest = values[0].values or ()
            if isinstance(severity, float) and isinstance(number, float):
                cause, message = [*(str(part) for part in rest), "", ""][:2]
                return ServerError(_severity(severity), int(number), cause, message)
    except (LinkProtocolError, ValueError):
        pass
    return ServerError(Severity.CRITICAL, 0, "", f"not understood: {text[:120]!r}")


def _severity(number: float) -> Severity:
    if number in (0.0, 1.0, 2.0, 9.0):
        return Severity(int(number))
    return Severity.FATAL if number > 9.0 else Severity.CRITICAL
