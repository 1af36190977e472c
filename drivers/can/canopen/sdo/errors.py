"""Errors of an SDO transfer besides silence."""

from __future__ import annotations

from abbe.drivers.link import LinkProtocolError


class SdoAbortError(LinkProtocolError):
    """The node aborted a transfer, e.g. there is no such object.

    Attributes
    ----------
    code
        The abort code (CiA 301, 7.2.4.3.17).
    """

    def __init__(self, message: str, code: int = 0) -> None:
        super().__init__(message)
        self.code = code


class TooLongError(LinkProtocolError):
    """An object does not fit in one frame."""
