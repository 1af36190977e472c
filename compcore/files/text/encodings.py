"""Text that other people's programs wrote: which of a few encodings its bytes are."""

from __future__ import annotations

import re

_HIGH = re.compile(rb"[\x80-\xff]+")
_GB2312 = re.compile(rb"(?:[\xa1-\xf7][\xa1-\xfe])+")
_TEXT = 4
"""Bytes of two Chinese characters: a single pair between Latin letters is two umlauts."""
_UTF8 = re.compile(rb"[\xc2-\xdf][\x80-\xbf]|[\xe0-\xef][\x80-\xbf]{2}")
"""A letter of UTF-8; in Windows-1252 an accented capital with a sign behind it: in no word."""


def shop_encoding(data: bytes) -> str | None:
    r"""The encoding of lines that a spreadsheet saved: UTF-8, GBK, Windows-1252, or None.

    None for what none of them reads whole, and for UTF-8 with single bytes that are damaged: that
    would be read as Windows-1252, with every umlaut as two strange letters.

    >>> shop_encoding("Fräse Süd".encode("cp1252"))
    'cp1252'
    >>> shop_encoding("Fräse Süd".encode() + b"\xe4") is None
    True
    """
    other = "gbk" if _chinese(data) else None if _UTF8.search(data) else "cp1252"
    for encoding in ("utf-8", other):
        try:
            if encoding is not None:
                data.decode(encoding)
                return encoding
        except UnicodeDecodeError:
            continue
    return None


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
