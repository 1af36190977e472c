"""The store contract: what a controller's memory for tables must be able to do, to upload safely.

A store has an *active* set of files, which the controller compensates with, and a *staging area*
beside it. Writing touches the staging area only; one step, `Store.activate`, makes what is staged
active, all of it or nothing. So there is no moment at which a mixture of two tables acts.

A store plugin is one class registered under the entry-point group ``abbe.stores``. Its errors are
those of links (`abbe.drivers.link`): `LinkDownError`, `LinkTimeoutError`, `LinkProtocolError`, and
`RefusedError` where the controller itself says no. After any error of a writing method it is not
known whether the controller did it: the caller reads and decides by what it reads. A store repeats
by itself only what does no harm twice (reads, blocks of the staging area).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from pydantic import BaseModel, ConfigDict

from abbe.compcore.errors import InputError
from abbe.compcore.plugins import PluginGroup
from abbe.drivers.link import LinkConfigError, LinkError

STORE_GROUP = "abbe.stores"

Files = Mapping[str, str]
"""Name → text of a set's files, exactly as the controller's dialect has them."""
Progress = Callable[[float], None]
"""Called with the part of a transfer that is done, 0 to 1."""


class RefusedError(LinkError):
    """The controller understood and refused: busy, protected, checksum wrong, out of memory."""


@dataclass(frozen=True, slots=True)
class Identity:
    """The identity of a controller: name and serial number.

    Attributes
    ----------
    name
        What it calls itself: maker, product, version.
    serial
        Its serial number or the machine's; empty where it tells none.
    """

    name: str
    serial: str = ""


@dataclass(frozen=True, slots=True)
class Readiness:
    """The readiness of a controller for a change of its tables.

    Attributes
    ----------
    idle
        No programme runs and no axis moves.
    referenced
        Positions mean something; tables count from the reference point.
    hindrances
        For people: what speaks against it, empty when nothing does.
    """

    idle: bool
    referenced: bool
    hindrances: tuple[str, ...] = ()

    @property
    def ready(self) -> bool:
        """Whether nothing speaks against it."""
        return self.idle and self.referenced and not self.hindrances


@dataclass(frozen=True, slots=True)
class ShownCorrection:
    """The correction by the active table at one place, as the controller itself shows it.

    Attributes
    ----------
    position
        Axis → indicated or commanded position (where the dialect looks the table up), mm; rotary:
        rad.
    direction
        Axis → 1 upwards, −1 downwards, 0 not known.
    correction
        Axis → what is added to the axis, mm; rotary: rad. By the sign rule of Abbe: compensation =
        −error for a controller that shifts its setpoint; `Store.adds_error` says otherwise.
    """

    position: Mapping[str, float]
    correction: Mapping[str, float]
    direction: Mapping[str, int] = field(default_factory=dict)


class StoreConfig(BaseModel):
    """Base of every store's configuration section; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class Store(ABC):
    """One controller's memory for tables. Every wait is bounded; a lost answer is an error.

    Parameters
    ----------
    name
        For messages.
    config
        Its section of the configuration.
    """

    Config: ClassVar[type[StoreConfig]]
    restart_needed: bool = False
    """Whether the active set acts only after the controller was started anew; `Store.active` then
    tells what will act, `Store.effects` what acts now."""
    adds_error: bool = False
    """Whether `Effect.correction` is +error (a reading is corrected), not −error (a setpoint)."""

    def __init__(self, name: str, config: StoreConfig) -> None:
        self.name = name
        self.config = config

    @property
    def owns(self) -> tuple[str, ...]:
        """What only one process may write to at a time, as `abbe.drivers.resources` spells it."""
        return ()

    @abstractmethod
    async def open(self) -> None:
        """Connect, also anew after `close`; raises `LinkError` when there is nobody."""

    @abstractmethod
    async def close(self) -> None:
        """Disconnect; safe to call twice."""

    @abstractmethod
    async def identity(self) -> Identity:
        """Which controller this is."""

    @abstractmethod
    async def readiness(self) -> Readiness:
        """Whether tables may be changed now."""

    @abstractmethod
    async def active(self, progress: Progress = lambda _: None) -> Files:
        """The files that are active, read from the controller; empty when none are."""

    @abstractmethod
    async def stage(self, files: Files, progress: Progress = lambda _: None) -> None:
        """Write files into the staging area; what is active stays as it is."""

    @abstractmethod
    async def staged(self, progress: Progress = lambda _: None) -> Files:
        """The staging area read back from the controller; empty when it holds nothing whole."""

    @abstractmethod
    async def activate(self, files: Files) -> None:
        """Make what is staged active, if it is these files; all or nothing.

        Raises
        ------
        RefusedError
            When the staging area holds something else; what was active stays active.
        """

    @abstractmethod
    async def discard(self) -> None:
        """Empty the staging area."""

    @abstractmethod
    async def deactivate(self) -> None:
        """Make no table active: the state before the very first upload."""

    async def restart(self) -> None:
        """Start the controller anew so that the active set acts; only where the user allowed it.

        Raises
        ------
        RefusedError
            When nobody allowed it (a person has to do it), or the machine is not idle.
        LinkTimeoutError
            When it is not back in time; the active set stays active.
        """
        raise RefusedError(f"{self.name}: the controller has to be restarted by hand")

    @abstractmethod
    async def effects(self) -> Sequence[ShownCorrection]:
        """What the active table does now, as the controller shows it; empty where it shows none."""


PLUGINS: PluginGroup[Store] = PluginGroup(STORE_GROUP, Store, "store")


def store_class(kind: str) -> type[Store]:
    """Load a store plugin by its name.

    Raises
    ------
    LinkConfigError
        When there is none of that name, or it is not a `Store`; lists those that exist.
    """
    try:
        return PLUGINS.get(kind)
    except InputError as error:
        raise LinkConfigError(str(error)) from None
