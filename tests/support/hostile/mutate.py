"""Damage to files, the same every time: flipped bytes, cuts, numbers, encodings, line ends."""

from __future__ import annotations

import random
import re
from collections.abc import Iterator

_NUMBER = re.compile(rb"(?<![\w.])-?\d+(?:\.\d+)?(?![\w.])")
NUMBERS = (
    b"1e308",
    b"-1e308",
    b"1e-308",
    b"nan",
    b"inf",
    b"-0",
    b"1e400",
    b"9" * 400,
    b"0x10",
    b"",
)
"""What a number is replaced by."""


def whole(data: bytes) -> Iterator[tuple[str, bytes]]:
    """(name, content) of files that differ from a good one as a whole."""
    yield "empty", b""
    yield "one byte", data[:1]
    yield "NUL in the middle", data[: len(data) // 2] + b"\0" + data[len(data) // 2 :]
    yield "all NUL", b"\0" * len(data)
    yield "UTF-16", data.decode("utf-8").encode("utf-16")
    yield "Latin-1", data[: len(data) // 3] + b"\xe9\xb5" + data[len(data) // 3 :]
    yield "lone surrogate", data + b"\xed\xa0\x80"
    yield "old Mac line ends", data.replace(b"\n", b"\r")
    yield "a picture", b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 4
    yield "twice", data + data
    yield "noise", random.Random(7).randbytes(2000)
    yield "one line", data.replace(b"\n", b" ")
    yield "a line of a megabyte", data + b"x" * 1_000_000
    yield "control characters", data.replace(b"=", b"\x1b[31m=", 1).replace(b",", b"\x07,", 1)


def harmless(data: bytes) -> Iterator[tuple[str, bytes]]:
    """(name, content) of files that mean the same: to be read."""
    yield "byte order mark", b"\xef\xbb\xbf" + data
    yield "CRLF", data.replace(b"\r\n", b"\n").replace(b"\n", b"\r\n")


def flipped(data: bytes, count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """(name, content) of files in which one to four bytes were changed."""
    source = random.Random(seed)
    for i in range(count):
        changed = bytearray(data)
        for _ in range(source.randint(1, 4)):
            changed[source.randrange(len(changed))] = source.randrange(256)
        yield f"bytes changed {i}", bytes(changed)


def cut(data: bytes, count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """(name, content) of files that end too early."""
    source = random.Random(seed)
    for i in range(count):
        yield f"cut off {i}", data[: source.randrange(1, len(data) - 1)]


def lines_mixed(data: bytes, count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """(name, content) of files with a line lost, doubled or moved."""
    source = random.Random(seed)
    for i in range(count):
        lines = data.splitlines(keepends=True)
        at, to = source.randrange(len(lines)), source.randrange(len(lines))
        match i % 3:
            case 0:
                del lines[at]
            case 1:
                lines.insert(to, lines[at])
            case _:
                lines.insert(to, lines.pop(at))
        yield f"{('line lost', 'line doubled', 'line moved')[i % 3]} {i}", b"".join(lines)


def numbers_replaced(data: bytes, count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """(name, content) of files in which one number is another, or none."""
    source = random.Random(seed)
    found = list(_NUMBER.finditer(data))
    for i in range(count):
        place = source.choice(found)
        other = NUMBERS[i % len(NUMBERS)]
        text = data[: place.start()] + other + data[place.end() :]
        yield f"{place[0].decode()} at {place.start()} is {other[:9].decode()!r}", text
