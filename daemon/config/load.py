"""Loading a configuration: file → sections → links and model, everything cross-checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.daemon.config.checks import check
from abbe.daemon.config.configuration import Configuration, LinkSetup
from abbe.daemon.config.files import check_files
from abbe.daemon.config.sections.config_file import ConfigFile
from abbe.daemon.config.sections.fleet import fleet_setup
from abbe.daemon.config.sections.http import http_setup
from abbe.daemon.config.sections.mqtt import mqtt_setup
from abbe.daemon.config.sections.opcua_server import opcua_server_setup
from abbe.daemon.config.sections.upload import upload_setup
from abbe.daemon.guard import GuardLimits
from abbe.drivers.link import Link, LinkConfigError, link_class


def load_config(path: str | Path) -> Configuration:
    """Read and check a configuration; nothing is opened.

    Raises
    ------
    InputError
        The first thing that is wrong: file, line, key, what was found and what was expected.
    """
    source = TomlSource.read(path)
    try:
        file = ConfigFile.model_validate(source.data)
    except ValidationError as error:
        raise source.invalid(error) from None
    links = {name: _link(source, name, section) for name, section in file.links.items()}
    model_path = Path(path).parent / file.model
    if not model_path.is_file():
        raise source.error(
            "no such model file", ("model",), found=str(model_path), expected="a path to a model"
        )
    model = load_model(model_path)
    upload = None
    if file.upload is not None:
        upload = upload_setup(source, file.upload, model.machine, file.guard.norm)
    turning = tuple(a for a in model.machine.structure.rotary if a in file.output.axes)
    limits = _limits(source, file, turning)
    http = None if file.http is None else http_setup(source, Path(path), file.http)
    mqtt = None
    if file.mqtt is not None:
        mqtt = mqtt_setup(source, Path(path), file.mqtt, model.machine.name)
    opcua = None
    if file.opcua_server is not None:
        opcua = opcua_server_setup(source, Path(path), file.opcua_server)
    fleet = None
    if file.fleet is not None:
        kept, name = file.records is not None, model.machine.name
        fleet = fleet_setup(source, Path(path), file.fleet, name, records=kept)
    configuration = Configuration(
        Path(path), file, model, links, limits, upload, http, mqtt, opcua, fleet
    )
    made = {name: _made(source, name, setup) for name, setup in links.items()}
    check(source, configuration, made)
    check_files(source, configuration)
    return configuration


def _link(source: TomlSource, name: str, section: Mapping[str, Any]) -> LinkSetup:
    path = ("links", name)
    if not name or "." in name:
        raise source.error("not the name of a link", path, found=name, expected="a word")
    rest = dict(section)
    driver = rest.pop("driver", None)
    if not isinstance(driver, str):
        raise source.error(
            "a link needs its driver", (*path, "driver"), found=driver, expected='e.g. "modbus"'
        )
    try:
        kind = link_class(driver)
    except LinkConfigError as error:
        raise source.error(str(error), (*path, "driver")) from None
    try:
        # paths in a link's section are relative to the configuration
        folder = {"folder": Path(source.file or ".").parent}
        return LinkSetup(driver, kind, kind.Config.model_validate(rest, context=folder))
    except ValidationError as error:
        raise source.invalid(error, path) from None


def _made(source: TomlSource, name: str, setup: LinkSetup) -> Link:
    try:
        return setup.kind(name, setup.config)
    except LinkConfigError as error:
        raise source.error(str(error), ("links", name, *error.field)) from None


def _limits(source: TomlSource, file: ConfigFile, turning: tuple[str, ...]) -> GuardLimits:
    guard = file.guard
    if isinstance(guard.max_turn, dict):
        for axis in guard.max_turn:
            if axis not in turning:
                raise source.error(
                    "no rotary axis of that name is corrected",
                    ("guard", "max_turn", axis),
                    found=axis,
                    expected="one of " + (", ".join(turning) or "none"),
                )
    for axis in turning:
        if guard.turn(axis) is None:
            raise source.error(
                f"{axis} is corrected, and nobody has said by how much at most",
                ("guard", "max_turn"),
                expected="degrees, for all rotary axes alike or { " + f"{axis} = 0.02 }}",
            )
        if guard.max_turn_rate is None:
            raise source.error(
                f"{axis} is corrected, and nobody has said how fast that may change",
                ("guard", "max_turn_rate"),
                expected="degrees/s",
            )
    try:
        return GuardLimits(
            max_correction=guard.vector,
            max_norm=guard.norm,
            max_rate=guard.max_rate,
            hold=guard.hold,
            ramp=guard.ramp,
            longest_step=guard.stale_after,
            turning=turning,
            max_turn=tuple(math.radians(guard.turn(axis) or 0.0) for axis in turning),
            max_turn_rate=math.radians(guard.max_turn_rate or 0.0),
        )
    except ValueError as error:
        key = "max_turn_rate" if "max_turn_rate" in str(error) else "max_rate"
        raise source.error(str(error), ("guard", key)) from None
