"""The answer of ``abbe error-map``: a plane's errors and their ±, as JSON, text and CSV."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.error_map import ErrorMap, Plane, map_plane
from abbe.compcore.model.model import Model
from abbe.compcore.model.uncertainty import (
    COVERAGE,
    UNKNOWN,
    PredictionUncertainty,
    in_words,
    uncertainty,
)


@dataclass(frozen=True, eq=False)
class MappedPlane:
    """A plane in one state of the machine.

    Attributes
    ----------
    plane
        The plane, and the state.
    found
        The errors on its grid.
    sure
        Their standard uncertainty, a row for each point; None where nobody knows.
    """

    plane: Plane
    found: ErrorMap
    sure: PredictionUncertainty | None

    @property
    def largest(self) -> float:
        """Greatest length of the error vector, mm."""
        return float(np.linalg.norm(self.found.error, axis=2).max())

    @property
    def widest(self) -> float | None:
        """Greatest ± of the error vector's length, mm."""
        if self.sure is None:
            return None
        return float(COVERAGE * np.linalg.norm(self.sure.translation, axis=1).max())


def map_planes(model: Model, planes: Sequence[Plane]) -> list[MappedPlane]:
    """The errors of each plane and how sure the model is of them."""
    return [MappedPlane(p, map_plane(model, p), uncertainty(model, p.conditions())) for p in planes]


def notes_of(mapped: Sequence[MappedPlane]) -> list[str]:
    """What lies outside of what was measured, each said once."""
    return list(dict.fromkeys(words for one in mapped for words in in_words(one.sure)))


def state_in_words(model: Model, plane: Plane) -> str:
    """Where the other axes stand, signals and tool; signals of one value together."""
    parts = [
        f"{a} = {math.degrees(v) if is_rotary(a) else v:g}{'°' if is_rotary(a) else ' mm'}"
        for a, v in plane.at.items()
    ]
    alike: dict[tuple[float, str], list[str]] = {}
    for name, value in plane.signals.items():
        unit = model.machine.signals[name].unit
        alike.setdefault((value, "°C" if unit == "degC" else unit), []).append(name)
    parts += [f"{', '.join(n)} = {v:g} {unit}".rstrip() for (v, unit), n in alike.items()]
    if any(plane.tool):
        parts.append(f"tool {', '.join(f'{v:g}' for v in plane.tool)} mm")
    return "; ".join(parts).replace("-", "−")


def as_json(mapped: Sequence[MappedPlane], warnings: list[str]) -> dict[str, Any]:
    """One object for ``--json``: positions mm (rotary: degrees), errors µm."""
    plane = mapped[0].plane
    reported: dict[str, Any] = {
        "plane": "".join(plane.across),
        "unit": "um",
        "grid": {a: g.tolist() for a, g in zip(plane.across, plane.grid, strict=True)},
        "maps": [
            {
                "at": {
                    **{a: math.degrees(v) if is_rotary(a) else v for a, v in one.plane.at.items()},
                    **one.plane.signals,
                    "tool": list(one.plane.tool),
                },
                "error": (one.found.error * 1e3).tolist(),
                "largest": one.largest * 1e3,
                "worst_pair": {
                    "from": {a: ends[0] for a, ends in one.found.worst.items()},
                    "to": {a: ends[1] for a, ends in one.found.worst.items()},
                    "length_error": one.found.worst_error * 1e3,
                },
                "uncertainty": _sure(one),
            }
            for one in mapped
        ],
    }
    return reported | ({"warnings": warnings} if warnings else {})


def _sure(one: MappedPlane) -> dict[str, Any] | None:
    if one.sure is None or one.widest is None:
        return None
    wide = COVERAGE * 1e3 * one.sure.translation.reshape(*one.found.error.shape)
    return {
        "k": COVERAGE,
        "largest": one.widest * 1e3,
        "each": wide.tolist(),
        "beyond": [b.name for b in one.sure.beyond],
    }


def as_text(model: Model, mapped: Sequence[MappedPlane]) -> Iterator[str]:
    """Lines for people."""
    for one in mapped:
        across = one.plane.across
        ends = ["(" + ", ".join(f"{one.found.worst[a][k]:g}" for a in across) + ")" for k in (0, 1)]
        yield f"plane {''.join(across)} at {state_in_words(model, one.plane)}"
        wide = "" if one.widest is None else f" ± {one.widest * 1e3:.1f} at most"
        yield f"  largest error {one.largest * 1e3:.1f} µm{wide}"
        yield (
            f"  a length errs most between {ends[0]} and {ends[1]} mm: "
            f"{one.found.worst_error * 1e3:+.1f} µm"
        )
    yield UNKNOWN if mapped[0].sure is None else f"± with k = {COVERAGE:g}"


def csv_lines(model: Model, mapped: Sequence[MappedPlane]) -> Iterator[str]:
    """A row for each point: where, in which state, the error and its ± in X, Y, Z, µm."""
    machine = model.machine
    axes, signals = list(machine.structure.axes), list(mapped[0].plane.signals)
    tool = [f"tool_{k}" for k in "xyz"]
    errors = [f"error_{k}_um" for k in "XYZ"]
    wide = [f"plus_minus_{k}_um" for k in "XYZ"] if mapped[0].sure is not None else []
    yield ",".join([*axes, *signals, *tool, *errors, *wide]) + "\n"
    for one in mapped:
        conditions = one.plane.conditions()
        columns: list[Any] = [
            np.degrees(conditions.position(a)) if is_rotary(a) else conditions.position(a)
            for a in axes
        ]
        columns += [conditions.signals[s] for s in signals]
        columns += list(conditions.tool.T)
        numbers = np.stack(columns, axis=1).tolist()
        values = one.found.error.reshape(-1, 3) * 1e3
        if one.sure is not None:
            values = np.hstack([values, COVERAGE * 1e3 * one.sure.translation])
        for where, row in zip(numbers, values.tolist(), strict=True):
            yield ",".join([*(f"{v:.9g}" for v in where), *(f"{v:.4f}" for v in row)]) + "\n"
