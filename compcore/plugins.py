"""Plugin packages, found by entry point: one that is broken is left out, and costs nobody else.

Whatever a stranger's package does when it is imported (raise, end the program), it is told in one
line, and everything that does not need it goes on.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint
from typing import Any, Generic, TypeVar

logger = logging.getLogger("abbe.plugins")

T = TypeVar("T")
_LONGEST = 300


class BrokenPluginError(Exception):
    """A plugin that cannot be used; its text is one line that names it and says why."""


@dataclass(frozen=True)
class Plugins(Generic[T]):
    """The plugins of one group.

    Attributes
    ----------
    found
        Name that users give → class.
    left_out
        Name of the entry point → why it is not among them.
    """

    found: Mapping[str, type[T]] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)

    def missing(self) -> str:
        """What is to be added to a list of those that exist; empty where none was left out."""
        return f" (left out: {', '.join(self.left_out)})" if self.left_out else ""


def load_plugin(entry: EntryPoint, base: type[T], what: str) -> type[T]:
    """Import the class that an entry point names.

    Parameters
    ----------
    entry
        The entry point.
    base
        What it has to be a subclass of.
    what
        What that is called, for people: ``a controller``.

    Raises
    ------
    BrokenPluginError
        When the import fails in any way, or gives something else.
    """
    try:
        cls: Any = entry.load()
    except (Exception, SystemExit, GeneratorExit) as error:  # noqa: BLE001 - a stranger's package
        why = f"cannot be loaded ({type(error).__name__}: {error})"
        raise BrokenPluginError(f"plugin {entry.value} {_one_line(why)}") from None
    if not (isinstance(cls, type) and issubclass(cls, base)):
        raise BrokenPluginError(
            f"plugin {entry.value} is not {what}: "
            f"expected a subclass of {base.__module__}.{base.__qualname__}"
        )
    return cls


def load_plugins(
    entries: Iterable[EntryPoint],
    base: type[T],
    what: str,
    name_of: Callable[[type[T]], str],
    taken: Collection[str],
) -> Plugins[T]:
    """All plugins of a group; each that is broken is logged and left out.

    Parameters
    ----------
    entries, base, what
        As `load_plugin`.
    name_of
        The name by which users ask for a class.
    taken
        Names that Abbe itself has.
    """
    found: dict[str, type[T]] = {}
    left_out: dict[str, str] = {}
    for entry in entries:
        try:
            cls = load_plugin(entry, base, what)
            name = _name(entry, cls, name_of)
            if name in taken or name in found:
                owner = "Abbe's own" if name in taken else "another plugin's"
                raise BrokenPluginError(f"plugin {entry.value} claims {owner} name {name!r}")
            found[name] = cls
        except BrokenPluginError as error:
            left_out[entry.name] = str(error)
            logger.warning("%s: it is left out", error)
    return Plugins(found, left_out)


def _name(entry: EntryPoint, cls: type[T], name_of: Callable[[type[T]], str]) -> str:
    try:
        name = name_of(cls)
    except AttributeError:
        name = ""
    if not isinstance(name, str) or not name:
        raise BrokenPluginError(f"plugin {entry.value} does not say what it is called")
    return name


def _one_line(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST else line[:_LONGEST] + "…"
