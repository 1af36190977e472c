"""What the tests of I++ DME links share: configurations, opening, waiting."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager
from typing import Any

from abbe.drivers.ipp.config import IppConfig
from abbe.drivers.ipp.link import IppLink
from abbe.drivers.link import Sample
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.opening import opened

PATIENT = 8.0
"""s: a time-out that no stall of a busy machine reaches, where silence is not the matter."""
IMPATIENT = 0.3
"""s: a time-out where silence is the matter; what it hits by chance is asked again."""

AXES: dict[str, Any] = {name.lower(): {"axis": name} for name in "XYZ"}
SCALES: dict[str, Any] = {f"T_{axis.lower()}": {"scale_temperature": axis} for axis in "XYZ"}
PART: dict[str, Any] = {"T_part": {"property": "Part.Temperature", "unit": "degC"}}
REPORT: dict[str, Any] = {"move_report": {"time": 0.1, "distance": 0.05, "within": PATIENT}}
TIP = (3.0, 4.0, -151.0)
"""Where the tip is when the axes are at (3, 4, −1) mm; the tool is (0, 0, −150) mm."""
STANDING = ("--stand-at", "3,4,-1")


def section(process: SimulatedProcess, channels: dict[str, Any], **settings: Any) -> IppConfig:
    return IppConfig.model_validate(
        {
            "host": process.ready["host"],
            "port": process.ready["port"],
            "timeout": PATIENT,
            "reconnect_min": 0.02,
            "reconnect_max": 0.1,
            "quarantine_max": 1.0,
            "channels": channels,
        }
        | settings
    )


def linked(
    process: SimulatedProcess, channels: dict[str, Any], **settings: Any
) -> AbstractAsyncContextManager[IppLink]:
    return opened(IppLink("bench", section(process, channels, **settings)))


async def read_until(
    link: IppLink, names: Sequence[str], wanted: Callable[[Sample], bool], limit: float = 20.0
) -> dict[str, Sample]:
    """Read until all samples are as wanted."""
    began = time.monotonic()
    while True:
        samples = await link.read(names)
        if all(wanted(sample) for sample in samples.values()):
            return samples
        assert time.monotonic() - began < limit, samples
        await asyncio.sleep(0.01)


def good(sample: Sample) -> bool:
    return sample.good


async def standing(link: IppLink, names: Sequence[str] = ("x", "y", "z")) -> None:
    """Wait until the simulated machine has reached the place at which it is to stand."""
    began = time.monotonic()
    while True:
        samples = await link.read(names)
        if all(
            s.good and abs(s.value - at) < 1e-4
            for s, at in zip(samples.values(), TIP, strict=False)
        ):
            return
        assert time.monotonic() - began < 30.0, samples
        await asyncio.sleep(0.02)
