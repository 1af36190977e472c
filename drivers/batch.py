"""Writing channels one after the other: what became of each, told in one error."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.link import (
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
    """One call of `drivers.link.Link.write` that sends a message for each channel.

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
        self._going = ""

    def begin(self, name: str) -> None:
        """A channel's message is about to be sent."""
        self._going = name

    def done(self) -> None:
        """The device took it."""
        self._done.append(self._going)
        self._going = ""

    def refused(self, why: str) -> LinkError:
        """The error that says that nothing at all was sent."""
        return LinkError(f"{self._label}: nothing written; {why}").leaving(untouched=self._names)

    def failed(self, error: LinkError) -> LinkError:
        """The error of one message as that of all: what was taken, what was not, what is unknown.

        That one's own channel is unknown, unless the error says that it is untouched.
        """
        left = [name for name in self._names if name not in self._done]
        unknown = {self._going} - error.untouched
        before = f"; written before: {', '.join(self._done)}" if self._done else ""
        kind = next((kind for kind in _KINDS if isinstance(error, kind)), LinkError)
        return kind(f"{self._label}: not written: {', '.join(left)}: {error}{before}").leaving(
            untouched=[name for name in left if name not in unknown], written=self._done
        )
