"""Preparation of the demo: measure the machine, fit its model."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.files.model_toml.fit_record import recorded
from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.daemon.config.sections.http import HttpSection
from abbe.daemon.demo.configuration import WRITTEN_BY
from abbe.daemon.demo.simulator import measure_bridge
from abbe.daemon.installed import abbe_version
from abbe.daemon.socket_path import check_path

START = Path(__file__).with_name("bridge.toml")
"""The machine and the effects to look for, without parameter values."""

ADDRESS_BEGINS = "http://127.0.0.1:"

Step = Callable[[str], AbstractContextManager[Callable[[str], None]]]
"""Begins a step of a known name; what it gives is called with the step's outcome in a few words."""


@dataclass(frozen=True)
class Workshop:
    """The demo's folder and the files in it."""

    folder: Path

    @property
    def start(self) -> Path:
        """The model before the fit."""
        return self.folder / "model-start.toml"

    @property
    def campaign(self) -> Path:
        """The measurements."""
        return self.folder / "campaign.csv"

    @property
    def model(self) -> Path:
        """The fitted model."""
        return self.folder / "model.toml"

    @property
    def config(self) -> Path:
        """The configuration of the live part."""
        return self.folder / "config.toml"

    @property
    def address(self) -> Path:
        """Where a further browser may enter the workbench."""
        return self.folder / "workbench.txt"

    def forget_address(self) -> None:
        """Take that file away, if it is one of a demo.

        Raises
        ------
        InputError
            When somebody else's file has its name.
        """
        if _begins(self.address, ADDRESS_BEGINS):
            self.address.unlink(missing_ok=True)
        elif self.address.exists():
            raise InputError(
                "is there already and is not of an earlier demo",
                file=self.address,
                expected="a new folder (--out)",
            )

    @property
    def socket_fits(self) -> bool:
        """Whether a Unix socket can be in the folder: its path must be short."""
        try:
            check_path(self.folder.absolute() / HttpSection().socket)
        except InputError:
            return False
        return True

    def require_own(self) -> None:
        """Refuse a folder that holds such files and is not of an earlier demo.

        Raises
        ------
        InputError
            Names the file that would be overwritten.
        """
        files = (self.start, self.campaign, self.model, self.config)
        there = [f for f in files if f.exists() and (not f.is_file() or f.stat().st_size)]
        if there and not _begins(self.config, WRITTEN_BY) and not _same(self.start, START):
            raise InputError(
                "is there already and is not of an earlier demo",
                file=there[0],
                expected="a new folder (--out); --force overwrites it",
            )


def prepare(seed: int, shop: Workshop, step: Step) -> FitResult:
    """Measure the machine with that seed and fit the demo's model to the measurements.

    Nothing is known of the machine but what its instruments show: the campaign file.

    Raises
    ------
    InputError
        When the folder cannot be written.
    AbbeError
        When the measurement fails.
    """
    try:
        shop.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}", file=shop.folder) from None
    write_atomically(shop.start, START.read_bytes())
    with step("Measure the machine: laser, straightness optics, levels") as done:
        measure_bridge(seed, str(shop.campaign))
        model = load_model(shop.start)
        campaign = read_campaign(shop.campaign, model.machine)
        done(f"{campaign.n} readings in {shop.campaign}")
    with step("Fit a model to the measurements") as done:
        result = fit(model, campaign)
        save_model(
            recorded(
                result,
                model,
                date=datetime.now(UTC).isoformat(timespec="seconds"),
                version=abbe_version(),
                noise_floor=None,
            ),
            shop.model,
        )
        count = sum(len(term.values) for term in result.model.terms)
        done(
            f"{len(model.terms)} effects, {count} parameters in {shop.model}; χ² per degree of "
            f"freedom {result.chi2_per_dof:.2f} (1: what is left is noise)"
        )
    return result


def _begins(path: Path, words: str) -> bool:
    try:
        with path.open("rb") as stream:
            return stream.read(len(words)) == words.encode("utf-8")
    except OSError:
        return False


def _same(path: Path, other: Path) -> bool:
    try:
        return path.read_bytes() == other.read_bytes()
    except OSError:
        return False
