"""Refractive index of air against published values."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.effects.air import refractive_index, saturation_pressure, standard_index


@pytest.mark.parametrize(
    ("temperature", "kilopascal", "refractivity"),
    [
        # Ciddor, Applied Optics 35 (1996): dry air, 633 nm, 450 ppm CO2, (n − 1)·1e8
        (20.0, 80.0, 21458.0),
        (20.0, 100.0, 26824.4),
        (20.0, 120.0, 32191.6),
        (10.0, 100.0, 27774.7),
        (30.0, 100.0, 25937.2),
    ],
)
def test_dry_air_of_ciddor_s_table(temperature, kilopascal, refractivity):
    n = refractive_index(
        np.array(temperature), np.array(10.0 * kilopascal), np.array(0.0), wavelength_um=0.633
    )
    assert (float(n) - 1.0) * 1e8 == pytest.approx(refractivity, abs=0.06)


@pytest.mark.parametrize(
    ("temperature", "humidity", "index"),
    [
        # NIST Engineering Metrology Toolbox's Ciddor equation at 101325 Pa, 633 nm (ref_index)
        (20.0, 20.0, 1.0002716285340578),
        (20.0, 80.0, 1.0002711183472626),
        (60.0, 80.0, 1.0002340241754055),
    ],
)
def test_moist_air_of_nist_s_calculator(temperature, humidity, index):
    n = refractive_index(
        np.array(temperature), np.array(1013.25), np.array(humidity), wavelength_um=0.633
    )
    assert float(n) == pytest.approx(index, abs=4e-10)


def test_sensitivities_that_every_laser_s_manual_names():
    def change(**by):
        at = {"temperature": 20.0, "pressure": 1013.25, "humidity": 50.0}
        moved = {k: v + by.get(k, 0.0) for k, v in at.items()}
        return 1e6 * float(
            refractive_index(*(np.array(v) for v in moved.values()))
            - refractive_index(*(np.array(v) for v in at.values()))
        )

    assert change(temperature=1.0) == pytest.approx(-0.93, abs=0.03)
    assert change(pressure=1.0) == pytest.approx(0.27, abs=0.005)
    assert change(humidity=10.0) == pytest.approx(-0.085, abs=0.01)


def test_saturation_pressure_of_the_steam_tables():
    assert float(saturation_pressure(np.array(20.0))) == pytest.approx(2339.3, rel=1e-3)
    assert float(saturation_pressure(np.array(34.0))) == pytest.approx(5325.0, rel=1e-3)


def test_standard_index():
    assert standard_index() == pytest.approx(1.000271373, abs=1e-9)
