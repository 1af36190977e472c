"""Batches of writes: channels one after the other, and one error for all that failed."""

from __future__ import annotations

from collections.abc import Iterable

from abbe.drivers.link import (
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkTimeoutError,
    TooLateError,
    WriteNotVerifiedError,
)

_KINDS = (
    LinkDownError,
    LinkTimeoutError,
    LinkProtocolError,
    TooLateError,
    WriteNotVerifiedError,
)


class Batch:
    """One call of `abbe.drivers.link.Link.write` that sends one message after the other.

    Parameters
    ----------
    label
        The link, for people.
    names
        Channels, in the order in which they are sent.
    """

    def __init__(self, label: str, names: Iterable[str]) -> None:
        self._label = label
        self._names = tuple(names)
        self._done: list[str] = []
        self._going: tuple[str, ...] = ()

    def begin(self, *names: str) -> None:
        """The message of a channel, or of several, is about to be sent."""
        self._going = names

    def done(self) -> None:
        """The device took it."""
        self._done += self._going
        self._going = ()

    def refused(self, why: str) -> LinkError:
        """The error that says that nothing at all was sent."""
        return LinkError(f"{self._label}: nothing written; {why}").leaving(untouched=self._names)

    def failed(self, error: LinkError) -> LinkError:
        """The error of one message as that of all: what was taken, what was not, what is unknown.

        That one's own channels are unknown, unless the error says that they are untouched.
        """
        left = [name for name in self._names if name not in self._done]
        unknown = set(self._going) - error.untouched
        before = f"; written before: {', '.join(self._done)}" if self._done else ""
        kind = next((kind for kind in _KINDS if isinstance(error, kind)), LinkError)
        return kind(f"{self._label}: not written: {', '.join(left)}: {error}{before}").leaving(
            untouched=[name for name in left if name not in unknown], written=self._done
        )
