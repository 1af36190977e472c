"""Effects of the instrument: fitted, shown, and never part of the machine's compensation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import Effect, Motion, Parameter
from abbe.compcore.effects.catalogue.instruments.setup import MEASURED, SetupEffect
from abbe.compcore.effects.registry import register
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine


@register
class InstrumentDrift(SetupEffect):
    """Drift of one set-up: its values run off with time, those of other set-ups do not.

    Formula
        ``value = rate·(t − t_1)`` on the rows of the set-up, t_1 the time of its first row.
    Parameters
    ----------
        rate in mm/s (rad/s where ``measures = angle``), within ±100 µm/h (±200 µrad/h).
    Signals
        None but the time.
    Typical causes
        A tripod or magnetic foot that creeps, an instrument not warmed up, a beam through draughts,
        a level that settles, a probe's amplifier.
    Cure
        Warm up the instrument, shorten the set-up, measure forth and back (drift then shows as a
        difference that grows), return to the first point at the end.
    Source
        ISO 230-2 (order of measurement), ISO 230-3 (drift of the measuring set-up).
    """

    kind = "instrument_drift"

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The speed of the drift."""
        most = (2e-4 if self.unit == "rad" else 0.1) / 3600.0
        return (Parameter("rate", f"{self.unit}/s", (-most, most), f"drift of {self.setup}"),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``t − t_1`` on the set-up's rows."""
        elapsed = conditions.setup_rows().since_start(conditions.time)
        return (Motion(MEASURED, np.where(self.rows(conditions), elapsed, 0.0)[:, None]),)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[InstrumentDrift]:
        """Each set-up that took time and has rows enough to show it.

        None that touches one artefact from all round: its order of points is its only clock.
        """
        for name, seen in coverage.setup_details.items():
            if seen.duration > 0.0 and seen.rows > 3 and not seen.all_round:
                yield cls.model_validate(cls.keys_of(coverage, name))


@register
class LengthBias(Effect):
    """A constant that an instrument adds to each distance: its own zero, or a centre offset.

    Formula
        ``value = bias`` on all distances from the ``base`` point, or from all of them where none is
        given. Distances between base points count where no base is given.
    Parameters
    ----------
        bias in mm, within ±1 mm: a ball bar or tracker that was initialised wrongly. It can be
        separated from the rest with four base points or more.
    Signals
        None.
    Typical causes
        Initialisation (home point, absolute length) of laser ball bar or tracker, offset of ball or
        reflector centre, a nest that is not seated.
    Cure
        Initialise again; a fourth base point makes it observable.
    Source
        Krulewich, LLNL: rapid mapping from distances with a fourth base.
    """

    kind = "length_bias"
    scope = "instrument"
    base: str | None = None

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The constant."""
        where = "all distances" if self.base is None else f"distances from {self.base}"
        return (Parameter("bias", "mm", (-1.0, 1.0), f"bias of {where}"),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """1 on the distances."""
        if conditions.base is None:
            hit = np.zeros(conditions.n, dtype=bool)
        elif self.base is None:
            hit = np.not_equal(conditions.base, "")
        else:
            hit = np.equal(conditions.base, self.base)
            if conditions.kind is not None:
                hit &= np.equal(conditions.kind, Kind.DISTANCE)
        return (Motion(MEASURED, hit.astype(np.float64)[:, None]),)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None of the machine's."""
        return ()

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[LengthBias]:
        """All distances together, then from each base point."""
        if coverage.bases:
            yield cls()
            if len(coverage.bases) > 1:
                for base in coverage.bases:
                    yield cls(base=base)
