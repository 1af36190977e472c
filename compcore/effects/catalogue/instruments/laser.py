"""Effects of laser interferometers: dead path, refraction of air, cosine error."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.air import (
    STANDARD_HUMIDITY,
    STANDARD_PRESSURE_HPA,
    STANDARD_TEMPERATURE_C,
    refractive_index,
    standard_index,
)
from abbe.compcore.effects.base import F64, Effect, Motion, Parameter
from abbe.compcore.effects.catalogue.instruments.setup import MEASURED
from abbe.compcore.effects.keys import Names, OptionalNames
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.signals import recorded
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine, Signal

PRESSURES = {"hPa": 1.0, "mbar": 1.0, "Pa": 0.01, "kPa": 10.0, "bar": 1000.0}
"""Unit of an air pressure → its factor to hPa."""


class LaserEffect(Effect):
    """An effect of the air in a laser interferometer's beam.

    `signals` are the air's temperature, pressure and humidity, told apart by their units; left out,
    they are the machine's signals of role ``air``, else of role ``ambient``. What is not recorded
    is taken as 20 °C, 1013.25 hPa, 50 %.
    """

    scope = "instrument"
    signals: OptionalNames = ()

    def air(self, machine: Machine) -> tuple[str, ...]:
        """The signals of the air that are read, by name."""
        if self.signals:
            return self.signals
        return tuple(s.name for s in air_signals(machine.signals.values()))

    def check(self, machine: Machine) -> None:
        """At least one signal of the air, each of a unit that says what it is, none twice."""
        super().check(machine)
        names = self.air(machine)
        if not names:
            raise InputError(
                "the machine has no signal of the air",
                field="signals",
                expected="a temperature, pressure or humidity of role air or ambient",
            )
        kinds = [_air_kind(machine.signals[name]) for name in names]
        for name, kind in zip(names, kinds, strict=True):
            if kind is None or kinds.count(kind) > 1:
                raise InputError(
                    "not one temperature, pressure and humidity of the air",
                    field="signals",
                    found=f"{name} in {machine.signals[name].unit}",
                    expected="one each in degC; hPa, mbar, Pa, kPa or bar; %",
                )

    def index(self, machine: Machine, conditions: Conditions) -> F64:
        """Refractive index of the air at each row, shape (n,)."""
        value = {
            "temperature": np.full(conditions.n, STANDARD_TEMPERATURE_C),
            "pressure": np.full(conditions.n, STANDARD_PRESSURE_HPA),
            "humidity": np.full(conditions.n, STANDARD_HUMIDITY),
        }
        for name in self.air(machine):
            signal = machine.signals[name]
            factor = PRESSURES.get(signal.unit, 1.0)
            value[_air_kind(signal) or ""] = conditions.signal(name) * factor
        return refractive_index(value["temperature"], value["pressure"], value["humidity"])

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None of the machine's: an instrument's effects are never folded."""
        return ()


def _air_kind(signal: Signal) -> str | None:
    if signal.temperature:
        return "temperature"
    if signal.unit in PRESSURES:
        return "pressure"
    return "humidity" if signal.unit == "%" else None


def air_signals(signals: Iterable[Signal]) -> list[Signal]:
    """One temperature, pressure and humidity of the air: role ``air``, else ``ambient``."""
    found: dict[str, Signal] = {}
    for role in ("air", "ambient"):
        for signal in signals:
            kind = _air_kind(signal)
            if signal.role == role and kind is not None:
                found.setdefault(kind, signal)
    return list(found.values())


def beam_length(machine: Machine, conditions: Conditions) -> F64:
    """Distance travelled along the measured direction since the set-up's first row, mm, (n,).

    Positive along u; 0 on rows that are no displacements. Conditions without measured directions
    raise `InputError`.
    """
    if conditions.u is None:
        raise InputError("an effect of the instrument needs the measured directions of a campaign")
    chain = Chain(machine, conditions)
    moved = conditions.setup_rows().since_start(chain.to_machine_axes(chain.point))
    length = np.einsum("ni,ni->n", moved, conditions.u)
    return np.where(_of_kind(conditions, Kind.DISPLACEMENT), length, 0.0)


