"""Arguments of the commands to a running correction, and their asking."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

from abbe.compcore.errors import InputError
from abbe.compcore.model.model import Switch
from abbe.daemon.arguments.assignments import number, split_assignments
from abbe.daemon.control.requests import Request


def asked(config: Path, request: Request) -> dict[str, Any]:
    """The answer of the correction that runs with a configuration.

    Raises
    ------
    AbbeError
        When it has no control socket, nothing runs, or what is asked cannot be.
    """
    from abbe.daemon.control.client import ask

    socket = control_socket(config)
    if socket is None:
        raise InputError(
            "nobody can change what runs with this configuration",
            file=config,
            field="control",
            expected="a section [control] with its socket, before the start",
        )
    return ask(socket, request)


def control_socket(config: Path) -> Path | None:
    """Where a configuration has its run controlled; None where nobody can.

    The rest of the file need not be in order: what runs was read before.

    Raises
    ------
    InputError
        When it cannot be read.
    """
    from abbe.compcore.files.text.toml_source import TomlSource
    from abbe.daemon.config.folders import data_folder
    from abbe.daemon.config.sections.config_file import ControlSection

    source = TomlSource.read(config)
    section = source.data.get("control")
    if not isinstance(section, dict):
        return None
    socket = section.get("socket", ControlSection().socket)
    if not isinstance(socket, str):
        raise source.error("not a path", ("control", "socket"), found=socket)
    return data_folder(config).absolute() / socket


def switch_of(word: str) -> Switch:
    """``on``, ``off`` or ``shown``; raises `InputError`."""
    for switch in get_args(Switch):
        if word == switch:
            found: Switch = switch
            return found
    raise InputError("not a switch", found=word, expected="on, off or shown")


def one_assignment(argument: str, unit: str) -> tuple[str, float]:
    """``T_w=23.4`` → its name and number; raises `InputError`."""
    ((name, text),) = split_assignments([argument]).items()
    return name, number(name, text, unit)
