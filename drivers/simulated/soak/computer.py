"""Faults of the computer that Abbe runs on, begun and ended."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from abbe.drivers.simulated.soak.supervisor import Supervisor
from abbe.drivers.simulated.torment.script import Torment

_BROKEN = 0.3
"""A reload below this amount is one of a broken file."""


class ComputerFaults:
    """Does to a life of Abbe, and to its files, what `COMPUTER_FAULTS` names.

    Parameters
    ----------
    abbe
        Whose life.
    config
        Its configuration; the records lie beside it.

    Attributes
    ----------
    variants
        Texts of the configuration: as it is now, and another that may be reloaded.
    """

    def __init__(self, abbe: Supervisor, config: Path) -> None:
        self._abbe, self._config = abbe, config
        self._records = config.parent / "records.sqlite"
        self._busy_disk: subprocess.Popen[bytes] | None = None
        self.variants: list[str] = []

    def begin(self, kind: str, torment: Torment) -> None:
        """Begin one; Abbe lives."""
        begins: dict[str, Callable[[], None]] = {
            "killed": self._abbe.kill,
            "frozen_process": self._abbe.freeze,
            "hung": self._abbe.freeze,
            "reloaded": lambda: self._reload(torment.amount),
            "disk_full": lambda: self._abbe.fill_disk(True),
            "disk_slow": self._slow_disk,
            "records_damaged": self._damage,
            "clock_jump": lambda: self._abbe.set_clock(torment.amount),
        }
        begins[kind]()

    def over(self, kind: str, torment: Torment) -> None:
        """End one."""
        alive = self._abbe.exit_status is None
        if kind in ("frozen_process", "hung") and alive:
            self._abbe.thaw()
        elif kind == "disk_full" and alive:
            self._abbe.fill_disk(False)
        elif kind == "disk_slow":
            self.calm_disk()
        elif kind == "clock_jump":
            self._abbe.set_clock(0.0)
        elif kind == "reloaded" and torment.amount < _BROKEN:
            self._config.write_text(self.variants[0], encoding="utf-8")

    def calm_disk(self) -> None:
        """Nobody keeps the disk busy any more; safe to call twice."""
        if self._busy_disk is not None:
            self._busy_disk.kill()
            self._busy_disk.wait()
            self._busy_disk = None

    def _reload(self, amount: float) -> None:
        """Other limits than now; a broken file has to change nothing."""
        if amount < _BROKEN:
            text = self.variants[0]
            self._config.write_text(text[: len(text) // 2] + "\n[", encoding="utf-8")
        else:
            self.variants.reverse()
            self._config.write_text(self.variants[0], encoding="utf-8")
        self._abbe.reload()

    def _slow_disk(self) -> None:
        module = "abbe.drivers.simulated.soak.busy_disk"
        self._busy_disk = subprocess.Popen(
            [sys.executable, "-m", module, str(self._config.parent), str(self._records)],
            stderr=subprocess.DEVNULL,
        )

    def _damage(self) -> None:
        if self._records.exists() and (size := self._records.stat().st_size) > 20_000:
            with self._records.open("r+b") as file:
                file.seek(size // 2)
                file.write(os.urandom(8192))