def _rows_of(conditions: Conditions, names: Iterable[str]) -> NDArray[np.bool_]:
    setups = conditions.setup_rows()
    return np.isin(setups.number, [setups.index.get(name, -1) for name in names])


def _of_kind(conditions: Conditions, kind: Kind) -> NDArray[np.bool_]:
    if conditions.kind is None:
        return np.full(conditions.n, kind == Kind.DISPLACEMENT)
    return np.equal(conditions.kind, kind)


def _lasers(coverage: Coverage, *, longest: float = 0.0) -> list[str]:
    """Set-ups of displacements along their own path, at least `longest` mm of it."""
    return [
        name
        for name, seen in coverage.setup_details.items()
        if seen.kinds == {"displacement"} and seen.along > max(longest, seen.across)
    ]


@register
class DeadPath(LaserEffect):
    """Dead path: air between interferometer and the place where it was zeroed, uncompensated.

    The part of the beam that does not change its length still changes its number of waves when the
    air's index changes. The software corrects only the measured displacement, so the zero wanders
    with the weather.

    Formula
        ``value = length·(n(t) − n(t_1))`` on the displacements of the set-ups, n the index of air
        by Ciddor from temperature, pressure and humidity, t_1 the set-up's first row.
    Parameters
    ----------
        length of the dead path in mm, positive where the beam looks along +u; within ±3000 mm. 1 m
        of it gives 0.93 µm/K and 0.27 µm/hPa (with the signs of the index: warmer air makes it
        read less).
    Signals
        Air temperature, pressure and humidity (role ``air`` or ``ambient``); left out of the keys
        they are found by role and unit.
    Typical causes
        Interferometer far from the machine's zero position, zeroed at the far end of the travel.
    Cure
        Interferometer near the zero position, zero there; dead-path correction of the software.
    Source
        Estler, Applied Optics 24/6 (1985), 808-815; Ciddor, Applied Optics 35/9 (1996), 1566-1573.
    """

    kind = "dead_path"
    setups: Names

    @model_validator(mode="before")
    @classmethod
    def _one_setup(cls, keys: object) -> object:
        if isinstance(keys, dict) and "setup" in keys and "setups" not in keys:
            return {("setups" if k == "setup" else k): v for k, v in keys.items()}
        return keys

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The dead path's length."""
        text = "dead path of " + ", ".join(self.setups)
        return (Parameter("length", "mm", (-3000.0, 3000.0), text, extent=True),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``n(t) − n(t_1)`` on the set-ups' displacements."""
        setups = conditions.setup_rows()
        mask = _rows_of(conditions, self.setups) & _of_kind(conditions, Kind.DISPLACEMENT)
        change = setups.since_start(self.index(machine, conditions))
        return (Motion(MEASURED, np.where(mask, change, 0.0)[:, None]),)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[DeadPath]:
        """Where a signal of the air varied: all laser set-ups, as on one stand; then each alone.

        A laser that looks along another axis stands elsewhere: those of each direction, too.
        """
        if not _air_varied(machine, coverage):
            return
        lasers = tuple(
            name
            for name, seen in coverage.setup_details.items()
            if seen.kinds == {"displacement"} and seen.rows > 2
        )
        if len(lasers) > 1:
            yield cls(setups=lasers)
        stands: dict[tuple[float, ...], list[str]] = {}
        for name in lasers:
            stands.setdefault(coverage.setup_details[name].toward, []).append(name)
        for names in stands.values():
            if 1 < len(names) < len(lasers):
                yield cls(setups=tuple(names))
        for name in lasers:
            yield cls(setups=(name,))


@register
class AirRefraction(LaserEffect):
    """Uncompensated wavelength: the laser counts waves of another length than it thinks.

    Formula
        ``value = share/100·L·(n − n_0)``: L the distance travelled along u since the set-up's first
        row (distances: the distance itself), n the index of air by Ciddor, n_0 its value at 20 °C,
        1013.25 hPa and 50 %. A constant other n_0 is a scale error of all axes and is left to
        `scale`.
    Parameters
    ----------
        share in %: 100 where nothing was compensated, 0 where all was, between −150 and 150;
        negative where compensation was applied twice.
    Signals
        Air temperature (−0.93 ppm/K), pressure (+0.27 ppm/hPa), humidity (−0.01 ppm/%).
    Typical causes
        Environmental compensation switched off or with wrong inputs, a sensor of the compensation
        unit that lies in the sun or far from the beam.
    Cure
        Compensation unit on, its sensors in the beam's air; record T, p and humidity with the data.
    Source
        Ciddor, Applied Optics 35/9 (1996), 1566-1573; Stone and Zimmerman, NIST Engineering
        Metrology Toolbox.
    """

    kind = "air_refraction"
    setups: OptionalNames = ()

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The share that was not compensated."""
        return (Parameter("share", "%", (-150.0, 150.0), "uncompensated share of the refraction"),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``L·(n − n_0)`` on displacements and distances."""
        length = beam_length(machine, conditions)
        if conditions.distance is not None:
            far = _of_kind(conditions, Kind.DISTANCE)
            length = length + np.where(far, conditions.distance, 0.0)
        if self.setups:
            length = np.where(_rows_of(conditions, self.setups), length, 0.0)
        column = 0.01 * length * (self.index(machine, conditions) - standard_index())
        return (Motion(MEASURED, column[:, None]),)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[AirRefraction]:
        """All of a campaign's lasers together, by all signals of the air, then each one alone."""
        lengths = any(
            seen.along > 0.0 or "distance" in seen.kinds for seen in coverage.setup_details.values()
        )
        if lengths and _air_varied(machine, coverage):
            yield cls()
            signals = air_signals(recorded(machine, coverage))
            if len(signals) > 1:
                for signal in signals:
                    yield cls(signals=(signal.name,))


def _air_varied(machine: Machine, coverage: Coverage) -> bool:
    return any(s.name in coverage.signals for s in air_signals(machine.signals.values()))


@register
class Cosine(Effect):
    """Cosine error: a beam (or scale, or artefact) that is not parallel to the motion.

    The interferometer sees only the part of the motion along its beam, cos θ ≈ 1 − ½θ² of it.

    Formula
        ``value = −½·θ²·L``, L the distance travelled along u since the set-up's first row: along
        one beam a constant slope, always towards too short. Where the set-up's ``slope`` is free it
        is contained in that.
    Parameters
    ----------
        theta2 = θ² in rad², not negative, below 1e-4 (10 mrad): 1 mm of offset over 1 m of travel
        is 1e-6, half a µm per metre. A negative value is not a cosine error.
    Signals
        None beyond the positions.
    Typical causes
        Beam adjusted over a travel that is too short; thermal or mechanical shift of the tripod.
    Cure
        Adjust the return beam at both ends of the travel for the greatest reading.
    Source
        ISO 230-2 and the interferometers' manuals; Bryan, The Abbe Principle Revisited (1979).
    """

    kind = "cosine"
    scope = "instrument"
    setup: str

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The square of the angle."""
        return (Parameter("theta2", "rad²", (0.0, 1e-4), f"square of the angle, {self.setup}"),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``−½·L`` on the set-up's displacements."""
        mask = conditions.setup_rows().mask(self.setup)
        column = np.where(mask, -0.5 * beam_length(machine, conditions), 0.0)
        return (Motion(MEASURED, column[:, None]),)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None of the machine's: an instrument's effects are never folded."""
        return ()

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[Cosine]:
        """Set-ups of displacements along their own path whose slope is not free."""
        for name in _lasers(coverage, longest=10.0):
            if "slope" not in coverage.setup_details[name].free:
                yield cls(setup=name)
