"""Lines cut out of the bytes that a port receives."""

from __future__ import annotations


class Splitter:
    """Collects bytes until a terminator.

    Parameters
    ----------
    terminator
        What ends a line.
    longest
        Bytes that a line may have. What is longer is thrown away up to the next terminator.
    """

    def __init__(self, terminator: bytes, longest: int) -> None:
        self._terminator = terminator
        self._longest = longest
        self._held = b""
        self._skipping = False
        self.thrown_away = 0
        """Lines that were too long."""

    @property
    def held(self) -> bytes:
        """The beginning of a line that has not ended yet."""
        return self._held

    def clear(self) -> None:
        """Forget the beginning of a line."""
        self._held = b""
        self._skipping = False

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes in; hands back the lines that they complete, without their terminators."""
        if not self._held and not self._skipping and len(data) <= self._longest:
            # nearly always one whole line comes, or none
            line, found, rest = data.partition(self._terminator)
            if found and not rest:
                return [line]
        *lines, self._held = (self._held + data).split(self._terminator)
        if self._skipping and lines:
            del lines[0]
            self._skipping = False
        good = [line for line in lines if len(line) <= self._longest]
        self.thrown_away += len(lines) - len(good)
        if len(self._held) >= self._longest + len(self._terminator):
            if not self._skipping:
                self.thrown_away += 1
            # A terminator may be cut in two just here.
            self._held = self._held[-len(self._terminator) :]
            self._skipping = True
        return good
