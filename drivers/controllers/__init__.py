"""Controllers' table dialects, one file each, found by looking; plugins by entry point.

A package adds one by naming its class under the entry-point group ``abbe.controllers``.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

from compcore.errors import InputError
from compcore.machine import Machine
from drivers.controllers.base import (
    CONTROLLER_GROUP,
    Confidence,
    Controller,
    ControllerOptions,
    Trust,
    with_options,
)

__all__ = [
    "Confidence",
    "Controller",
    "ControllerOptions",
    "Trust",
    "controller_class",
    "controller_kinds",
    "make_controller",
]


@cache
def controller_kinds() -> dict[str, type[Controller]]:
    """All dialects by name: Abbe's own in alphabetical order, then plugins'.

    Raises
    ------
    InputError
        For a plugin that is not a controller, or claims a name that is taken.
    """
    found: dict[str, type[Controller]] = {}
    for module in pkgutil.iter_modules(__path__):
        loaded = import_module(f"{__name__}.{module.name}")
        for value in vars(loaded).values():
            if (
                isinstance(value, type)
                and issubclass(value, Controller)
                and value.__module__ == loaded.__name__
                and "name" in vars(value)
            ):
                found[value.name] = value
    found = dict(sorted(found.items()))
    for entry in entry_points(group=CONTROLLER_GROUP):
        cls: Any = entry.load()
        if not (isinstance(cls, type) and issubclass(cls, Controller)):
            raise InputError(
                f"plugin {entry.value} is not a controller",
                field=entry.name,
                expected="a subclass of drivers.controllers.Controller",
            )
        if cls.name in found:
            raise InputError(f"plugin {entry.value} claims a name that is taken", field=cls.name)
        found[cls.name] = cls
    return found


def controller_class(name: str) -> type[Controller]:
    """A dialect by its name.

    Raises
    ------
    InputError
        When there is none; lists those that exist.
    """
    kinds = controller_kinds()
    if name not in kinds:
        raise InputError(
            "unknown controller",
            field="controller",
            found=name,
            expected="one of " + ", ".join(kinds),
        )
    return kinds[name]


def make_controller(
    name: str, machine: Machine, options: Mapping[str, Any] | None = None
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
    return cls(machine, with_options(cls, options or {}))
