"""What ``abbe open`` was given: a model with campaigns, a configuration of a run, or nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.toml_source import TomlSource


@dataclass(frozen=True)
class WhatToOpen:
    """What a workbench shows.

    Attributes
    ----------
    config
        The configuration of the run that is seen live; None: whichever runs.
    model
        The model that campaigns are laid beside; None: there is none.
    uploads
        Whether the configuration names a controller that takes tables.
    near
        Folders in which campaigns may lie that nobody named.
    """

    config: Path | None
    model: Path | None
    uploads: bool = False
    near: tuple[Path, ...] = ()


def what_to_open(
    file: Path | None,
    campaigns: Sequence[Path],
    holdout: Sequence[Path] = (),
    versions: Path | None = None,
    tables: Path | None = None,
    calibration: Path | None = None,
) -> WhatToOpen:
    """Tell a model from a configuration by what stands in it.

    Raises
    ------
    InputError
        For a file that cannot be read, a model alone, and what needs campaigns where there are
        none.
    """
    config, model, uploads = None, file, False
    if file is not None:
        source = TomlSource.read(file)
        if str(source.data.get("format", "")).startswith("abbe-config/"):
            config, model = file, None
            uploads = "upload" in source.data
            named = source.data.get("model")
            if isinstance(named, str):
                model = file.parent / named
            elif campaigns:
                raise source.error("names no model", ("model",), found=named)
    if (holdout and not campaigns) or (model is None and versions is not None):
        raise InputError(
            "needs campaigns to be laid beside a model" if holdout else "needs a model",
            field="--holdout" if holdout else "--versions",
            expected="abbe open MODEL.toml CAMPAIGN.csv",
        )
    for option, folder in (("--tables", tables), ("--calibration", calibration)):
        if folder is not None and config is None:
            raise InputError(
                "is of a machine and its controller",
                field=option,
                expected=f"the configuration of a run: abbe open CONFIG.toml {option} FOLDER",
            )
    near = [path for path in (calibration, None if file is None else file.parent) if path]
    return WhatToOpen(config, model, uploads, tuple(near))
