"""The configuration section of an MTConnect link: an agent, and which of its data items are read.

::

    [links.mill]
    driver = "mtconnect"
    url = "http://192.168.0.40:5000/Mill"
    stamp = "none"
    [links.mill.channels]
    x = { data = "Xact", unit = "mm" }
    T_spindle = { data = "Stemp", unit = "degC" }

``docs/mtconnect.md`` is the user's page on each key.
"""

from __future__ import annotations

import re
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import AfterValidator, ConfigDict, Field

from abbe.drivers.reconnect import ReconnectConfig
from abbe.drivers.scaled import ScaledNumber
from abbe.drivers.server_url import server_url

_STRICT = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

DEFAULT_PORT = 5000
"""Where agents listen unless they are told otherwise."""
ObservationStamp = Literal["observation", "none"]

_ID = re.compile(r"[\w.:-]{1,256}")
_PRINTED = re.compile(r"[!-~]*")


def _agent(url: str) -> str:
    parts = server_url(url, "http", "http://HOST:PORT or http://HOST:PORT/DEVICE")
    if parts.username is not None or parts.query or parts.fragment:
        raise ValueError(f"no user, question or fragment in it: {url!r}")
    if not _PRINTED.fullmatch(url):
        raise ValueError(f"only printed ASCII characters (%20 for a blank), found {url!r}")
    return url


def _data_item(text: str) -> str:
    # it becomes part of a question in XPath: nothing may end the name there
    if not _ID.fullmatch(text):
        raise ValueError(f"expected the id of a data item such as 'Xact', found {text!r}")
    return text


class MtconnectChannelConfig(ScaledNumber):
    """One value of the agent's: a data item, or one number of those that it has."""

    model_config = _STRICT

    data: Annotated[str, AfterValidator(_data_item)]
    """The ``id`` of its ``DataItem`` in the agent's probe document."""
    item: Annotated[int, Field(ge=1)] | None = None
    """Which number of several that an observation has (a path position has three), from 1."""


class MtconnectConfig(ReconnectConfig):
    """One MTConnect agent and what is read of it. Times are in s."""

    model_config = _STRICT

    url: Annotated[str, AfterValidator(_agent)]
    """``http://HOST:PORT``, or with the device's name or uuid: ``http://HOST:PORT/DEVICE``."""
    timeout: Annotated[float, Field(gt=0, le=60)] = 1.0
    """For an answer, from the question to its last byte; for the probe document five times that."""
    every: Annotated[float, Field(ge=0)] = 0.0
    """s between two questions; 0 asks at every call."""
    reconnect_min: Annotated[float, Field(gt=0)] = 0.5
    reconnect_max: Annotated[float, Field(gt=0)] = 10.0
    stamp: ObservationStamp = "observation"
    """Whether a value is as old as its observation's time stamp, or as the question."""
    units: bool = True
    """Whether the units of the agent's probe document are compared with `unit`."""
    select: bool = True
    """Whether the agent is asked for the channels' data items only, by an XPath."""
    max_waiting: Annotated[int, Field(ge=1)] = 16
    """Calls that may wait for the agent; one more is turned away at once."""
    channels: Annotated[dict[str, MtconnectChannelConfig], Field(min_length=1)]

    @property
    def host(self) -> str:
        """Name or address of the agent."""
        return urlsplit(self.url).hostname or ""

    @property
    def port(self) -> int:
        """Its TCP port."""
        return urlsplit(self.url).port or DEFAULT_PORT

    @property
    def path(self) -> str:
        """What stands before ``/probe`` in its addresses: nothing, or a device."""
        return urlsplit(self.url).path.rstrip("/")
