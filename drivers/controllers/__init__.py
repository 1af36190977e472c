"""Controllers' table dialects, one file each, found by looking; plugins by entry point.

A package adds one by naming its class under the entry-point group ``abbe.controllers``.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from typing import Any

from abbe.compcore.machine.machine import Machine, OfMachine, machine_of
from abbe.compcore.plugins import PluginGroup
from abbe.drivers.controllers.base import (
    CONTROLLER_GROUP,
    Cannot,
    Confidence,
    Controller,
    ControllerOptions,
    Trust,
    with_options,
)

__all__ = [
    "Cannot",
    "Confidence",
    "Controller",
    "ControllerOptions",
    "Trust",
    "controller_class",
    "controller_kinds",
    "make_controller",
]


@cache
def _built_in() -> dict[str, type[Controller]]:
    """Abbe's own dialects by name, in alphabetical order."""
    found: dict[str, type[Controller]] = {}
    for module in pkgutil.walk_packages(__path__, f"{__name__}."):
        loaded = import_module(module.name)
        for value in vars(loaded).values():
            if (
                isinstance(value, type)
                and issubclass(value, Controller)
                and value.__module__ == loaded.__name__
                and "name" in vars(value)
            ):
                found[value.name] = value
    return dict(sorted(found.items()))


PLUGINS: PluginGroup[Controller] = PluginGroup(
    CONTROLLER_GROUP, Controller, "controller", own=_built_in, name_of=lambda cls: cls.name
)


def controller_kinds() -> dict[str, type[Controller]]:
    """All dialects by name: Abbe's own in alphabetical order, then plugins'.

    A plugin that cannot be loaded is reported in one line (the log) and left out.
    """
    return {**_built_in(), **PLUGINS.plugins().found}


def controller_class(name: str) -> type[Controller]:
    """A dialect by its name.

    Raises
    ------
    InputError
        When there is none, or its plugin cannot be loaded; lists those that exist.
    """
    return PLUGINS.get(name, field="controller")


def make_controller(
    name: str, machine: Machine | OfMachine, options: Mapping[str, Any] | None = None
) -> Controller:
    """A dialect for a machine.

    Parameters
    ----------
    name
        What ``--controller`` takes.
    options
        What ``--set`` gives: texts or numbers.

    Raises
    ------
    InputError
        For an unknown name or option.
    """
    cls = controller_class(name)
    return cls(machine_of(machine), with_options(cls, options or {}))
