"""The refractive index of air by Ciddor's equations, on which laser interferometers depend.

Ciddor, Applied Optics 35/9 (1996), 1566-1573; the saturation pressure of water vapour is the one
given there (Davis, Metrologia 29 (1992)). Valid from −40 to 100 °C, 80 to 120 kPa, 0 to 100 %
humidity, 300 to 1700 nm; within 5e-8 in normal workshops (2e-8 claimed).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

HENE_UM = 0.6329912
"""Vacuum wavelength of the helium-neon laser, µm."""

STANDARD_TEMPERATURE_C = 20.0
STANDARD_PRESSURE_HPA = 1013.25
STANDARD_HUMIDITY = 50.0

_KELVIN = 273.15
_GAS = 8.314510  # J/(mol K)
_WATER = 0.018015  # kg/mol


def saturation_pressure(temperature: F64) -> F64:
    """Saturation pressure of water vapour over water, Pa, at temperatures of −10 to 100 °C."""
    t = temperature + _KELVIN
    return np.asarray(
        np.exp(1.2378847e-5 * t**2 - 1.9121316e-2 * t + 33.93711047 - 6.3431645e3 / t)
    )


def _compressibility(temperature: F64, pressure: F64, vapour: F64) -> F64:
    """Compressibility of moist air; °C, Pa, molar fraction of water vapour."""
    t, ratio = temperature, pressure / (temperature + _KELVIN)
    first = (
        1.58123e-6
        - 2.9331e-8 * t
        + 1.1043e-10 * t**2
        + (5.707e-6 - 2.051e-8 * t) * vapour
        + (1.9898e-4 - 2.376e-6 * t) * vapour**2
    )
    return 1.0 - ratio * first + ratio**2 * (1.83e-11 - 0.765e-8 * vapour**2)


def _density(temperature: F64, pressure: F64, vapour: F64, molar_mass: float) -> F64:
    """Density of one part of moist air were it alone, kg/m³; °C, Pa, molar fraction, kg/mol."""
    z = _compressibility(temperature, pressure, vapour)
    return pressure * molar_mass / (z * _GAS * (temperature + _KELVIN))


def refractive_index(
    temperature: F64,
    pressure: F64,
    humidity: F64,
    *,
    wavelength_um: float = HENE_UM,
    co2_ppm: float = 450.0,
) -> F64:
    """Phase refractive index of moist air.

    Parameters
    ----------
    temperature, pressure, humidity
        Shapes that broadcast, in °C, hPa and % relative humidity.
    wavelength_um
        Vacuum wavelength, µm.
    co2_ppm
        Carbon dioxide by volume.
    """
    pascal = 100.0 * pressure
    s = wavelength_um**-2.0
    dry = (5792105.0 / (238.0185 - s) + 167917.0 / (57.362 - s)) * 1e-8
    dry *= 1.0 + 0.534e-6 * (co2_ppm - 450.0)
    wet = 1.022e-8 * (295.235 + 2.6422 * s - 0.032380 * s**2 + 0.004028 * s**3)
    enhancement = 1.00062 + 3.14e-8 * pascal + 5.6e-7 * temperature**2
    vapour = enhancement * humidity / 100.0 * saturation_pressure(temperature) / pascal
    molar_mass = 1e-3 * (28.9635 + 12.011e-6 * (co2_ppm - 400.0))
    zero, one = np.zeros(()), np.ones(())
    dry_standard = _density(15.0 * one, 101325.0 * one, zero, molar_mass)
    wet_standard = _density(20.0 * one, 1333.0 * one, one, _WATER)
    of_air = _density(temperature, pascal, vapour, molar_mass) * (1.0 - vapour)
    of_water = _density(temperature, pascal, vapour, _WATER) * vapour
    return np.asarray(1.0 + of_air / dry_standard * dry + of_water / wet_standard * wet)


def standard_index() -> float:
    """Refractive index at 20 °C, 1013.25 hPa, 50 %: what a laser without compensation assumes."""
    one = np.ones(())
    return float(
        refractive_index(
            STANDARD_TEMPERATURE_C * one, STANDARD_PRESSURE_HPA * one, STANDARD_HUMIDITY * one
        )
    )
