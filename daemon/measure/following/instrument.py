"""An instrument while it measures: its readings, its beam, and the errors that they mean."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.planned_setup import PlannedSetup, nominal_tip, tip_at
from abbe.daemon.config.channels import split
from abbe.daemon.config.instruments import ANGLES, LENGTHS
from abbe.daemon.config.sections.measure import InstrumentSection
from abbe.daemon.pipeline.reading.poll import Batch
from abbe.drivers.link import Quality

F64 = NDArray[np.float64]

_LOOK = 0.25
"""s of a look at most; more, and it was this computer that was busy."""
_UNREADABLE = 2
"""Looks in a row with an answer that is no number from which on that is a lost beam."""


class Instrument:
    """One instrument of the configuration.

    Parameters
    ----------
    name
        Of its section.
    section
        Its section.
    unit
        Of its channels; empty where it has none.
    machine
        Whose functional point it follows; None: one that X, Y and Z alone lead.

    Attributes
    ----------
    unit
        As given.
    channels
        What is read for it.
    values
        Its last readings in mm or rad, with their sign, one for each source; empty where it has
        none that is fresh.
    time
        Monotonic time of the oldest of them, s.
    problem
        Why it has none; empty when it has.
    interruptions
        How often it has been interrupted: beam lost, link lost.
    restarts
        How often it may have been switched off meanwhile: link lost, or silent for long.
    """

    def __init__(
        self, name: str, section: InstrumentSection, unit: str, machine: Machine | None = None
    ) -> None:
        self.name = name
        self._machine = machine
        self.section = section
        self.unit = unit
        self.angle = unit in ANGLES
        self._factor = section.sign * (ANGLES[unit] if self.angle else LENGTHS[unit or "mm"])
        self._sources = tuple(split(source) for source in section.sources)
        self._beam = None if section.beam is None else split(section.beam)
        self.channels = (*self._sources, *([] if self._beam is None else [self._beam]))
        self.values: tuple[float, ...] = ()
        self.time = -math.inf
        self.problem = "not read yet"
        self.interruptions = 0
        self.restarts = 0
        self._reconnects: int | None = None
        self._missing = 0
        self._away = 0.0
        self._silent = 0.0
        self._looked = -math.inf
        self._there = False

    @property
    def channel(self) -> str:
        """What it is read from, for people."""
        return ", ".join(self.section.sources)

    @property
    def there(self) -> bool:
        """Whether it has been read since it was interrupted last."""
        return self._there

    def take(self, batch: Batch, now: float, reconnects: int) -> None:
        """Take a look's samples in.

        Parameters
        ----------
        now
            Monotonic, s.
        reconnects
            How often its links have come back so far.
        """
        if self._reconnects is not None and reconnects != self._reconnects:
            self.restarts += 1
            if self._there:
                self._interrupted()
        self._reconnects = reconnects
        problem, lost, answers = "", False, False
        if self._beam is not None:
            link, name = self._beam
            sample = batch[link][name]
            if not sample.good:
                problem = sample.reason or sample.quality.value
            elif sample.value == 0.0:
                problem, lost, answers = "no beam", True, True
        for link, name in self._sources:
            sample = batch[link][name]
            if not problem and not sample.good:
                problem = sample.reason or sample.quality.value
                # an answer without a number is all that some instruments say of a lost beam
                answers = sample.quality is Quality.BAD
                lost = answers and self._missing >= _UNREADABLE
            elif not problem and now - sample.time > self.section.stale_after:
                problem = f"its reading is {now - sample.time:.1f} s old"
        self.problem = problem
        if problem:
            self.values = ()
            self._missing += 1
            # who was away for so long may have been switched off; if it was us who were, it counts
            # as one look
            look = min(now - self._looked, _LOOK)
            self._away += look
            self._looked = now
            before = self._silent
            self._silent = 0.0 if answers else before + look
            if before <= self.section.stale_after < self._silent:
                self.restarts += 1
            if self._there and (lost or self._away > self.section.stale_after):
                self._interrupted()
            return
        self._missing, self._away, self._silent = 0, 0.0, 0.0
        self._looked = now
        self._there = True
        samples = [batch[link][name] for link, name in self._sources]
        self.values = tuple(self._factor * s.value for s in samples)
        self.time = min((s.time for s in samples), default=now)

    def wait(self, now: float) -> None:
        """Note that it has not answered yet; a reading that is too old is none."""
        if not self.problem and now - self.time > self.section.stale_after:
            self.problem, self.values = f"its reading is {now - self.time:.1f} s old", ()

    def _interrupted(self) -> None:
        self.interruptions += 1
        self._there = False

    def check(self, setup: PlannedSetup) -> None:
        """Refuse a set-up that it cannot read.

        Raises
        ------
        InputError
            Naming the set-up and what does not fit.
        """
        wrong = ""
        components = setup.u.shape[1]
        if not self.section.linked:
            return
        if len(self._sources) != components:
            wrong = f"it has {len(self._sources)} channels, and {components} directions are read"
        elif self.angle != (setup.kind == Kind.ROTATION):
            wrong = f"its unit is not that of a {setup.kind.name.lower()}"
        elif (self.section.reads == "distance") and setup.kind != Kind.DISTANCE:
            wrong = (
                'it reads distances, and the plan wants errors there: reads = "error", what it '
                "shows less what it should"
            )
        elif self.section.reads == "error" and setup.kind == Kind.DISTANCE:
            wrong = 'it reads errors, and the plan wants distances there: reads = "distance"'
        elif self.section.reads == "length" and setup.kind == Kind.ROTATION:
            wrong = 'an angle is read as error (reads = "error")'
        elif self.section.reads == "length" and any(
            is_rotary(a) and (np.ptp(q) > 0.0 or q.any()) for a, q in setup.targets.items()
        ):
            wrong = "where rotary axes turn only errors can be read, no lengths"
        elif self.section.reads == "length" and not {"zero"} & set(setup.free):
            wrong = "a length counts from any zero, and the set-up's zero is not free"
        elif self.section.reads == "length" and float(np.ptp(setup.u, axis=0).max()) > 1e-9:
            wrong = "a length is read along one direction, and the plan wants several"
        if wrong:
            raise InputError(
                f"instrument {self.name} cannot read set-up {setup.name}: {wrong}",
                field=f"instrument.{self.name}",
            )

    def sd(self, setup: PlannedSetup, target: int) -> float:
        """Standard uncertainty of its reading at a target, mm or rad: its own, else the plan's."""
        if self.section.sd is None:
            return float(setup.sd[target])
        return self.section.sd * (1e-6 if self.angle else 1e-3)

    def deviations(self, setup: PlannedSetup, positions: Mapping[str, float]) -> tuple[float, ...]:
        """What its present readings differ from nominal at a place, mm or rad, by direction.

        Of lengths but for the zero of the set-up; of errors the readings themselves.
        """
        nominal = self.nominal(setup, positions)
        return tuple(v - w for v, w in zip(self.values, nominal, strict=True))

    def nominal(self, setup: PlannedSetup, positions: Mapping[str, float]) -> tuple[float, ...]:
        """What it would read of a perfect machine at a place, mm or rad, by direction.

        Of lengths but for the zero of the set-up; of errors nothing.
        """
        if self.section.reads in ("error", "file"):
            return (0.0,) * len(self._sources)
        if setup.kind == Kind.DISTANCE:
            return (self.nominal_distance(setup, positions),) * len(self._sources)
        u = setup.u[0] / np.linalg.norm(setup.u[0], axis=1)[:, None]
        return tuple(float(w) for w in u @ self._point(setup, positions))

    def nominal_distance(self, setup: PlannedSetup, positions: Mapping[str, float]) -> float:
        """From a set-up's base point to where positions put the functional point, mm."""
        return float(np.linalg.norm(self._point(setup, positions) - np.asarray(setup.base)))

    def _point(self, setup: PlannedSetup, positions: Mapping[str, float]) -> F64:
        at = {a: np.array([q]) for a, q in positions.items()}
        if self._machine is None:
            return np.asarray(nominal_tip(at, setup.offset)[0])
        return np.asarray(tip_at(self._machine, at, setup.offset)[0])
