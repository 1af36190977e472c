"""Measured lengths and plates as a campaign's rows: what a fit takes.

A calibrated length is two displacements along it with one zero that nobody knows: only their
difference counts, the actual length less the indicated one. A step gauge's faces share the first
face's reading. A plate is three displacements a ball (two a hole) with the plate's place unknown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.corrected import positions_of
from abbe.compcore.artefacts.measured_length import MeasuredLength
from abbe.compcore.artefacts.plate import MeasuredPlate, rigid_placing
from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.artefacts.lengths import read_lengths
from abbe.compcore.files.importers.artefacts.plates import read_plates
from abbe.compcore.files.importers.placing import ForeignPlacing, Readings, place
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]


def import_lengths(
    path: str | Path,
    machine: Machine | None,
    placing: ForeignPlacing | None = None,
) -> Campaign:
    """Measured lengths with their probed points as a campaign; a set-up a placing and run.

    Raises
    ------
    InputError
        For a bad file, and for lengths without their probed points.
    """
    source = Path(path)
    placing = placing or ForeignPlacing()
    lengths, data = read_lengths(source, tool=placing.tool)
    groups: dict[tuple[object, ...], list[MeasuredLength]] = {}
    for length in lengths:
        if length.ends is None:
            raise InputError(
                "a campaign needs the two probed points of every length",
                file=source,
                line=length.line,
                field="x1",
                expected="columns x1, y1, z1, x2, y2, z2; without them: abbe iso10360",
            )
        start = tuple(length.ends[0].tolist())
        groups.setdefault((length.position, length.run, start), []).append(length)
    readings = [
        _of_lengths(own, machine, f" {own[0].position} {own[0].run} #{i + 1}")
        for i, own in enumerate(groups.values())
    ]
    notes = [
        f"imported from {source.name} (calibrated lengths)",
        "sign: error = calibrated length at the standard's temperature − indicated length",
        "the calibration's uncertainty is common to all rows of one length (gauge)",
    ]
    return place(source, data, readings, placing, notes, {"instrument": "calibrated lengths"})


def _of_lengths(own: Sequence[MeasuredLength], machine: Machine | None, suffix: str) -> Readings:
    ends = np.array([length.ends for length in own])
    point = np.concatenate([ends[:1, 0], ends[:, 1]])
    way = max((end[1] - end[0] for end in ends), key=lambda v: float(v @ v))
    rows = [own[0], *own]
    value = np.array([0.0, *(-length.error for length in own)])
    known = np.array([0.0, *(length.uncertainty for length in own)])
    # one length is one gauge, in whatever orientation and run
    names = ["", *(f"{length.calibrated.length:.6f} mm" for length in own)]
    signals = {name: np.array([r.signals[name] for r in rows]) for name in rows[0].signals}
    tool = np.array([r.tool for r in rows])
    return _readings(
        point, way / np.linalg.norm(way), value, tool, signals, machine, ("zero",),
        np.array([r.line for r in rows]), suffix, names, known,
    )  # fmt: skip


def import_plates(
    path: str | Path,
    machine: Machine | None,
    placing: ForeignPlacing | None = None,
) -> Campaign:
    """Measured plates as a campaign; a set-up a placing, where it stands free.

    Raises
    ------
    InputError
        For a bad file.
    """
    source = Path(path)
    placing = placing or ForeignPlacing()
    plates, data = read_plates(source, tool=placing.tool)
    readings = [r for plate in plates for r in _of_plate(plate, machine)]
    # three components of one placing are one set-up: their frame is one
    notes = [
        f"imported from {source.name} ({'hole' if plates[0].planar else 'ball'} plate)",
        "sign: error = calibrated point of the placed plate − indicated point",
        "the calibration's uncertainty is common to all placings (gauge)",
    ]
    return place(source, data, readings, placing, notes, {"instrument": "plate"})


def _of_plate(plate: MeasuredPlate, machine: Machine | None) -> list[Readings]:
    # along the plate's own axes: what its calibration got wrong stays with it in every placing
    turn, _ = rigid_placing(plate.actual, plate.indicated)
    error = -plate.errors()
    known = np.full(len(plate.points), plate.sd)
    # its calibrated place tells a ball of this plate from one of another
    balls = [
        f"{name} ({', '.join(f'{v:.4f}' for v in at)})"
        for name, at in zip(plate.points, plate.calibrated.tolist(), strict=True)
    ]
    return [
        _readings(
            plate.indicated, u, error @ u, plate.tool, plate.signals, machine, ("frame",),
            plate.line, f" {plate.placing}", [f"{name} {k}" for name in balls], known,
        )
        for k, u in zip("xy" if plate.planar else "xyz", turn.T, strict=False)
    ]  # fmt: skip


def _readings(
    point: F64,
    u: F64,
    value: F64,
    tool: F64,
    signals: Mapping[str, F64],
    machine: Machine | None,
    free: tuple[str, ...],
    line: NDArray[np.int64],
    suffix: str,
    gauges: Sequence[str],
    known: F64,
) -> Readings:
    if machine is None:
        positions = {a: (point - tool)[:, k] for k, a in enumerate("XYZ")}
    else:
        positions = positions_of(machine, point, tool, signals)
    still = np.zeros(len(point), dtype=np.int64)
    return Readings(
        positions,
        dict.fromkeys(positions, still),
        Kind.DISPLACEMENT,
        value,
        np.tile(u, (len(point), 1)),
        free,
        line,
        suffix,
        signals={n: v for n, v in signals.items() if n not in positions},
        tool=tool,
        gauge=[name if sd > 0.0 else "" for name, sd in zip(gauges, known, strict=True)]
        if known.any()
        else None,
        gauge_sd=known if known.any() else None,
    )
