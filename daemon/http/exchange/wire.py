"""Messages between a run and its HTTP process, over a socket pair that nobody else has.

The run sends frames: a kind, a length, the content. It trusts nothing that comes back, since the
other side talks to a network: that is one JSON object a line, checked like any other request. What
the run sends may be read as it is.
"""

from __future__ import annotations

import asyncio
import enum
import json
import marshal
import struct
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from abbe.daemon.control.requests import LONGEST, Request

_HEAD = struct.Struct("!BI")
_LARGEST = 16_000_000


class FeedFrame(enum.IntEnum):
    """Kinds of frames that a run sends."""

    SETUP = 0
    """JSON: what the HTTP process has to do, and what a cycle's numbers mean."""
    STATUS = 1
    """JSON: a `RunStatus`."""
    CYCLES = 2
    """Marshalled: a list of cycles, as `Cycle` names their parts."""
    ANSWER = 3
    """JSON: the answer to one `Operation`."""


class Cycle(NamedTuple):
    """One cycle as it goes from the run to the HTTP process; lengths in mm, angles in rad.

    Attributes
    ----------
    number, time
        As in the run's record; time in s since the start.
    indicated, corrected, correction, states
        Of the axes and directions that `FeedFrame.SETUP` names, in that order; NaN where not known.
    status
        The status word.
    in_full
        Whether every direction is corrected in full, and the controller took it.
    duration, age
        s.
    signals
        Value and whether it is fresh and good, in the order of their names; None where they are
        still those of the cycle before.
    faults
        What is wrong → why.
    dropped
        Cycles before this one that were to be sent and could not be.
    """

    number: int
    time: float
    indicated: tuple[float, ...]
    corrected: tuple[float, ...]
    correction: tuple[float, ...]
    states: tuple[str, ...]
    status: int
    in_full: bool
    duration: float
    age: float
    signals: dict[str, tuple[float, bool]] | None
    faults: dict[str, str]
    dropped: int


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Alive(_Message):
    """The HTTP process goes round."""

    say: Literal["alive"] = "alive"


class Serving(_Message):
    """It listens where it should, from now on."""

    say: Literal["serving"] = "serving"


class WantStatus(_Message):
    """A status, when the present cycle is over."""

    say: Literal["status"] = "status"


class WantCycles(_Message):
    """Every cycle, or one in so many seconds; None: no more of them."""

    say: Literal["cycles"] = "cycles"
    every: Annotated[float, Field(ge=0.0, le=3600.0)] | None


class Operation(_Message):
    """A request of somebody who may change what runs."""

    say: Literal["do"] = "do"
    number: Annotated[int, Field(ge=0, le=2**62)]
    who: Annotated[str, Field(max_length=300)]
    request: Annotated[Request, Field(discriminator="do")]


class ForJournal(_Message):
    """Something for the journal."""

    say: Literal["event"] = "event"
    level: Annotated[int, Field(ge=0, le=50)]
    text: Annotated[str, Field(max_length=4000)]


Message = Alive | Serving | WantStatus | WantCycles | Operation | ForJournal
MESSAGE: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="say")])
"""Checks one message to the run."""
LONGEST_MESSAGE = 2 * LONGEST
"""Bytes of a message to the run."""


def packed(kind: FeedFrame, content: bytes) -> bytes:
    """A frame to send."""
    return _HEAD.pack(kind, len(content)) + content


def packed_json(kind: FeedFrame, content: dict[str, Any]) -> bytes:
    """A frame of JSON to send."""
    return packed(kind, json.dumps(content, ensure_ascii=False).encode())


def packed_cycles(cycles: list[tuple[Any, ...]]) -> bytes:
    """A frame of cycles to send, each with `Cycle`'s parts."""
    return packed(FeedFrame.CYCLES, marshal.dumps(cycles))


def unpacked_cycles(content: bytes) -> list[Cycle]:
    """Cycles of a frame that a run has sent."""
    return [Cycle._make(parts) for parts in marshal.loads(content)]


async def next_frame(reader: asyncio.StreamReader) -> tuple[FeedFrame, bytes]:
    """The next frame of a run.

    Raises
    ------
    asyncio.IncompleteReadError
        When the run is over.
    ValueError
        For what is no frame.
    """
    kind, length = _HEAD.unpack(await reader.readexactly(_HEAD.size))
    if length > _LARGEST:
        raise ValueError(f"a frame of {length} bytes")
    return FeedFrame(kind), await reader.readexactly(length)
