"""SDO block transfers by the canopen package, and what it leaves behind when one breaks.

What canopen 2.4.1 does by itself, and what is done about it here:

- A block download that fails goes on in ``close`` (which also the garbage collector calls). Here
  the stream is taken out of service before it is dropped, and the node told to abort.
- A segment that is lost in the last block of a download makes it raise `RuntimeError`.
- A block upload whose end does not come makes it raise `AttributeError`; after one that failed,
  what is still on its way is waited for, or it would pass for answers to what comes next.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable
from typing import Any

import can
import canopen

from abbe.drivers.link import LinkError

_ABORT_GENERAL = 0x08000000
_MOST_LEFT = 300
"""Frames of a broken transfer that may still come: more than two blocks."""
_TELL_EVERY = 1024
"""Bytes between two reports of progress."""

Done = Callable[[int], None]
"""Called with the number of bytes of a transfer that are done."""


def receive_block(sdo: Any, stream: Any, progress: Done | None) -> bytes:
    """Read what a block upload brings; raises canopen's errors.

    Parameters
    ----------
    sdo
        canopen's SDO client, which it leaves without types.
    stream
        What that opened for the upload.
    progress
        Called now and then with how many bytes are here.
    """
    data = bytearray()
    try:
        while piece := stream.read(7):
            data += piece
            if progress is not None and len(data) % _TELL_EVERY < len(piece):
                progress(len(data))
    except BaseException as error:
        stream._error = True  # or its close would confirm the transfer
        stream.close()
        if isinstance(error, canopen.SdoAbortedError | can.CanError | LinkError):
            raise
        sdo.abort(_ABORT_GENERAL)
        _drain(sdo)
        if isinstance(error, AttributeError):
            raise canopen.SdoCommunicationError("its end did not come") from error
        raise
    stream.close()
    return bytes(data)


def send_block(sdo: Any, index: int, subindex: int, data: bytes, progress: Done | None) -> None:
    """Send an object by block download; raises canopen's errors.

    Parameters
    ----------
    sdo
        canopen's SDO client, which it leaves without types.
    index, subindex, data
        Where, and what.
    progress
        Called now and then with how many bytes were sent.
    """
    stream = sdo.open(index, subindex, "wb", buffering=0, size=len(data), block_transfer=True)
    try:
        start = 0
        while start < len(data):
            start += stream.write(data[start : start + 7])
            if progress is not None and start % _TELL_EVERY < 7:
                progress(start)
    except BaseException as error:
        stream._initialized = False  # or its close would go on with the transfer
        stream.close()
        if not isinstance(error, canopen.SdoAbortedError | can.CanError | LinkError):
            sdo.abort(_ABORT_GENERAL)
        raise
    stream.close()


def _drain(sdo: Any) -> None:
    """Wait until nothing of a broken transfer comes any more."""
    with contextlib.suppress(canopen.SdoCommunicationError):
        for _ in range(_MOST_LEFT):
            with contextlib.suppress(canopen.SdoAbortedError, struct.error):
                sdo.read_response()
