"""Commands as an answer prints them: whole, so that they can be typed as they stand."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


def fitting(model: Path, campaigns: Sequence[Path] = ()) -> str:
    """The command that fits a model to campaigns; `CAMPAIGN.csv` where there is none yet."""
    words = ["abbe", "fit", str(model), *(map(str, campaigns) if campaigns else ("CAMPAIGN.csv",))]
    return shlex.join([*words, "-o", str(next_version(model))])


def diagnosing(model: Path, campaigns: Sequence[Path]) -> str:
    """The command that says what a model lacks."""
    return shlex.join(["abbe", "diagnose", str(model), *map(str, campaigns)])


def finding(model: Path) -> str:
    """The command that finds what effects a machine without any has."""
    words = ["abbe", "diagnose", str(model), "CAMPAIGN.csv", "--apply", "-o"]
    return shlex.join([*words, str(next_version(model))])


def checking(config: Path) -> str:
    """The command that says whether a configuration is in order."""
    return shlex.join(["abbe", "check", str(config)])


def uploading(config: Path, *words: str | Path) -> str:
    """The command that uploads a folder of tables, or asks for what `words` say (``--recover``)."""
    return shlex.join(["abbe", "upload", str(config), *map(str, words)])


def calibrating(config: Path, folder: Path) -> str:
    """The command that leads through a calibration, from where it is."""
    return shlex.join(["abbe", "calibrate", str(config), "--folder", str(folder)])


@dataclass(frozen=True)
class Adding:
    """What ``abbe add`` is given beside the effect: the model and the campaigns of a diagnosis.

    `robust`: readings that stand alone are left out of the fit, as they were of the diagnosis;
    `holdout`: campaigns that are not fitted; `renew`: what the model knew before counts, too.
    """

    model: Path
    campaigns: Sequence[Path]
    robust: bool = False
    holdout: Sequence[Path] = ()
    renew: bool = False

    @property
    def fitting(self) -> str:
        """The command that fits the model to the campaigns."""
        return " ".join([fitting(self.model, self.campaigns), *self._how])

    @property
    def _how(self) -> list[str]:
        asked = (("--robust", self.robust), ("--renew", self.renew))
        return [option for option, wanted in asked if wanted]

    def command(self, spec: str) -> str:
        """The command that adds an effect, with the campaign and the next version's name."""
        words = ["abbe", "add", str(self.model), *spec.split(), "--campaign"]
        words += [*map(str, self.campaigns), *self._how]
        words += ["--holdout", *map(str, self.holdout)] if self.holdout else []
        return shlex.join([*words, "-o", str(next_version(self.model))])


def free_name(wanted: Path) -> Path:
    """A name for a file to be written: as wanted, or the next version's where it is taken."""
    return next_version(wanted) if wanted.exists() else wanted


def next_version(model: Path) -> Path:
    """A name that is free beside a model's: ``bridge.toml`` → ``bridge-2.toml``.

    >>> next_version(Path("there/is/no/bridge-7.toml")).name
    'bridge-8.toml'
    """
    stem = re.fullmatch(r"(?P<name>.*?)(?:-(?P<number>[0-9]{1,4}))?", model.stem)
    name, number = (stem["name"], stem["number"]) if stem else (model.stem, None)
    count = int(number or 1) + 1
    while (free := model.with_name(f"{name}-{count}{model.suffix}")).exists():
        count += 1
    return free
