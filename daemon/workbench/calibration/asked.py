"""What a calibration is asked for on the page *Calibrate*, as it is kept in its folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any


@dataclass(frozen=True)
class AskedCalibration:
    """What a calibration is asked for, as `CalibrationRequest` has it."""

    time: str = "4h"
    check_time: str = "1h"
    tools: tuple[str, ...] = ()
    controller: str = ""
    tables: str = ""

    def words(self) -> dict[str, str]:
        """As text, to be kept."""
        return vars(self) | {"tools": " ".join(self.tools)}

    @classmethod
    def kept(cls, words: Mapping[str, str]) -> AskedCalibration:
        """What was kept."""
        known = {f.name for f in fields(cls)}
        found: dict[str, Any] = {k: v for k, v in words.items() if k in known}
        return cls(**found | {"tools": tuple(words.get("tools", "").split())})
