"""Faults of a simulated controller, armed beforehand for one operation.

=================  ================================================================================
``lost_request``   nothing is done, nothing is answered
``lost_answer``    it is done, and not answered
``late_answer``    it is done, and answered after `TableFault.seconds`
``twice``          the frame comes twice: it is done twice and answered twice
``bad_request``    the frame arrives altered
``bad_answer``     the answer arrives altered
``refuses``        not done; the controller says no
``lies``           a read gives altered content, consistently; a command is confirmed and not done
``restart``        the power fails before it is done: no answer, the staging area is lost
``restart_after``  the power fails after it is done, before the answer
``restart_amid``   the power fails while it is being done
``hang``           not done; from now on there is no answer to anything, until woken
``hang_after``     done; from now on there is no answer to anything, until woken
=================  ================================================================================
"""

from __future__ import annotations

from dataclasses import dataclass

KINDS = (
    "lost_request",
    "lost_answer",
    "late_answer",
    "twice",
    "bad_request",
    "bad_answer",
    "refuses",
    "lies",
    "restart",
    "restart_after",
    "restart_amid",
    "hang",
    "hang_after",
)
OPERATIONS = (
    "identity",
    "state",
    "begin",
    "block",
    "status",
    "read_staged",
    "commit",
    "discard",
    "deactivate",
    "read_active",
    "show",
)
"""What a client can ask of a controller's table memory."""


@dataclass
class TableFault:
    """One fault of a table memory.

    Attributes
    ----------
    kind, at
        Of `KINDS`, at which of `OPERATIONS`.
    after
        Only once this operation was asked for after arming; none: at once.
    skip
        So many operations of that name go well before.
    times
        How often it happens.
    seconds
        How late an answer is, how long a restart takes.
    """

    kind: str
    at: str
    after: str | None = None
    skip: int = 0
    times: int = 1
    seconds: float = 0.1

    def __post_init__(self) -> None:
        if self.kind not in KINDS or self.at not in OPERATIONS:
            raise ValueError(f"no fault {self.kind!r} at {self.at!r}")


class Faults:
    """The faults that are armed.

    Attributes
    ----------
    happened
        Kind and operation of each that has come about.
    asked
        Every operation that was asked for, in order.
    """

    def __init__(self) -> None:
        self._armed: list[tuple[TableFault, int]] = []
        self.happened: list[tuple[str, str]] = []
        self.asked: list[str] = []

    def arm(self, fault: TableFault) -> None:
        """Have it happen."""
        self._armed.append((fault, len(self.asked)))

    def clear(self) -> None:
        """Let everything go well again, and forget what was asked."""
        self._armed.clear()
        self.happened.clear()
        self.asked.clear()

    def take(self, operation: str) -> TableFault | None:
        """Note that an operation is asked for; the fault that happens to it, if one does."""
        found = None
        for fault, since in self._armed:
            if fault.at != operation or fault.times <= 0 or found is not None:
                continue
            if fault.after is not None and fault.after not in self.asked[since:]:
                continue
            if fault.skip > 0:
                fault.skip -= 1
                continue
            fault.times -= 1
            found = fault
        self.asked.append(operation)
        if found is not None:
            self.happened.append((found.kind, operation))
        return found
