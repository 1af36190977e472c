"""Text that other people's programs wrote: which of a few encodings its bytes are."""

from __future__ import annotations

import re

_HIGH = re.compile(rb"[\x80-\xff]+")
_GB2312 = re.compile(rb"(?:[\xa1-\xf7][\xa1-\xfe])+")
_TEXT = 4
"""Bytes of two Chinese characters: a single pair between Latin letters is two umlauts."""


def decoded(data: bytes) -> str:
    r"""Text of a foreign file: UTF-8, UTF-16 with its mark, GBK, or Windows-1252.

    What is not UTF-8 is Chinese only if all of its high bytes come in pairs of GB2312, and some
    pairs in a row; else it is Windows-1252, of which Latin-1 is a part. Never fails: bytes that
    Windows-1252 leaves open are read as Latin-1.

    >>> decoded("Fräse Süd".encode("latin-1"))
    'Fräse Süd'
    >>> decoded("机床 7".encode("gbk"))
    '机床 7'
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return data.decode("utf-16")
        except UnicodeDecodeError:
            pass
    for encoding in ("utf-8-sig", "gbk" if _chinese(data) else "cp1252", "latin-1"):
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    return data.decode("latin-1")


def _chinese(data: bytes) -> bool:
    runs = _HIGH.findall(data)
    if not all(_GB2312.fullmatch(run) for run in runs):
        return False
    return any(len(run) >= _TEXT for run in runs)
