"""The configuration as loading a file gives it: checked, links and model at hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.model.model import Model
from abbe.daemon.config.folders import data_folder
from abbe.daemon.config.instruments import only_for_instruments
from abbe.daemon.config.sections.config_file import ConfigFile
from abbe.daemon.config.sections.fleet import FleetSetup
from abbe.daemon.config.sections.http import HttpSetup
from abbe.daemon.config.sections.mqtt import MqttSetup
from abbe.daemon.config.sections.opcua_server import OpcuaServerSetup
from abbe.daemon.config.sections.upload import UploadSetup
from abbe.daemon.guard import GuardLimits
from abbe.drivers.link import Link, LinkConfig


@dataclass(frozen=True, slots=True)
class LinkSetup:
    """One ``[links.NAME]`` section: which driver, and its checked configuration."""

    driver: str
    kind: type[Link]
    config: LinkConfig


@dataclass(frozen=True)
class Configuration:
    """A configuration that was found to fit together.

    Attributes
    ----------
    path
        The file.
    file
        Its sections.
    model
        The model that it names.
    links
        The links by name, not yet made.
    limits
        What the guard allows.
    upload
        Where tables go; None: nowhere.
    http
        Where a run can be looked at over HTTP; None: nowhere.
    mqtt
        The broker that a run publishes to; None: nowhere.
    opcua_server
        Where a run is offered by OPC UA; None: nowhere.
    fleet
        The plant's store that records are uploaded to; None: nowhere.
    """

    path: Path
    file: ConfigFile
    model: Model
    links: Mapping[str, LinkSetup]
    limits: GuardLimits
    upload: UploadSetup | None = None
    http: HttpSetup | None = None
    mqtt: MqttSetup | None = None
    opcua_server: OpcuaServerSetup | None = None
    fleet: FleetSetup | None = None

    @property
    def model_path(self) -> Path:
        """The model file."""
        return self.path.parent / self.file.model

    @property
    def journal_path(self) -> Path | None:
        """Where the journal goes, None: nowhere."""
        name = self.file.journal.file
        return None if name is None else data_folder(self.path) / name

    @property
    def records_path(self) -> Path | None:
        """The database of records, None: none is kept."""
        records = self.file.records
        return None if records is None else data_folder(self.path) / records.file

    @property
    def checks_path(self) -> Path:
        """The file of check measurements."""
        return data_folder(self.path) / self.file.checks.file

    @property
    def control_path(self) -> Path | None:
        """Where a running correction takes requests, None: nowhere."""
        section = self.file.control
        return None if section is None else data_folder(self.path).absolute() / section.socket

    def make_links(self, *, instruments: bool = False) -> dict[str, Link]:
        """The links, made but not opened; channels are known from now on.

        Parameters
        ----------
        instruments
            Whether also those that carry nothing but instruments.
        """
        apart = frozenset() if instruments else only_for_instruments(self.file)
        return {
            name: setup.kind(name, setup.config)
            for name, setup in self.links.items()
            if name not in apart
        }
