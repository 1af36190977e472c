"""The conditions that a laser's software writes beside its readings, and their normalisation.

The maker does not publish the layout of the block ``ENVIRONMENT::``; its lines are kept word for
word, and those whose key says what they are become conditions of the campaign. A software that
knows the material's temperature and coefficient of expansion normalises its readings to 20 °C:
whether it did is not written, and must be said.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.plausible import like_fahrenheit
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_REFERENCE = 20.0
_NUMBER = re.compile(r"[-+]?[0-9]+(?:[.,][0-9]+)?(?:[eE][-+]?[0-9]+)?")
_SIGNALS = (
    ("T_air", re.compile(r"air.*temp|temp.*air", re.IGNORECASE)),
    ("p_air", re.compile(r"press", re.IGNORECASE)),
    ("h_air", re.compile(r"humid", re.IGNORECASE)),
    ("T_material", re.compile(r"(?:material|machine|work|scale).*temp|temp.*material", re.I)),
)
_PRESSURE = re.compile(r"\d\s*(kPa|hPa|Pa|mbar|mmHg|torr|inHg)\b", re.IGNORECASE)
_HECTOPASCALS = {
    "pa": 0.01, "hpa": 1.0, "mbar": 1.0, "kpa": 10.0, "mmhg": 1.33322, "torr": 1.33322,
    "inhg": 33.8639,
}  # fmt: skip
"""Unit of pressure → hPa."""
_EXPANSION = re.compile(r"expan|coeff", re.IGNORECASE)
_LARGEST_OF_UNITY = 1e-3
"""A coefficient below this is in 1/K, above in ppm/K: no material has 1000 ppm/K."""


@dataclass(frozen=True)
class LaserEnvironment:
    """What a file says of the conditions.

    Attributes
    ----------
    lines
        Key → text, as written.
    signals
        Name → mean of the numbers of its lines: T_air, T_material (°C), p_air (hPa), h_air (%); a
        number without a unit as it stands.
    expansion
        Coefficient of expansion, 1/K, where the file tells one.
    """

    lines: Mapping[str, str] = field(default_factory=dict)
    signals: Mapping[str, float] = field(default_factory=dict)
    expansion: float | None = None

    @classmethod
    def read(cls, lines: Mapping[str, str]) -> LaserEnvironment:
        """From the block's lines, key → text."""
        found: dict[str, list[float]] = {}
        expansion = None
        for key, text in lines.items():
            if (number := _NUMBER.search(text)) is None:
                continue
            value = float(number[0].replace(",", "."))
            if _EXPANSION.search(key):
                expansion = value if abs(value) < _LARGEST_OF_UNITY else value * 1e-6
                continue
            for name, words in _SIGNALS:
                if words.search(key):
                    if "T" in name and re.search(r"\d\s*°?\s*F\b", text):
                        value = (value - 32.0) / 1.8
                    if name == "p_air" and (unit := _PRESSURE.search(text)) is not None:
                        value *= _HECTOPASCALS[unit[1].lower()]
                    found.setdefault(name, []).append(value)
                    break
        means = {name: float(np.mean(values)) for name, values in found.items()}
        return cls(dict(lines), means, expansion)


@dataclass(frozen=True)
class Normalisation:
    """What is known of the normalisation of readings to 20 °C.

    Attributes
    ----------
    done
        Whether the readings were normalised; None: not said.
    expansion, temperature
        1/K and °C with which they were; None: as the file says.
    """

    done: bool | None = None
    expansion: float | None = None
    temperature: float | None = None

    def undone(
        self, values: F64, travel: F64, environment: LaserEnvironment, file: str
    ) -> tuple[F64, str]:
        """Readings as the machine was, not as it would be at 20 °C, and what was done, in words.

        A normalised reading lacks the expansion of the machine between its temperature and 20 °C;
        it is added again: ``α·x·(T − 20)``.

        Parameters
        ----------
        values, travel
            Shape (n,): readings and positions, mm.

        Raises
        ------
        InputError
            When the file tells a coefficient and nobody says whether it was used; when it was, and
            coefficient or temperature are not known, or that temperature may be in °F.
        """
        stated = environment.expansion
        if self.done is None:
            if stated:
                raise InputError(
                    "the file tells a coefficient of expansion: its readings may be normalised to "
                    "20 °C",
                    file=file,
                    field="normalised",
                    found=f"{in_digits(stated * 1e6, 4)} ppm/K",
                    expected="--normalised (they are turned back) or --not-normalised",
                )
            return values, "readings taken as not normalised to 20 °C: the file does not say"
        if not self.done:
            return values, "readings not normalised to 20 °C, as stated"
        alpha = stated if self.expansion is None else self.expansion
        known = environment.signals.get("T_material")
        temperature = known if self.temperature is None else self.temperature
        if alpha is None or temperature is None:
            raise InputError(
                "readings that were normalised to 20 °C cannot be turned back without "
                + ("the coefficient of expansion" if alpha is None else "the temperature"),
                file=file,
                field="normalised",
                expected="--expansion (ppm/K)" if alpha is None else "--material-temperature (°C)",
            )
        if self.temperature is None and like_fahrenheit(temperature):
            raise InputError(
                "the material's temperature, with which readings were normalised, may be in °F",
                file=file,
                field="T_material",
                found=f"{in_digits(temperature, 4)}, no unit beside it",
                expected="--material-temperature (°C)",
            )
        back = values + alpha * travel * (temperature - _REFERENCE)
        return back, (
            f"readings were normalised to 20 °C with {in_digits(alpha * 1e6, 4)} ppm/K at "
            f"{in_digits(temperature, 4)} °C; turned back to what the machine did"
        )
