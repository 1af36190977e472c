"""A block of virtual measurements of a part: what each draw finds, and what each cause adds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model
from abbe.compcore.virtual_cmm import causes
from abbe.compcore.virtual_cmm.drawn_inputs import DrawnInputs, draw
from abbe.compcore.virtual_cmm.elements import basis
from abbe.compcore.virtual_cmm.evaluation import evaluated
from abbe.compcore.virtual_cmm.machine_displacements import UnsureMachine
from abbe.compcore.virtual_cmm.part_program import PartProgram

F64 = NDArray[np.float64]

BLOCK = 250
"""Draws that are made at a time. Part of the definition: sums are formed block by block."""
_ATTRIBUTED = 60
"""Draws of a block in which each cause is also looked at alone."""
_LOBES = 3.0
_REFERENCE = 20.0
"""°C (ISO 1)."""


@dataclass(frozen=True, eq=False)
class MeasuredBlock:
    """What the draws of one block found.

    Attributes
    ----------
    corrected, uncorrected
        Measured less true value of each characteristic, shape (d, c), mm (angles: rad).
    alone
        What every cause does alone, shape (a, g, c): measured less true, of the first draws.
    """

    corrected: F64
    uncorrected: F64
    alone: F64


class VirtualMeasurement:
    """A part program on a machine that is known so well.

    Parameters
    ----------
    model
        The machine's fitted model.
    program
        The part.
    seed
        Draw i is the same for the same seed, whatever else is drawn.

    Attributes
    ----------
    true
        The nominal values, shape (c,), mm (angles: rad).
    causes
        Causes of the corrected machine's uncertainty, in the order of `MeasuredBlock.alone`.

    Raises
    ------
    InputError
        As `UnsureMachine`, and when the nominal features cannot be evaluated.
    """

    def __init__(self, model: Model, program: PartProgram, seed: int = 1) -> None:
        with threads_for(0):
            self.machine = UnsureMachine(model, program)
            self.program, self.seed = program, seed
            self._nominal = program.points
            self._normals = program.normals
            self.true = self._true()
            self._stylus = _stylus_of_points(program)
            self._lobe = _lobe_angles(program)
            self._surface = np.concatenate(
                [np.full(len(f.points), f.surface_sd) for f in program.features]
            )
            self.causes = (*self.machine.causes, *self._own_causes())

    def _true(self) -> F64:
        names = [one.name for one in self.program.characteristics]
        try:
            found = evaluated(self.program, self._nominal[None])[0]
        except np.linalg.LinAlgError:
            found = np.full(len(names), np.nan)
        for name, value in zip(names, found, strict=True):
            if not np.isfinite(value):
                raise InputError(
                    "the points of its features do not determine it", field="characteristics",
                    found=name, expected="points that are not on one line, datums that differ",
                )  # fmt: skip
        return np.asarray(found)

    def _own_causes(self) -> tuple[str, ...]:
        probe, warmth = self.program.probe, self.program.warmth
        known = {
            causes.PART_TEMPERATURE: warmth.temperature_sd * warmth.expansion,
            causes.PART_EXPANSION: warmth.expansion_sd * abs(warmth.temperature - _REFERENCE),
            causes.REPEATABILITY: probe.repeatability,
            causes.TIP: probe.tip,
            causes.LOBING: probe.lobing,
            causes.SURFACE: float(self._surface.max()),
        }
        return tuple(name for name, size in known.items() if size > 0.0)

    def block(self, number: int, draws: int = BLOCK) -> MeasuredBlock:
        """The draws of one block: those from ``number·BLOCK`` on.

        Parameters
        ----------
        draws
            How many of them; the last block of a run may be short.
        """
        first = number * BLOCK
        with threads_for(0):
            drawn = draw(
                self.program, self.machine.parameters, self.seed, range(first, first + draws)
            )
            few = min(draws, _ATTRIBUTED)
            found = self.machine.errors(drawn, few)
            own, swelling = self._own(drawn)
            total = sum(own.values(), np.zeros((draws, *self._nominal.shape)))
            applied = np.broadcast_to(found.applied, found.true.shape)
            indicated = self._nominal + swelling + total - found.true
            corrected = evaluated(self.program, indicated + applied) - self.true
            uncorrected = evaluated(self.program, indicated) - self.true
            everything = {**{name: -part for name, part in found.parts.items()}, **own}
            alone = [self._alone(everything[name], few) for name in self.causes]
            shape = (0, few, len(self.true))
            stacked = np.stack(alone) if alone else np.zeros(shape)
            return MeasuredBlock(corrected, uncorrected, np.moveaxis(stacked, 0, 1))

    def touched(self) -> tuple[NDArray[np.int64], F64, F64]:
        """Of every touch its stylus's number, its angle across it, the surface's sd, each (n,).

        The angle in rad, the standard deviation in mm.
        """
        return self._stylus, self._lobe, self._surface

    def _alone(self, displacement: F64, few: int) -> F64:
        own = np.broadcast_to(displacement, (max(len(displacement), few), *self._nominal.shape))
        return evaluated(self.program, self._nominal + own[:few]) - self.true

    def _own(self, drawn: DrawnInputs) -> tuple[dict[str, F64], F64]:
        """Displacements of the measured points by causes besides the machine, (d, n, 3), mm.

        And what the part's expansion does that is known and not reduced, (n, 3).
        """
        program = self.program
        probe, warmth = program.probe, program.warmth
        along = {
            causes.REPEATABILITY: probe.repeatability * drawn.touches,
            causes.TIP: probe.tip * drawn.tips[:, self._stylus],
            causes.LOBING: probe.lobing
            * np.cos(_LOBES * self._lobe + np.pi * drawn.lobes[:, None]),
            causes.SURFACE: self._surface * drawn.surface,
        }
        found = {k: v[:, :, None] * self._normals for k, v in along.items() if k in self.causes}
        arms = self._nominal - self._nominal.mean(axis=0)
        excess = warmth.temperature - _REFERENCE
        hotter = excess + warmth.temperature_sd * drawn.warmth[:, 0]
        expansion = warmth.expansion + warmth.expansion_sd * drawn.warmth[:, 1]
        known = 1.0 + warmth.expansion * excess
        base = known if warmth.reduced else 1.0
        by_temperature = (1.0 + warmth.expansion * hotter - known) / base
        by_expansion = (expansion - warmth.expansion) * hotter / base
        for name, amount in ((causes.PART_TEMPERATURE, by_temperature),
                             (causes.PART_EXPANSION, by_expansion)):  # fmt: skip
            if name in self.causes:
                found[name] = amount[:, None, None] * arms
        swelling = np.zeros_like(arms) if warmth.reduced else (known - 1.0) * arms
        return found, swelling


def _stylus_of_points(program: PartProgram) -> NDArray[np.int64]:
    names = list(program.styli)
    return np.concatenate([np.full(len(f.points), names.index(f.stylus)) for f in program.features])


def _lobe_angles(program: PartProgram) -> F64:
    """Angle of each touch's direction in the plane across its stylus, (n,), rad."""
    found = []
    for feature in program.features:
        offset = np.array(program.styli[feature.stylus].offset)
        length = float(np.linalg.norm(offset))
        frame = basis(offset / length if length > 0.0 else np.array([0.0, 0.0, 1.0]))
        own = feature.normals @ frame.T
        found.append(np.arctan2(own[:, 1], own[:, 0]))
    return np.concatenate(found)
