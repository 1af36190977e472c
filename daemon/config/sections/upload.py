"""The section ``[upload]``: where tables go, what is allowed. ``docs/upload.md`` is its page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, ValidationError

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.daemon.config.folders import data_folder
from abbe.daemon.config.sections.section import Section
from abbe.drivers.link import LinkConfigError
from abbe.drivers.stores.base import Store, StoreConfig, store_class

if TYPE_CHECKING:
    from abbe.compcore.machine.machine import Machine
    from abbe.drivers.controllers import Controller

Positive = Annotated[float, Field(gt=0.0, le=1e5, allow_inf_nan=False)]
"""µm, µrad, s: no table, and nothing that is waited for, is larger."""


class UploadSection(Section):
    """What is uploaded to which controller, and within which bounds."""

    store: dict[str, Any]
    """The controller's memory: ``driver`` names the store, the other keys are its own."""
    controller: str
    """Dialect of the tables, as in ``abbe table --controller``."""
    options: dict[str, Any] = Field(default_factory=dict)
    """Options of the dialect, as in ``abbe table --set``."""
    identity: str
    """What the controller has to call itself."""
    serial: str = ""
    """Its serial number; empty: none is compared."""
    max_entry_um: Positive
    """Largest entry of a table of lengths."""
    max_entry_urad: Positive | None = None
    """Largest entry of a table of angles; none: tables of angles are refused."""
    max_slope_um_per_mm: Positive = 5.0
    """Steepest rise between two neighbouring points of a table of lengths."""
    max_correction_um: Positive | None = None
    """Longest correction anywhere in the travels; default the guard's."""
    max_change_um: Positive
    """Largest difference between the new and the present correction anywhere in the travels."""
    effect_tolerance_um: Positive = 1.0
    """How far the correction that the controller shows may be from that of the table."""
    effect_looks: Annotated[int, Field(ge=1, le=1000)] = 5
    """How often it is looked at."""
    effect_every: Annotated[float, Field(ge=0.0, le=60.0)] = 0.2
    """s from one look to the next."""
    patience: Positive = 30.0
    """s for which a silent controller is sought when something has to be put right."""
    step_timeout: Positive = 900.0
    """s that one step may take."""
    journal: str = "uploads.jsonl"
    """Path relative to the configuration (of a service: to its state folder)."""
    backups: str = "backups"
    """Folder, relative likewise."""


@dataclass(frozen=True)
class UploadSetup:
    """An ``[upload]`` section that was found to fit.

    Attributes
    ----------
    section
        As it stands in the file.
    driver, kind, config
        Which store, and its checked configuration.
    journal, backups
        Paths.
    max_correction_um
        As stated, or what the guard allows.
    """

    section: UploadSection
    driver: str
    kind: type[Store]
    config: StoreConfig
    journal: Path
    backups: Path
    max_correction_um: float

    def make_store(self) -> Store:
        """The store, not yet open."""
        return self.kind(f"store {self.driver}", self.config)

    def make_controller(self, machine: Machine) -> Controller:
        """The dialect with its options."""
        from abbe.drivers.controllers import make_controller

        return make_controller(self.section.controller, machine, self.section.options)


def upload_setup(
    source: TomlSource, section: UploadSection, machine: Machine, guard_norm: float
) -> UploadSetup:
    """Check a section against what is installed.

    Parameters
    ----------
    source
        The file, for the places of errors.
    section
        Its section.
    machine
        The model's machine.
    guard_norm
        Longest correction that the guard allows, mm.

    Raises
    ------
    InputError
        The first thing that is wrong.
    """
    path = ("upload", "store")
    rest = dict(section.store)
    driver = rest.pop("driver", None)
    if not isinstance(driver, str):
        raise source.error(
            "a store needs its driver", (*path, "driver"), found=driver, expected='e.g. "modbus"'
        )
    try:
        kind = store_class(driver)
        folder = {"folder": Path(source.file or ".").parent}
        config = kind.Config.model_validate(rest, context=folder)
    except LinkConfigError as error:
        raise source.error(str(error), (*path, "driver")) from None
    except ValidationError as error:
        raise source.invalid(error, path) from None
    base = data_folder(Path(source.file or "."))
    setup = UploadSetup(
        section,
        driver,
        kind,
        config,
        base / section.journal,
        base / section.backups,
        section.max_correction_um or guard_norm * 1e3,
    )
    try:
        setup.make_controller(machine)
    except InputError as error:
        key = ("upload", "controller") if error.field == "controller" else ("upload", "options")
        raise source.error(
            error.problem, key, found=error.found or error.field, expected=error.expected
        ) from None
    return setup
