"""Options that say how sure a test's means are, and what they make of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.planning.instruments import instruments_called
from abbe.compcore.verification.budget import MeasuringUncertainty
from abbe.daemon.arguments.bounded import within

if TYPE_CHECKING:
    from collections.abc import Sequence

InstrumentName = Annotated[
    str | None,
    typer.Option(help="Whose uncertainty counts; as abbe plan has them: laser, step-gauge, …"),
]
ScaleSd = Annotated[
    float | None,
    typer.Option(
        callback=within(1e-3, 1e3, "µm/m"), help="Instead: u of the instrument's scale, µm/m."
    ),
]
TemperatureSd = Annotated[
    float, typer.Option(callback=within(1e-3, 20.0, "K"), help="u of the temperature, K.")
]
Expansion = Annotated[
    float, typer.Option(callback=within(0.0, 40.0, "ppm/K"), help="Thermal expansion, ppm/K.")
]
ExpansionSd = Annotated[
    float, typer.Option(callback=within(0.0, 10.0, "ppm/K"), help="u of it, ppm/K.")
]
Misalignment = Annotated[
    float,
    typer.Option(
        callback=within(0.0, 50.0, "mm"),
        help="How far the instrument's line lies at most beside the axis's at its end, mm.",
    ),
]


@dataclass(frozen=True, slots=True)
class StatedMeans:
    """What the command line says of instrument, thermometers and set-up.

    Attributes
    ----------
    instrument
        Its name in `INSTRUMENTS`; None: that of the check plan, else a laser.
    scale_sd
        µm/m; None: the instrument's.
    temperature_sd
        K.
    expansion, expansion_sd
        ppm/K.
    misalignment
        mm.
    """

    instrument: str | None = None
    scale_sd: float | None = None
    temperature_sd: float = 0.2
    expansion: float = 11.5
    expansion_sd: float = 1.0
    misalignment: float = 0.5

    def sure(self, campaign: Campaign, planned: Sequence[str] = ()) -> MeasuringUncertainty:
        """The uncertainties for a campaign; a reading's is the campaign's own where it states one.

        Parameters
        ----------
        planned
            The instruments of the check plan; counts where they are one.

        Raises
        ------
        InputError
            For an instrument that Abbe does not know.
        """
        alike = planned[0] if len(set(planned)) == 1 else "laser"
        (own,) = instruments_called([self.instrument or alike])
        usual = MeasuringUncertainty()
        angle = own.key in ("angle", "level", "rotary-calibrator")
        stated = usual if angle else replace(usual, reading=own.sd, per_length=own.per_length)
        if angle:
            stated = replace(stated, angle=own.sd)
        lengths = campaign.sd[campaign.kind == Kind.DISPLACEMENT]
        if len(lengths) and np.isfinite(lengths).all():
            stated = replace(stated, reading=float(np.median(lengths)))
        scale = self.scale_sd
        return replace(
            stated,
            per_length=stated.per_length if scale is None else scale * 1e-6,
            temperature_sd=self.temperature_sd,
            expansion=self.expansion * 1e-6,
            expansion_sd=self.expansion_sd * 1e-6,
            misalignment=self.misalignment,
        )
