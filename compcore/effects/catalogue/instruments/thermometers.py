"""Effects of thermometers: they act through the effects that read them, and move nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Self

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import F64, Effect, FittedEffect, Motion, Parameter
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.signals import by_sense, recorded, require_temperatures
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine

Amended = Callable[[Conditions, float], Conditions]
"""Conditions, and how much an amendment grows → the conditions that it makes of them."""


def by_reading(
    machine: Machine,
    conditions: Conditions,
    model: Sequence[FittedEffect],
    signal: str,
    amended: Amended,
    step: float = 1.0,
) -> tuple[Motion, ...]:
    """What a model's effects do for one more unit of what amends a reading, straight lines of it.

    Parameters
    ----------
    model
        The model's fitted terms; those that amend readings themselves are left out.
    signal
        The signal that is amended.
    amended
        Makes the amended conditions.
    step
        Amount over which the straight line is taken, in the amendment's unit.
    """
    found = []
    half = 0.5 * step
    for term in model:
        effect = term.effect
        if effect.reads_model or signal not in effect.signals_needed():
            continue
        values, own = term.coefficients(machine), term.nonlinear(machine)
        high, low = (effect.motions(machine, amended(conditions, by), own) for by in (half, -half))
        for more, less in zip(high, low, strict=True):
            slope = (more.columns - less.columns) @ values[more.parameters] / (2.0 * half)
            found.append(Motion(more.error_motion, slope[:, None]))
    return tuple(found)


class ThermometerEffect(Effect):
    """A thermometer that reads wrong: it acts through the effects that read its signal."""

    scope = "instrument"
    reads_model = True
    signal: str

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """None by itself; see `motions_among`."""
        return ()

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None: it acts through other effects."""
        return ()


@register
class SensorOffset(ThermometerEffect):
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

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The offset."""
        signal = machine.signals[self.signal]
        unit = "K" if signal.temperature else signal.unit
        return (Parameter("offset", unit, (-2.0, 2.0), f"{self.signal} reads too much by this"),)

    def motions_among(
        self,
        machine: Machine,
        conditions: Conditions,
        nonlinear: Mapping[str, float],
        model: Sequence[FittedEffect],
    ) -> tuple[Motion, ...]:
        """Minus what the model's effects do for one more unit of the signal."""
        return by_reading(
            machine, conditions, model, self.signal, lambda c, by: c.with_offset(self.signal, -by)
        )

    def amend(self, machine: Machine, conditions: Conditions, coefficients: F64) -> Conditions:
        """The readings without the offset."""
        return conditions.with_offset(self.signal, -float(coefficients[0]))

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[SensorOffset]:
        """Each recorded temperature: those on scales and screws first."""
        signals = recorded(machine, coverage, temperature=True)
        for signal in by_sense(signals, ("scale", "screw", "structure")):
            yield cls(signal=signal.name)


class MisreadDifferences(ThermometerEffect):
    """A thermometer that is right at one temperature, and misreads what differs from it."""

    def check(self, machine: Machine) -> None:
        """The signal is a temperature.

        Raises
        ------
        InputError
            The signal is in another unit than degC or K.
        """
        super().check(machine)
        require_temperatures(machine, "signal", [self.signal])

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[Self]:
        """Each recorded temperature: those on the structure first, whose differences are read."""
        signals = recorded(machine, coverage, temperature=True)
        for signal in by_sense(signals, ("structure", "scale", "screw")):
            yield cls(signal=signal.name)


