"""Maximum permissible errors as ISO 10360-1 writes them: ``A + L/K``, at most ``B``."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from abbe.compcore.errors import InputError
from abbe.compcore.units import in_digits

_NUMBER = r"(\d+(?:\.\d*)?|\.\d+)"
_LINE = re.compile(rf"{_NUMBER}(?:\+{_NUMBER}?\*?L/{_NUMBER})?", re.ASCII)
_CAPPED = re.compile(r"min\((.+?)[,;](.+)\)", re.ASCII)
_MOST = 1e4
"""µm beyond which nobody states a length measurement error."""


@dataclass(frozen=True, slots=True)
class PermissibleError:
    """A maximum permissible error of length measurement, E_L,MPE.

    Attributes
    ----------
    constant
        A, mm.
    per_length
        1/K, mm/mm.
    most
        B, mm; infinite where none is stated.
    """

    constant: float
    per_length: float = 0.0
    most: float = math.inf

    def at(self, length: float) -> float:
        """The permissible error at a length (mm), either way, mm.

        >>> round(PermissibleError(1.9e-3, 1 / 300e3).at(600.0), 7)
        0.0039
        """
        return min(self.constant + length * self.per_length, self.most)

    @classmethod
    def parse(cls, text: str, field: str = "mpe") -> PermissibleError:
        """Read ``1.9``, ``1.9 + L/300``, ``1.9 + 3L/1000`` or ``min(1.9 + L/300, 5)``.

        The result in µm where L is in mm, as makers state it.

        Raises
        ------
        InputError
            For anything else, and for what no machine has.
        """

        def wrong(problem: str) -> InputError:
            return InputError(
                problem,
                field=field,
                found=text,
                expected="µm with L in mm: 1.9, 1.9+L/300, 1.9+3L/1000 or min(1.9+L/300, 5)",
            )

        bare = re.sub(r"\s+", "", text).replace("±", "").replace("−", "-")
        most = math.inf
        if (capped := _CAPPED.fullmatch(bare)) is not None:
            bare = capped[1]
            if re.fullmatch(_NUMBER, capped[2]) is None:
                raise wrong("not a maximum permissible error")
            most = float(capped[2])
        found = _LINE.fullmatch(bare)
        if found is None:
            raise wrong("not a maximum permissible error")
        constant = float(found[1])
        slope = 0.0
        if found[3] is not None:
            if float(found[3]) == 0.0:
                raise wrong("a length divided by nothing")
            slope = float(found[2] or 1.0) / float(found[3])
        if constant + slope == 0.0 or not most > 0.0 or constant > _MOST or slope > 1.0:
            raise wrong("not believable")
        return cls(constant * 1e-3, slope * 1e-3, most * 1e-3)

    def __str__(self) -> str:
        text = f"{self.constant * 1e3:g}"
        if self.per_length:
            text += f" + L/{in_digits(1e-3 / self.per_length, 4)}"
        if math.isfinite(self.most):
            text = f"min({text}, {self.most * 1e3:g})"
        return f"±({text}) µm, L in mm"
