"""What an OPC UA server sends, cut into chunks and bounded before asyncua sees any of it."""

from __future__ import annotations

from collections.abc import Callable

MOST_BYTES = 1 << 19
"""Bytes of one answer beyond which it is none; that of a hundred variables has some 5000."""
_MOST_CHUNK = 65535
"""Bytes of one chunk: what the link states that it takes (Part 6, 7.1.2.3)."""
_MOST_CHUNKS = 64
"""Chunks of one answer; the smallest that one may be held to has 8192 bytes (Part 6, 6.7.1)."""
_HEADER = 8
"""Bytes of a chunk's type, whether it is the last one, and its size (Part 6, 7.1.2.2)."""


class IncomingChunks:
    """The bytes of one connection: handed on chunk by chunk, until there are too many.

    asyncua keeps whatever a server claims that it is going to send, up to 4 GB, copies all of it at
    each piece that comes, and keeps the parts of an answer that never ends. So no chunk reaches it
    before it is whole, and none that is too large, or too many for an answer.

    Parameters
    ----------
    take
        Gets each whole chunk.
    end
        Breaks the connection; nothing is handed on after that.
    """

    def __init__(self, take: Callable[[bytes], None], end: Callable[[], None]) -> None:
        self._take, self._end = take, end
        self._held = bytearray()
        self._bytes = self._chunks = 0
        self.why = ""
        """For people: why the connection was broken; empty: it was not."""

    def data_received(self, data: bytes) -> None:
        """Take what came."""
        at = 0
        while at < len(data) and not self.why:
            # a chunk is filled up to its end and no further: what is kept is one chunk at most
            wanted = self._size() if len(self._held) >= _HEADER else _HEADER
            piece = data[at : at + wanted - len(self._held)]
            self._held += piece
            at += len(piece)
            if len(self._held) < _HEADER:
                return
            size = self._size()
            if not _HEADER <= size <= _MOST_CHUNK:
                self._break(f"a piece of {size} bytes, where {_MOST_CHUNK} are agreed on")
            elif len(self._held) == size:
                self._whole()

    def _size(self) -> int:
        return int.from_bytes(self._held[4:_HEADER], "little")

    def _whole(self) -> None:
        chunk, self._held = bytes(self._held), bytearray()
        self._bytes += len(chunk)
        self._chunks += 1
        if self._bytes > MOST_BYTES or self._chunks > _MOST_CHUNKS:
            self._break(f"an answer of more than {MOST_BYTES} bytes or {_MOST_CHUNKS} pieces")
            return
        # one that is broken off ('A') is not answered: many of them are a flood, too
        if chunk[3:4] == b"F":
            self._bytes = self._chunks = 0
        self._take(chunk)

    def _break(self, why: str) -> None:
        self.why = f"the server sent too much: {why}"
        self._held.clear()
        self._end()
