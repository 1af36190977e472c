"""The answer of ``abbe iso230`` as JSON and as text: errors µm or µrad, targets mm or degrees."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import bare_machine, read_campaign
from abbe.compcore.iso230.circular import CircularResult
from abbe.compcore.iso230.diagonals import Diagonals
from abbe.compcore.iso230.evaluate import evaluate_iso230
from abbe.compcore.iso230.positioning import RESULTS, PositioningResult
from abbe.compcore.machine.machine import Machine
from abbe.compcore.units import in_digits

SYMBOLS: Mapping[str, str] = {
    "A": "A", "A_up": "A↑", "A_down": "A↓", "R": "R", "R_up": "R↑", "R_down": "R↓", "E": "E",
    "E_up": "E↑", "E_down": "E↓", "M": "M", "B": "B", "B_mean": "B̄",
}  # fmt: skip
MEANINGS: Mapping[str, str] = {
    "A": "bidirectional accuracy of positioning",
    "R": "bidirectional repeatability of positioning",
    "E": "bidirectional systematic error of positioning",
    "M": "range of the mean bidirectional error",
    "B": "reversal error",
}


@dataclass(frozen=True)
class Evaluation:
    """The evaluation of one campaign file."""

    file: str
    positioning: tuple[PositioningResult, ...]
    diagonals: Diagonals
    campaign: Campaign
    machine: Machine
    circles: tuple[CircularResult, ...] = ()


def evaluate(path: Path, machine: Machine | None = None) -> Evaluation:
    """Read a campaign and evaluate its positioning tests, circles and diagonals.

    Raises
    ------
    InputError
        For a bad file, and when it holds neither.
    """
    machine = machine or bare_machine(path)
    campaign = read_campaign(path, machine)
    found = evaluate_iso230(campaign, machine)
    if not found.positioning and not found.diagonals.diagonals and not found.circles:
        raise InputError(
            "no set-up measures the positioning of one axis, a circle or a diagonal",
            file=path,
            found="set-ups " + ", ".join(campaign.setups),
            expected="rows along one moving axis with u along it, at more than one position",
        )
    return Evaluation(
        str(path), found.positioning, found.diagonals, campaign, machine, found.circles
    )


def display(result: PositioningResult) -> tuple[str, float, str, float]:
    """Unit and factor of errors, unit and factor of targets, for people."""
    if result.runs.unit == "rad":
        return "µrad", 1e6, "°", float(np.rad2deg(1.0))
    return "µm", 1e3, "mm", 1.0


def as_json(evaluation: Evaluation) -> dict[str, Any]:
    """One object for ``--json``; what is not known is null."""
    diagonals = evaluation.diagonals
    return {
        "file": evaluation.file,
        "positioning": [
            {"axis": p.runs.axis, **_result(p), "targets": _targets(p)}
            for p in evaluation.positioning
        ],
        "circles": [_circle(c) for c in evaluation.circles],
        "diagonals": [
            {"direction": d.name, "length": d.length, "slope_ppm": d.slope * 1e6}
            | _result(d.result)
            for d in diagonals.diagonals
        ],
        "E_body": None if diagonals.E_body is None else diagonals.E_body * 1e3,
        "E_face": None if diagonals.E_face is None else diagonals.E_face * 1e3,
        "squareness": [
            {"axes": list(axes), "value": angle * 1e6, "unit": "urad"}
            for axes, angle in diagonals.squareness.items()
        ],
    }


def _circle(circle: CircularResult) -> dict[str, Any]:
    def um(value: float | None) -> float | None:
        return None if value is None else value * 1e3

    return {
        "setup": circle.setup,
        "plane": "".join(circle.plane),
        "radius": circle.radius,
        "centre": list(circle.centre),
        "unit": "um",
        "G": {n: um(v) for n, v in circle.G.items()} | {"both": um(circle.G_both)},
        "H": um(circle.H),
        "F_max": {n: um(v) for n, v in circle.F_max.items()},
        "F_min": {n: um(v) for n, v in circle.F_min.items()},
        "D": um(circle.D),
        "eccentricity": [um(v) for v in circle.eccentricity],
        "full_circle": circle.full,
        "notes": list(circle.notes),
    }


def _circle_lines(circles: Sequence[CircularResult]) -> Iterator[str]:
    def um(value: float | None) -> str:
        return f"{'–' if value is None else format(value * 1e3, 'z.1f'):>8}"

    width = max(len(c.setup) for c in circles) + 4
    heads = ("G ccw", "G cw", "G both", "H", "Fmax", "Fmin", "D")
    yield " " * (width + 2) + "".join(f"{head:>8}" for head in heads)
    for c in circles:
        cells = [
            c.G.get("ccw"), c.G.get("cw"), c.G_both, c.H, max(c.F_max.values()),
            min(c.F_min.values()), c.D,
        ]  # fmt: skip
        name = f"{''.join(c.plane)}  {c.setup}"
        yield (
            f"{name:<{width}}  "
            + "".join(map(um, cells))
            + f"  µm, radius {in_digits(c.radius, 4)} mm"
        )
        for note in c.notes:
            yield f"  {c.setup}: {note}"
    yield "  F and D hold where the instrument's length was calibrated; G and H always"


def _result(result: PositioningResult) -> dict[str, Any]:
    unit, factor, position_unit, _ = display(result)
    numbers = {name: getattr(result, name) for name in RESULTS}
    return {
        "setup": result.runs.setup,
        "unit": unit.replace("µ", "u"),
        "position_unit": {"°": "deg"}.get(position_unit, position_unit),
        **{name: None if v is None else v * factor for name, v in numbers.items()},
        "notes": list(result.notes),
    }


TARGET_COLUMNS: Mapping[str, str] = {
    "mean_up": "x̄↑", "mean_down": "x̄↓", "s_up": "s↑", "s_down": "s↓", "reversal": "B",
    "repeatability_up": "R↑", "repeatability_down": "R↓", "repeatability": "R",
}  # fmt: skip


def _targets(result: PositioningResult) -> list[dict[str, float | None]]:
    _, factor, _, position_factor = display(result)
    columns = {name: finite(getattr(result, name), factor) for name in TARGET_COLUMNS}
    positions = (result.runs.targets * position_factor).tolist()
    return [
        {"position": q, **{name: values[i] for name, values in columns.items()}}
        for i, q in enumerate(positions)
    ]


def finite(values: NDArray[np.float64], factor: float) -> list[float | None]:
    """Numbers times a factor; None for what is not known."""
    return [float(v) * factor if np.isfinite(v) else None for v in values]


def as_text(evaluation: Evaluation) -> Iterator[str]:
    """Lines for people."""
    rows = [(f"{p.runs.axis}  {p.runs.setup}", p) for p in evaluation.positioning]
    if rows:
        yield "Positioning, ISO 230-2"
        yield from _table(rows)
        yield ""
    if evaluation.circles:
        yield "Circles, ISO 230-4"
        yield from _circle_lines(evaluation.circles)
        yield ""
    diagonals = evaluation.diagonals
    if diagonals.diagonals:
        yield "Diagonals, ISO 230-6"
        yield from _table([(f"{d.name}  {d.setup}", d.result) for d in diagonals.diagonals])
        for name, value in (("body", diagonals.E_body), ("face", diagonals.E_face)):
            if value is not None:
                yield f"E of the {name} diagonals: {value * 1e3:.1f} µm"
        for (a, b), angle in diagonals.squareness.items():
            yield f"{a} to {b}: 90° {angle * 1e6:+.1f} µrad (a hint: other errors are in it)"


def _table(rows: Sequence[tuple[str, PositioningResult]]) -> Iterator[str]:
    width = max(len(name) for name, _ in rows)
    notes: dict[tuple[str, ...], list[str]] = {}
    # a combining macron takes no width
    yield " " * (width + 2) + "".join(f"{SYMBOLS[n]:>{8 + (n == 'B_mean')}}" for n in RESULTS)
    for name, result in rows:
        unit, factor, _, _ = display(result)
        values = (getattr(result, key) for key in RESULTS)
        cells = ("–" if v is None else f"{v * factor:z.1f}" for v in values)
        yield f"{name:<{width}}  " + "".join(f"{cell:>8}" for cell in cells) + f"  {unit}"
        notes.setdefault(result.notes, []).append(result.runs.setup)
    for reported, setups in notes.items():
        if reported:
            which = "all" if len(setups) == len(rows) else ", ".join(setups)
            yield f"  {which}: " + "; ".join(reported)
