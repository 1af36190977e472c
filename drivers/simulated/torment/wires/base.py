"""The base of all wires: opened, ticking, told to go away, closed."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar

from abbe.drivers.simulated.torment.delivery import Delivery
from abbe.drivers.simulated.torment.judge.evidence import AXES, WireLog
from abbe.drivers.simulated.torment.loop import Loop
from abbe.drivers.simulated.torment.machine import TormentMachine

TICK = 0.02
"""s between two looks at what the script wants of the connection itself."""


class TormentWire(ABC):
    """One protocol on one wire, served to ``abbe run``.

    Parameters
    ----------
    loop, machine, log
        Of the trial.
    folder
        For pseudo-terminals' names and description files.
    variant
        One of `VARIANTS`.

    Attributes
    ----------
    links
        Its sections of the configuration. Channels that are read are X, Y, Z, number, beat, status,
        T_x of the link m; those that are written out_X, … , out_status, out_beat, out_echo of
        `write_link`.
    """

    KINDS: ClassVar[tuple[str, ...]]
    """What it can be tormented with."""
    VARIANTS: ClassVar[tuple[str, ...]] = ("plain",)
    BLIND: ClassVar[float] = 0.0
    """See `Promises.blind`."""
    WRITTEN: ClassVar[tuple[str, ...]] = (*AXES, "status", "beat", "echo")
    """What is written."""
    READ: ClassVar[tuple[str, ...]] = (*AXES, "number", "beat", "status", "T_x")
    """What is read."""
    FRAMES: ClassVar[bool] = False
    """Whether its messages are frames, which are lost or come as a whole."""
    write_link = "m"

    def __init__(
        self, loop: Loop, machine: TormentMachine, log: WireLog, folder: Path, variant: str
    ) -> None:
        self.loop = loop
        self.machine = machine
        self.log = log
        self.folder = folder
        self.variant = variant
        self.delivery = Delivery(loop, machine, log, whole_only=self.FRAMES)
        self._cut_by: object = None
        self._closed = False

    @property
    @abstractmethod
    def links(self) -> str:
        """TOML of its links."""

    @abstractmethod
    def open(self) -> None:
        """Begin to serve."""

    @abstractmethod
    def cut(self) -> None:
        """Cut what connections there are, and let nobody in until `mend`."""

    @abstractmethod
    def mend(self) -> None:
        """Let clients in again."""

    @abstractmethod
    def flood(self) -> None:
        """Send something that nobody asked for."""

    def close(self) -> None:
        """End it."""
        self._closed = True
        self.cut()

    def start(self) -> None:
        """Open it and look at the script from now on."""
        self.open()
        self._tick()

    def _tick(self) -> None:
        if self._closed:
            return
        now = time.monotonic()
        active = self.machine.script.active
        cut = active("away", now) or active("reset", now)
        if cut is not None and self._cut_by is not cut:
            self.log.say("!", str(cut))
            self.cut()
            if cut.kind == "reset":
                self.mend()
        elif cut is None and self._cut_by is not None:
            self.mend()
        self._cut_by = cut
        if active("flood", now) and not self.delivery.busy:
            self.flood()
        if active("foreign", now):
            self.machine.overwrite(now)
        self.loop.at(now + TICK, self._tick)

    def refuses_write(self, now: float) -> bool:
        """Whether the script has writes refused."""
        active = self.machine.script.active
        return any(active(k, now) for k in ("write_refused", "refused", "refused_long"))
