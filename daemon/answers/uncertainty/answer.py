"""The answer of ``abbe uncertainty``: an object, JSON, text; lengths µm, angles µrad."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from abbe.compcore.errors import InputError
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.part_file import read_part
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model
from abbe.compcore.planning.instruments import PlannedInstrument
from abbe.compcore.units import in_digits
from abbe.compcore.virtual_cmm.causes import NOT_MEASURED
from abbe.compcore.virtual_cmm.features import PartCharacteristic
from abbe.compcore.virtual_cmm.linear_propagation import LinearPropagation, propagated
from abbe.compcore.virtual_cmm.lowering import LoweringMeasurement, lowering
from abbe.compcore.virtual_cmm.part_program import PartProgram
from abbe.compcore.virtual_cmm.simulation import VirtualMeasurement
from abbe.compcore.virtual_cmm.task_uncertainty import (
    TaskDistribution,
    TaskUncertainty,
    gathered,
)
from abbe.daemon.answers.uncertainty.blocks import block_tasks, unpacked
from abbe.daemon.spreading.spread import SpreadPlace, in_order, spread

_SHOWN = 5
"""Causes of a characteristic that are listed."""
_MEASURES = 3
_MOSTLY = 0.5
"""Part of the variance from which a cause that was not measured is warned about."""


@dataclass(frozen=True, eq=False)
class UncertaintyAnswer:
    """What a part program would find.

    Attributes
    ----------
    model_file, part_file
        Names, for people.
    draws, seed
        Of the Monte-Carlo.
    tasks
        The characteristics.
    linear
        The same by the law of propagation.
    measures
        Measurements that would lower it, the best first.
    notes
        What is to be known before the figures are believed.
    """

    model_file: str
    part_file: str
    model: Model
    program: PartProgram
    draws: int
    seed: int
    tasks: tuple[TaskUncertainty, ...]
    linear: LinearPropagation
    measures: tuple[LoweringMeasurement, ...]
    notes: tuple[str, ...]


def require_possible(model: Path, part: Path) -> VirtualMeasurement:
    """Read model and part, and refuse what cannot be drawn.

    Raises
    ------
    InputError
        Naming the file.
    """
    loaded = load_model(model)
    program = read_part(part, loaded.machine)
    try:
        return VirtualMeasurement(loaded, program)
    except InputError as error:
        of_the_model = error.field in (None, "covariance")
        raise error.at(file=model if of_the_model else part) from None


def evaluate(
    measurement: VirtualMeasurement,
    files: tuple[Path, Path],
    draws: int,
    seed: int,
    place: SpreadPlace,
    instruments: Sequence[PlannedInstrument],
) -> UncertaintyAnswer:
    """Draw, gather, and look for what would lower it."""
    model, part = files
    tasks = block_tasks(model.read_bytes(), part.read_bytes(), seed, draws)
    answers = in_order(spread(tasks, place, "virtual measurements"), len(tasks))
    with threads_for(0):
        found = gathered(measurement, [unpacked(body) for body in answers])
    linear = propagated(measurement)
    program, loaded = measurement.program, measurement.machine.model
    tool = program.styli[program.features[0].stylus].offset
    measures = tuple(lowering(loaded, linear, tool, instruments))[:_MEASURES]
    notes = tuple(_notes(measurement, found))
    return UncertaintyAnswer(
        model.name, part.name, loaded, program, draws, seed, found, linear, measures, notes
    )


def _notes(measurement: VirtualMeasurement, found: Sequence[TaskUncertainty]) -> Iterator[str]:
    machine, program = measurement.machine, measurement.program
    for one in machine.beyond:
        yield f"{one}: it counts as far as the model goes on there"
    for task in found:
        share = sum(row.share or 0.0 for row in task.budget if row.cause.endswith(NOT_MEASURED))
        if share > _MOSTLY:
            yield (
                f"{task.characteristic.name}: {share:.0%} of the variance comes from what the "
                "campaigns did not determine; it counts as wide as it is believable"
            )
    off = [s for s, switch in machine.model.switches.items() if switch != "on"]
    if off:
        yield f"not corrected, as switched: {'; '.join(off)}"
    if program.probe.repeatability == 0.0:
        yield "no repeatability of a touch is stated ([probe] repeatability): it counts as 0"
    needed = [s for s in machine.model.signals_needed() if s in program.signals]
    if needed and not any(program.signals[s].sd for s in needed):
        yield "no uncertainty of the sensors is stated ([signals] sd): they count as right"
    rms = machine.model.fit.get("rms")
    if isinstance(rms, int | float) and math.isfinite(rms):
        yield (
            f"the fit left {in_digits(rms)} µm rms over, noise of its instruments included; "
            "an error of the machine that the model does not have is not in these figures"
        )


def scale(one: PartCharacteristic) -> tuple[float, str]:
    """From mm (rad) to what is shown, and its unit."""
    return (1e6, "µrad") if one.angular else (1e3, "µm")


def as_json(answer: UncertaintyAnswer) -> dict[str, Any]:
    """One object for ``--json``."""
    sd = answer.linear.sd
    return {
        "model": answer.model_file,
        "part": answer.part_file,
        "draws": answer.draws,
        "seed": answer.seed,
        "coverage": 0.95,
        "deviation": "measured - true",
        "characteristics": [_characteristic(t, float(sd[i])) for i, t in enumerate(answer.tasks)],
        "measure_next": [
            {
                "what": m.setup.what,
                "instrument": m.setup.instrument.key,
                "minutes": m.setup.seconds / 60.0,
                "expanded_uncertainty": {
                    t.characteristic.name: {
                        "before": _finite(2.0 * float(m.before[i]) * scale(t.characteristic)[0]),
                        "after": _finite(2.0 * float(m.after[i]) * scale(t.characteristic)[0]),
                    }
                    for i, t in enumerate(answer.tasks)
                },
            }
            for m in answer.measures
        ],
        "notes": list(answer.notes),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _characteristic(task: TaskUncertainty, linear: float) -> dict[str, Any]:
    one = task.characteristic
    factor, unit = scale(one)
    return {
        "name": one.name,
        "what": one.quantity,
        "of": list(one.of),
        "datums": list(one.datums),
        "nominal": task.nominal,
        "nominal_unit": "rad" if one.angular else "mm",
        "unit": unit.replace("µ", "u"),
        "tolerance": None if one.tolerance is None else one.tolerance * factor,
        "of_tolerance": of_tolerance(task),
        "corrected": _distribution(task.corrected, factor),
        "uncorrected": _distribution(task.uncorrected, factor),
        "linear_sd": _finite(linear * factor),
        "budget": [
            {"cause": row.cause, "alone": row.alone * factor, "share": row.share}
            for row in task.budget
        ],
    }


def _distribution(found: TaskDistribution, factor: float) -> dict[str, Any]:
    return {
        "bias": found.bias * factor,
        "sd": found.sd * factor,
        "expanded_uncertainty": found.expanded * factor,
        "of_draws": found.of_draws * factor,
        "interval": [found.low * factor, found.high * factor],
        "histogram": {
            "edges": (np.asarray(found.edges) * factor).tolist(),
            "counts": found.counts.tolist(),
        },
    }


def as_text(answer: UncertaintyAnswer) -> Iterator[str]:
    """Lines for people."""
    width = max(14, *(len(t.characteristic.name) for t in answer.tasks))
    yield (
        f"{answer.program.name or answer.part_file}: measured − true, {answer.draws} virtual "
        "measurements, 95 %"
    )
    yield ""
    yield f"{'':<{width}}{'':>15}{'corrected':>20}{'not corrected':>20}{'of the':>16}"
    heads = f"{'bias':>10}{'U':>10}" * 2
    yield f"{'':<{width}}{'nominal':>15}{heads}{'tolerance':>16}"
    for task in answer.tasks:
        yield _row(task, width)
    yield ""
    yield "what makes it unsure (corrected): alone, standard uncertainty; part of the variance"
    for task in answer.tasks:
        yield from _budget_lines(task, width)
    yield ""
    yield from _measure_lines(answer)
    for note in answer.notes:
        yield f"note: {note}"


def _row(task: TaskUncertainty, width: int) -> str:
    one = task.characteristic
    factor, unit = scale(one)
    nominal = math.degrees(task.nominal) if one.angular else task.nominal
    figures = "".join(
        f"{value * factor:>z10.2f}"
        for found in (task.corrected, task.uncorrected)
        for value in (found.bias, found.expanded)
    )
    part = of_tolerance(task)
    return (
        f"{one.name:<{width}}{nominal:>z12.4f}{' °' if one.angular else ' mm':<3}{figures} "
        f"{unit:<5}{'' if part is None else f'{part:.0%}':>10}"
    )


def of_tolerance(task: TaskUncertainty) -> float | None:
    """Part of the tolerance that the uncertainty takes; None: no tolerance is stated.

    U over the zone's width (ISO 14253-1 takes U off each end); of form and position the upper end
    of what a perfect part would show.
    """
    one = task.characteristic
    if one.tolerance is None:
        return None
    taken = task.corrected.high if one.one_sided else task.corrected.expanded
    return taken / one.tolerance


def _budget_lines(task: TaskUncertainty, width: int) -> Iterator[str]:
    factor, unit = scale(task.characteristic)
    for i, row in enumerate(task.budget[:_SHOWN]):
        name = task.characteristic.name if i == 0 else ""
        share = "" if row.share is None else f"{row.share:>6.0%}"
        if i and (row.alone < 0.02 * task.budget[0].alone):
            return
        yield f"{name:<{width}}  {row.alone * factor:>z8.2f} {unit:<4}{share:>6}  {row.cause}"


def _measure_lines(answer: UncertaintyAnswer) -> Iterator[str]:
    if not answer.measures:
        yield "no measurement of the machine would lower any of them by a twentieth"
        return
    yield "what would lower it most (U by the law of propagation)"
    for m in answer.measures:
        one = answer.tasks[m.helped].characteristic
        factor, unit = scale(one)
        before, after = (2.0 * float(v[m.helped]) * factor for v in (m.before, m.after))
        yield (
            f"  {m.setup.what}, {m.setup.instrument.title} ({m.setup.seconds / 60.0:.0f} min): "
            f"{one.name} {before:.2f} → {after:.2f} {unit}"
        )