@register
class SensorGain(MisreadDifferences):
    """A temperature sensor whose differences are wrong in proportion: its gain.

    It reads a change of 10 K as one of 11. Of an effect that reads this sensor alone nothing is
    seen, since its coefficient is fitted to the readings as they are; of one that reads a
    *difference*, or a mean, much: two thermometers on a column that warms evenly by 10 K seem to
    drift apart by 1 K, and the column seems to bend. As an offset it acts through the effects that
    use the sensor, on the campaign and live, and adds nothing to the compensation.

    Formula
        Effects read ``T0 + (T − T0)/(1 + gain)`` in place of T, T0 the machine's reference
        temperature. To first order this is ``−gain·(T − T0)·Σ ∂(error motions)/∂T`` over the
        model's fitted effects. Wrong about another temperature than T0 (a thermistor is right at
        25 °C): a gain and a `sensor_offset`.
    Parameters
    ----------
        gain, reading minus truth of a difference, in parts of it; within ±0.2: the constant B of a
        thermistor taken 1 % too large makes −0.01; thermistors of other types than stated 0.05 to
        0.2, a thermometer that touches half its body and half the air up to −0.5.
    Signals
        The one that reads wrong.
    Typical causes
        The constants of another thermistor, a reference voltage that is off, a sensor that sits
        loosely, self-heating that depends on the air.
    Cure
        Calibrate at two temperatures, in a bath; enter the constants in the link's configuration,
        and take this effect out of the model.
    Source
        Steinhart and Hart, Deep-Sea Research 15 (1968), 497-503 (a thermistor's constants); ISO/TR
        16015.
    """

    kind = "sensor_gain"

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The gain."""
        text = f"{self.signal} reads differences too large by this part"
        return (Parameter("gain", "1", (-0.2, 0.2), text),)

    def motions_among(
        self,
        machine: Machine,
        conditions: Conditions,
        nonlinear: Mapping[str, float],
        model: Sequence[FittedEffect],
    ) -> tuple[Motion, ...]:
        """Minus what the model's effects do for the signal's excess over the reference."""
        about = machine.reference_temperature
        own = [t.coefficients(machine)[0] for t in model if t.effect == self]
        whole = 1.0 + (float(own[0]) if own else 0.0)
        return by_reading(
            machine,
            conditions,
            model,
            self.signal,
            lambda c, by: c.with_gain(self.signal, 1.0 - by / whole, about),
        )

    def amend(self, machine: Machine, conditions: Conditions, coefficients: F64) -> Conditions:
        """The readings without the gain."""
        factor = 1.0 / (1.0 + float(coefficients[0]))
        return conditions.with_gain(self.signal, factor, machine.reference_temperature)


@register
class SensorBend(MisreadDifferences):
    """A temperature sensor whose reading is bent: right at one temperature, less and less beyond.

    Thermistors, resistors and thermocouples are bent by nature, and are straightened by a formula
    with constants. With too few of them, or with those of another type, what is read runs off with
    the square of the distance from where it is right. What follows the true temperature then
    follows the reading along a parabola. As an offset it acts through the effects that use the
    sensor, on the campaign and live, and adds nothing to the compensation.

    Formula
        The reading is ``T + bend·(T − T0)²``, T the true temperature, T0 the machine's reference
        temperature; effects read T. To first order this is
        ``−bend·(T − T0)²·Σ ∂(error motions)/∂T`` over the model's fitted effects. Right at another
        temperature than T0: a bend and a `sensor_gain`. Behind a lag, the lagged reading is
        straightened.
    Parameters
    ----------
        bend in 1/K, within ±0.001 (1 K at 32 K above T0): a platinum resistor taken as straight
        −0.00015; a thermistor by its constant B alone, in place of three constants, up to 0.0003; a
        thermocouple of type T taken as straight 0.0006.
    Signals
        The one that reads wrong.
    Typical causes
        A thermistor's constant B in place of its table, the constants of another thermistor, a
        resistor or thermocouple taken as straight, self-heating.
    Cure
        Calibrate at three temperatures, in a bath; enter the constants in the link's configuration,
        and take this effect out of the model.
    Source
        IEC 60751 (platinum: 1 + 3.9083e-3·T − 5.775e-7·T²); IEC 60584 (thermocouples); Steinhart
        and Hart, Deep-Sea Research 15 (1968), 497-503.
    """

    kind = "sensor_bend"

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The bend."""
        text = f"{self.signal} reads too much by this times the square of its distance from T0"
        return (Parameter("bend", "1/K", (-1e-3, 1e-3), text),)

    def motions_among(
        self,
        machine: Machine,
        conditions: Conditions,
        nonlinear: Mapping[str, float],
        model: Sequence[FittedEffect],
    ) -> tuple[Motion, ...]:
        """Minus what the model's effects do for the square of the signal's distance from T0."""
        about = machine.reference_temperature
        own = [t.coefficients(machine)[0] for t in model if t.effect == self]
        bend = float(own[0]) if own else 0.0

        def more(c: Conditions, by: float) -> Conditions:
            # back to what was read, and straightened a little more
            return c.straightened(self.signal, bend + by, about, now=bend)

        return by_reading(machine, conditions, model, self.signal, more, step=1e-4)

    def amend(self, machine: Machine, conditions: Conditions, coefficients: F64) -> Conditions:
        """The readings put right."""
        about = machine.reference_temperature
        return conditions.straightened(self.signal, float(coefficients[0]), about)
