"""What a measurement is to do, and where it goes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime

from abbe.compcore.artefacts.calibrated_gauge import CalibratedGauge
from abbe.compcore.artefacts.calibrated_plate import CalibratedPlate
from abbe.compcore.files.growing_campaign import GrowingCampaign
from abbe.compcore.planning.envelope import WorkingSpace
from abbe.compcore.planning.probing.standing_sphere import StandardSphere
from abbe.daemon.config import Configuration
from abbe.daemon.measure.following.instrument import Instrument


@dataclass(frozen=True)
class MeasureTask:
    """What is to be measured, and where it goes.

    Attributes
    ----------
    configuration
        Machine, links, instruments.
    file
        The campaign, begun or gone on with.
    started
        Its start, UTC.
    instruments
        Plan's instrument → the one that stands for it.
    expected
        Set-up → uncertainty over the volume before and after it, mm.
    stated
        Whether it is stated which compensation acts.
    space
        Where the plan says that the machine may go.
    touched
        What the machine touches by itself; None: nothing.
    turns
        Rotary axis → channel of the link by which it is turned meanwhile.
    once
        Whether what was missed is not waited for.
    """

    configuration: Configuration
    file: GrowingCampaign
    started: datetime
    instruments: Mapping[str, Instrument]
    expected: Mapping[str, tuple[float, float]]
    stated: bool
    space: WorkingSpace
    touched: CalibratedPlate | CalibratedGauge | StandardSphere | None = None
    turns: Mapping[str, str] = field(default_factory=dict)
    once: bool = False
