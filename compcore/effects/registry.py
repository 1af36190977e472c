"""The registry: effect kinds by name, built in and from plugin packages.

A plugin package names its effect classes under the entry-point group ``abbe.effects``.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any, TypeVar

from pydantic import ValidationError

from abbe.compcore.effects.base import Effect
from abbe.compcore.plugins import PluginGroup
from abbe.compcore.validation import invalid_key

EFFECT_GROUP = "abbe.effects"
CATALOGUE = "abbe.compcore.effects.catalogue"

FAMILIES: dict[str, str] = {
    "linear.linear_axes": "Geometry of linear axes",
    "linear.periodic": "Geometry of linear axes",
    "linear.reversal": "Geometry of linear axes",
    "linear.two_drives": "Geometry of linear axes",
    "linear.local": "Geometry of linear axes",
    "rotary.location": "Rotary axes and spindle",
    "rotary.motions": "Rotary axes and spindle",
    "rotary.spindle": "Rotary axes and spindle",
    "rotary.held": "Rotary axes and spindle",
    "elastic": "Elastic, not rigid",
    "gravity": "Elastic, not rigid",
    "error_grid": "Measured as a whole",
    "temperature.lengths": "Thermal",
    "temperature.shifts": "Thermal",
    "temperature.angles": "Thermal",
    "events": "Over time",
    "dynamic": "Dynamic",
    "workpiece": "Workpiece",
    "instruments.laser": "Instrument",
    "instruments.readings": "Instrument",
    "instruments.probing": "Instrument",
    "instruments.thermometers": "Instrument",
    "instruments.setup": "Instrument",
    "instruments.gauges": "Instrument",
    "formula": "Formula",
}
"""Module below the folder ``catalogue`` → the catalogue's chapter, in the catalogue's order."""

COMMON: dict[str, str] = {
    "positioning": "linear.linear_axes",
    "straightness": "linear.linear_axes",
    "angular": "linear.linear_axes",
    "squareness": "linear.linear_axes",
    "scale_expansion": "temperature.lengths",
}
"""Kinds that nearly every model holds → their module: found without importing the catalogue."""

_BUILT_IN: dict[str, type[Effect]] = {}


def _own() -> dict[str, type[Effect]]:
    """Abbe's own kinds as far as their families are imported, in the catalogue's order."""
    order = list(FAMILIES)
    kinds = sorted(_BUILT_IN, key=lambda kind: order.index(_module(_BUILT_IN[kind])))
    return {kind: _BUILT_IN[kind] for kind in kinds}


PLUGINS: PluginGroup[Effect] = PluginGroup(
    EFFECT_GROUP, Effect, "kind of effect", own=_own, name_of=lambda cls: cls.kind
)

E = TypeVar("E", bound=type[Effect])


def register(cls: E) -> E:
    """Class decorator: put an effect kind of Abbe's own into the registry.

    Raises
    ------
    ValueError
        When two classes claim one kind.
    """
    if cls.kind in _BUILT_IN:
        raise ValueError(f"effect kind {cls.kind!r} is registered twice")
    _BUILT_IN[cls.kind] = cls
    return cls


@cache
def load_families() -> dict[str, ModuleType]:
    """Import every family of Abbe's own effects: module name → module."""
    return {name: import_module(f"{CATALOGUE}.{name}") for name in FAMILIES}


def effect_kinds() -> dict[str, type[Effect]]:
    """All kinds: built-in ones in catalogue order, then plugins'; broken plugins are left out."""
    load_families()
    return {**_own(), **PLUGINS.plugins().found}


def _module(cls: type[Effect]) -> str:
    return cls.__module__.removeprefix(f"{CATALOGUE}.")


def chapter(cls: type[Effect]) -> str:
    """The catalogue's chapter in which an effect stands; plugins have one of their own."""
    return FAMILIES[_module(cls)] if cls.kind in _BUILT_IN else "From plugin packages"


def effect_class(kind: str) -> type[Effect]:
    """An effect class by its kind.

    Raises
    ------
    InputError
        When there is none, or its plugin cannot be loaded; lists those that exist.
    """
    if kind in COMMON:
        import_module(f"{CATALOGUE}.{COMMON[kind]}")
    if kind not in _BUILT_IN:
        load_families()
    return PLUGINS.get(kind, field="kind")


def make_effect(kind: str, keys: Mapping[str, Any]) -> Effect:
    """An effect from its kind and where-keys as a model file or a command line gives them.

    Raises
    ------
    InputError
        For an unknown kind, an unknown or missing key, a value out of range.
    """
    cls = effect_class(kind)
    try:
        return cls(**keys)
    except ValidationError as error:
        raise invalid_key(error, kind, cls.model_fields) from None
