"""What an MTConnect agent observed, as a sample: number, quality, and how old it is."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from datetime import UTC, datetime

from abbe.drivers.link import LinkProtocolError, Quality, Sample
from abbe.drivers.mtconnect.config import MtconnectChannelConfig, ObservationStamp
from abbe.drivers.mtconnect.documents import AgentElement

_NAN = math.nan
_JITTER = 0.1
"""s by which an observation's stamp may be later than its document's: clocks are read in steps."""
_NUMBER = re.compile(r"[+-]?(\d{1,40}(\.\d{0,40})?|\.\d{1,40})([eE][+-]?\d{1,3})?", re.ASCII)
_TIME = re.compile(
    r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?P<part>\.\d{1,9})?(Z|[+-]\d\d:?\d\d)?", re.ASCII
)
_MISSING = "UNAVAILABLE"


def moment(text: str) -> tuple[datetime, float]:
    """A time stamp, and how much later (s) it may have been: agents leave out parts of seconds.

    >>> moment("2026-03-01T10:00:00Z")[1], moment("2026-03-01T10:00:00.250Z")[1]
    (1.0, 0.001)

    Raises
    ------
    LinkProtocolError
        When it is none.
    """
    found = _TIME.fullmatch(text)
    if found is None:
        raise LinkProtocolError(
            f"expected a time stamp such as 2026-03-01T10:00:00Z: {text[:80]!r}"
        )
    try:
        at = datetime.fromisoformat(text)
        # the standard has them in UTC
        at = at.replace(tzinfo=UTC) if at.tzinfo is None else at.astimezone(UTC)
    except (ValueError, OverflowError) as error:
        raise LinkProtocolError(f"time stamp {text!r}: {error}") from None
    part = found["part"]
    return at, 10.0 ** -(len(part) - 1) if part else 1.0


def sample_of(
    channel: MtconnectChannelConfig,
    value_of: Callable[[float], float],
    stamp: ObservationStamp,
    found: AgentElement,
    asked_at: float,
    made_at: str,
) -> Sample:
    """One value.

    Parameters
    ----------
    channel
        What is expected.
    value_of
        Its number → its value.
    stamp
        Whether the observation's time stamp tells its age.
    found
        The last observation of its data item.
    asked_at
        When the agent was asked for what followed, monotonic, s.
    made_at
        The agent's time stamp of its answer to that.

    Returns
    -------
    Sample
        Its time is that of the question, less what the observation was old at the answer: both
        stamps are of the agent's side, so that its clock need not be right.
    """
    if found.text == _MISSING:
        why = f"{channel.data}: the agent says {_MISSING}"
        return Sample(_NAN, asked_at, Quality.UNAVAILABLE, why)
    try:
        value = value_of(_number(channel, found))
        if not math.isfinite(value):
            raise LinkProtocolError(f"becomes {value}")
        age = 0.0 if stamp == "none" else _age(found.attributes.get("timestamp", ""), made_at)
    except LinkProtocolError as error:
        return Sample(_NAN, asked_at, Quality.BAD, f"{channel.data}: {error}")
    return Sample(value, asked_at - age)


def _number(channel: MtconnectChannelConfig, found: AgentElement) -> float:
    if found.parts:
        raise LinkProtocolError(f"is no number: {found.name[:80]} holds entries of its own")
    if "sampleCount" in found.attributes:
        raise LinkProtocolError("is a time series: of which moment its numbers are is not known")
    # MTConnect 2: the agent compares what it gets with what the data item allows
    if (quality := found.attributes.get("quality", "VALID")) != "VALID":
        raise LinkProtocolError(f"the agent says {quality[:40]}")
    words = found.text.split()
    if channel.item is not None:
        if channel.item > len(words):
            raise LinkProtocolError(f"item {channel.item} of {len(words)}")
        words = [words[channel.item - 1]]
    elif len(words) > 1:
        raise LinkProtocolError(f"has {len(words)} words ({found.text[:60]!r}): say which item")
    if not words or not _NUMBER.fullmatch(words[0]):
        raise LinkProtocolError(f"is no number: {found.text[:60]!r}")
    number = float(words[0])
    if not math.isfinite(number):
        raise LinkProtocolError(f"is {number}")
    return number


def _age(observed_at: str, made_at: str) -> float:
    """How old an observation can have been at the most, s, when the agent answered."""
    observed, _ = moment(observed_at)
    made, later = moment(made_at)
    # what is left out of the answer's own stamp, it may be later
    age = (made - observed).total_seconds() + later
    if age < -_JITTER:
        raise LinkProtocolError(
            f"its time stamp {observed_at} is later than the answer itself ({made_at}), so that "
            "nobody knows how old it is: see stamp in docs/mtconnect.md"
        )
    return max(0.0, age)
