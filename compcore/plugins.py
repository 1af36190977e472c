"""Plugin packages, found by entry point: one that is broken is left out, and costs nobody else.

Whatever a stranger's package does when it is imported (raise, end the program), it is reported in
one line, and everything that does not need it goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

from abbe.compcore.errors import InputError

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


class PluginGroup(Generic[T]):
    """Classes of one kind, Abbe's own and those of plugin packages, by the name that users give.

    Parameters
    ----------
    group
        The entry-point group.
    base
        What every class is a subclass of.
    noun
        What one is called, for people: ``controller``.
    own
        Gives Abbe's own by name, those apart that are entry points themselves.
    name_of
        The name by which users ask for a class; None: the entry point's own name, and nothing is
        imported but what is asked for.
    """

    def __init__(
        self,
        group: str,
        base: Any,  # abstract, which mypy does not take for a type
        noun: str,
        *,
        own: Callable[[], Mapping[str, type[T]]] = dict,
        name_of: Callable[[type[T]], str] | None = None,
    ) -> None:
        self.group = group
        self.noun = noun
        self._base: type[T] = base
        self._own = own
        self._name_of = name_of
        self._found: Plugins[T] | None = None

    @property
    def _what(self) -> str:
        return f"{'an' if self.noun[0] in 'aeiou' else 'a'} {self.noun}"

    def entries(self) -> dict[str, EntryPoint]:
        """The installed entry points by name; of two with one name Abbe's own, else the first."""
        found: dict[str, EntryPoint] = {}
        for entry in entry_points(group=self.group):
            if entry.name not in found or entry.value.startswith("abbe."):
                found[entry.name] = entry
        return dict(sorted(found.items()))

    def plugins(self) -> Plugins[T]:
        """All plugins; each that is broken is logged, once, and left out."""
        if self._found is None:
            own = self._own()
            found: dict[str, type[T]] = {}
            left_out: dict[str, str] = {}
            for entry in entry_points(group=self.group):
                try:
                    cls = load_plugin(entry, self._base, self._what)
                    name = _name(entry, cls, self._name_of) if self._name_of else entry.name
                    if name in own or name in found:
                        owner = "Abbe's own" if name in own else "another plugin's"
                        raise BrokenPluginError(
                            f"plugin {entry.value} claims {owner} name {name!r}"
                        )
                    found[name] = cls
                except BrokenPluginError as error:
                    left_out[entry.name] = str(error)
                    import logging

                    logging.getLogger("abbe.plugins").warning("%s: it is left out", error)
            self._found = Plugins(found, left_out)
        return self._found

    def forget(self) -> None:
        """Look for plugins anew when they are next asked for."""
        self._found = None

    def get(self, name: str, *, field: str | None = None) -> type[T]:
        """A class by its name.

        Parameters
        ----------
        name
            What a user gave.
        field
            Where it was given, for the error.

        Raises
        ------
        InputError
            When there is none of that name, or its plugin is broken; lists those that there are.
        """
        own = self._own()
        if name in own:
            return own[name]
        if self._name_of is None:
            entries = self.entries()
            if name in entries:
                try:
                    return load_plugin(entries[name], self._base, self._what)
                except BrokenPluginError as error:
                    raise InputError(str(error), field=field, found=name) from None
            known, missing = [*own, *entries], ""
        else:
            plugins = self.plugins()
            if name in plugins.found:
                return plugins.found[name]
            if name in plugins.left_out:
                raise InputError(plugins.left_out[name], field=field, found=name)
            known, missing = [*own, *plugins.found], plugins.missing()
        raise InputError(
            f"unknown {self.noun}",
            field=field,
            found=name,
            expected="one of " + (", ".join(known) or "none") + missing,
        )


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
