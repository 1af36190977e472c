"""Effects of the instrument: fitted, shown, and never part of the machine's compensation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import F64, Effect, FittedEffect, Motion, Parameter
from abbe.compcore.effects.catalogue.instruments.setup import MEASURED, SetupEffect
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.signals import by_sense, recorded
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
        """Each set-up that took time and has rows enough to show it."""
        for name, seen in coverage.setup_details.items():
            if seen.duration > 0.0 and seen.rows > 3:
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


@register
class SensorOffset(Effect):
    """A temperature sensor that reads wrong by a constant.

    It displaces nothing by itself: the effects that use the sensor see another temperature than
    there is. So it acts through them, on the campaign and live alike: every prediction starts from
    readings from which the offset has been taken off. It adds nothing to the compensation; what it
    corrects is the thermometer.

    Formula
        Effects read ``T − offset`` in place of T. To first order in the offset this is
        ``−offset·Σ ∂(error motions)/∂T`` over the model's fitted effects.
    Parameters
    ----------
        offset in the signal's unit (K), reading minus truth; within ±2 K: thermistors of one batch
        agree within 0.2 K, Pt100 of class B within 0.3 K, a bad contact costs 1 to 2 K.
    Signals
        The one that reads wrong.
    Typical causes
        Uncalibrated or exchanged sensor, bad thermal contact, self-heating, a two-wire Pt100 with a
        long cable.
    Cure
        Calibrate against a reference in a bath; mount with paste; enter the offset in the link's
        configuration, and take this effect out of the model.
    Source
        Zhang et al., CIRP Annals 34/1 (1985), on effective coefficients; ISO/TR 16015.
    """

    kind = "sensor_offset"
    scope = "instrument"
    reads_model = True
    signal: str

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The offset."""
        signal = machine.signals[self.signal]
        unit = "K" if signal.temperature else signal.unit
        return (Parameter("offset", unit, (-2.0, 2.0), f"{self.signal} reads too much by this"),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """None by itself; see `motions_among`."""
        return ()

    def motions_among(
        self,
        machine: Machine,
        conditions: Conditions,
        nonlinear: Mapping[str, float],
        model: Sequence[FittedEffect],
    ) -> tuple[Motion, ...]:
        """Minus what the model's effects do for one more unit of the signal."""
        found = []
        half = 0.5
        for term in model:
            effect = term.effect
            if effect.reads_model or self.signal not in effect.signals_needed():
                continue
            values, own = term.coefficients(machine), term.nonlinear(machine)
            ends = [
                effect.motions(machine, conditions.with_offset(self.signal, step), own)
                for step in (half, -half)
            ]
            for high, low in zip(*ends, strict=True):
                slope = (low.columns - high.columns) @ values[high.parameters] / (2.0 * half)
                found.append(Motion(high.error_motion, slope[:, None]))
        return tuple(found)

    def amend(self, conditions: Conditions, coefficients: F64) -> Conditions:
        """The readings without the offset."""
        return conditions.with_offset(self.signal, -float(coefficients[0]))

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None: it acts through other effects."""
        return ()

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[SensorOffset]:
        """Each recorded temperature: those on scales and screws first."""
        signals = recorded(machine, coverage, temperature=True)
        for signal in by_sense(signals, ("scale", "screw", "structure")):
            yield cls(signal=signal.name)
