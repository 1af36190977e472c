"""The section ``[output]``: what is written to the controller."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from abbe.daemon.config.sections.section import ChannelName, Section
from abbe.drivers.transducers import AnyTransducerConfig


class OutputAxisSection(Section):
    """Where an axis's corrected position goes."""

    target: ChannelName
    transducer: AnyTransducerConfig | None = None
    """mm → counts (rotary: rad or degrees → counts), read backwards; none where the channel takes
    mm (rotary: deg or rad)."""


class EchoSection(Section):
    """A number that is written back as it was read in the same cycle (a sample number)."""

    source: ChannelName
    target: ChannelName


class OutputSection(Section):
    """What is written to the controller. Without this section nothing is."""

    axes: dict[str, OutputAxisSection] = Field(default_factory=dict)
    status: ChannelName | None = None
    """Abbe's status word, `abbe.daemon.status_word`."""
    heartbeat: ChannelName | None = None
    """Counts cycles, from 0 to 65535 or as far as its channel holds, over and over; written after
    everything else."""
    read_back: Annotated[float, Field(ge=0.0, le=600.0)] = 1.0
    """s between two looks at what the controller holds of what was written, where its channels can
    be read: somebody else may write there too. 0: never."""
    echo: Annotated[tuple[EchoSection, ...], Field(strict=False)] = ()
    plus_minus: dict[str, ChannelName] = Field(default_factory=dict)
    """Axis → channel, in mm or um, that receives ± of its correction, k = 2."""
    outside: ChannelName | None = None
    """Channel that receives whether a position, a signal or the tool was never measured:
    `abbe.daemon.pipeline.live_uncertainty.Outside`."""
