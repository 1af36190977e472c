"""The answer of ``abbe gauges`` as JSON and as text: errors µm, lengths mm."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.corrected import corrected_lengths, corrected_plate
from abbe.compcore.artefacts.measured_length import MeasuredLength
from abbe.compcore.artefacts.plate import MeasuredPlate
from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.artefacts.lengths import read_lengths
from abbe.compcore.files.importers.artefacts.plates import read_plates
from abbe.compcore.files.recognised import PLATE, recognised
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GaugedLength:
    """One length: its error of indication as measured, and with a model's correction, mm."""

    length: MeasuredLength
    before: float
    after: float | None


@dataclass(frozen=True, eq=False)
class GaugedPlate:
    """One placing of a plate; `corrected`: its points with a model's correction, (n, 3), mm."""

    plate: MeasuredPlate
    corrected: F64 | None


@dataclass(frozen=True, eq=False)
class GaugeAnswer:
    """What a file of measured artefacts says, beside a model where one is given."""

    file: str
    model: str | None
    lengths: tuple[GaugedLength, ...]
    plates: tuple[GaugedPlate, ...]


def evaluate(path: Path, model: Model | None, name: str | None, **stated: Any) -> GaugeAnswer:
    """Read measured lengths or plates and lay a model beside them.

    Parameters
    ----------
    name
        The model's file, for people.
    stated
        `reduced`, `unit` and `tool`, as `read_lengths` takes them.

    Raises
    ------
    InputError
        For a bad file, and for what the model needs and the file does not have.
    """
    try:
        if recognised(path) is PLATE:
            plates, _ = read_plates(path, tool=stated.get("tool", (0.0, 0.0, 0.0)))
            corrected = [None if model is None else corrected_plate(p, model) for p in plates]
            both = zip(plates, corrected, strict=True)
            return GaugeAnswer(str(path), name, (), tuple(GaugedPlate(p, c) for p, c in both))
        lengths, _ = read_lengths(path, **stated)
        if not lengths:
            raise InputError("no measured length", file=path)
        after: list[float | None] = [None] * len(lengths)
        if model is not None:
            after = list(corrected_lengths(lengths, model).tolist())
    except InputError as error:
        raise error.at(file=path) from None
    found = [GaugedLength(m, m.error, a) for m, a in zip(lengths, after, strict=True)]
    return GaugeAnswer(str(path), name, tuple(found), ())


def worst(answer: GaugeAnswer) -> tuple[float, float | None]:
    """Greatest |error| of a length (of plates: between two points) before and after, mm."""
    before = [abs(g.before) for g in answer.lengths]
    after = [abs(g.after) for g in answer.lengths if g.after is not None]
    before += [abs(g.plate.worst_length()[2]) for g in answer.plates]
    after += [
        abs(g.plate.worst_length(g.corrected)[2]) for g in answer.plates if g.corrected is not None
    ]
    return max(before), max(after) if after else None


def as_json(answer: GaugeAnswer) -> dict[str, Any]:
    """One object for ``--json``; what is not known is null."""
    before, after = worst(answer)
    return {
        "file": answer.file,
        "model": answer.model,
        "unit": "um",
        "worst_before": before * 1e3,
        "worst_after": None if after is None else after * 1e3,
        "lengths": [
            {
                "position": g.length.position,
                "run": g.length.run,
                "line": g.length.line,
                "calibrated": g.length.calibrated.length,
                "temperature": g.length.temperature,
                "actual": g.length.calibrated.at(g.length.temperature),
                "measured": g.length.measured,
                "before": g.before * 1e3,
                "after": None if g.after is None else g.after * 1e3,
                "sd": g.length.uncertainty * 1e3,
            }
            for g in answer.lengths
        ],
        "plates": [_plate(g) for g in answer.plates],
    }


def _plate(gauged: GaugedPlate) -> dict[str, Any]:
    plate = gauged.plate
    before = plate.errors()
    after = None if gauged.corrected is None else plate.errors(gauged.corrected)
    return {
        "placing": plate.placing,
        "planar": plate.planar,
        "sd": plate.sd * 1e3,
        "before": _summary(plate, None),
        "after": None if gauged.corrected is None else _summary(plate, gauged.corrected),
        "points": [
            {
                "name": name,
                "line": int(plate.line[i]),
                "before": (before[i] * 1e3).tolist(),
                "after": None if after is None else (after[i] * 1e3).tolist(),
            }
            for i, name in enumerate(plate.points)
        ],
    }


def _summary(plate: MeasuredPlate, points: F64 | None) -> dict[str, Any]:
    first, second, length = plate.worst_length(points)
    errors = plate.errors(points)
    return {
        "rms": float(np.sqrt(np.mean((errors**2).sum(axis=1)))) * 1e3,
        "worst": float(np.linalg.norm(errors, axis=1).max()) * 1e3,
        "scale_ppm": plate.scale(points) * 1e6,
        "worst_length": {"from": first, "to": second, "error": length * 1e3},
    }


def as_text(answer: GaugeAnswer) -> Iterator[str]:
    """Lines for people."""
    with_model = answer.model is not None
    if answer.lengths:
        width = max(8, *(len(g.length.position) for g in answer.lengths))
        heads = f"{'':<{width}}  {'calibrated':>12}{'run':>5}{'error':>9}"
        yield heads + (f"{'after':>9}" if with_model else "") + f"{'U (k=2)':>9}"
        for g in answer.lengths:
            text = (
                f"{g.length.position:<{width}}  {g.length.calibrated.length:>12.5f}"
                f"{g.length.run:>5}{g.before * 1e3:>z9.2f}"
            )
            text += "" if g.after is None else f"{g.after * 1e3:>z9.2f}"
            sd = g.length.uncertainty
            yield text + (f"{2e3 * sd:>9.2f}" if sd else f"{'–':>9}")
        yield "  calibrated in mm; errors (measured − calibrated at its temperature) in µm"
    for gauged in answer.plates:
        plate = gauged.plate
        kind = "holes" if plate.planar else "balls"
        yield f"{plate.placing}: {len(plate.points)} {kind}"
        for label, points in (("as measured", None), ("with the model", gauged.corrected)):
            if label == "with the model" and points is None:
                continue
            s = _summary(plate, points)
            far = s["worst_length"]
            yield (
                f"  {label}: beside the placed plate {s['rms']:.2f} µm rms, at most "
                f"{s['worst']:.2f}; scale {s['scale_ppm']:+.2f} ppm; worst length "
                f"{far['error']:+.2f} µm ({far['from']} to {far['to']})"
            )
    before, after = worst(answer)
    text = f"worst length: {before * 1e3:.1f} µm"
    yield text if after is None else f"{text} → {after * 1e3:.1f} µm with {answer.model}"
