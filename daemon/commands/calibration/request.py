"""What a calibration is asked for, and where its files are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from abbe.daemon.config import Configuration


@dataclass(frozen=True)
class CalibrationRequest:
    """A calibration as it was asked for.

    Attributes
    ----------
    configuration
        The machine, its links and instruments.
    folder
        Where the files go.
    time, check_time
        For the measurement, and for the lines that verify it: ``4h``.
    tools
        ``NAME=x,y,z``, mm.
    controller
        Dialect of the program; empty: no program.
    tables
        Dialect of the tables; empty: the machine is corrected live.
    yes
        Whether nobody is asked.
    """

    configuration: Configuration
    folder: Path
    time: str
    check_time: str
    tools: tuple[str, ...]
    controller: str
    tables: str
    yes: bool

    @property
    def config(self) -> Path:
        """The configuration's file."""
        return self.configuration.path

    @property
    def model(self) -> Path:
        """The model that the configuration names."""
        return self.configuration.model_path

    @property
    def instruments(self) -> str:
        """The plan's instruments that the configuration has, comma-separated."""
        names: dict[str, None] = {}
        for name, section in self.configuration.file.instrument.items():
            names |= dict.fromkeys(section.measures or (name,))
        return ",".join(names)

    @property
    def uploads(self) -> bool:
        """Whether tables are made and there is a controller that takes them."""
        return bool(self.tables) and self.configuration.upload is not None

    def file(self, name: str) -> Path:
        """A file of the calibration."""
        return self.folder / name
