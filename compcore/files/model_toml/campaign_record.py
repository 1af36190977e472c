"""The record that a model keeps of each campaign: file, residuals, noise, conditions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import LENGTHS, Campaign, Kind
from abbe.compcore.campaign.measuring_conditions import by_file, of_files
from abbe.compcore.campaign.noise import NoiseFloor, noise_floor
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]


def noise_by_file(
    campaign: Campaign, machine: Machine, whole: NoiseFloor | None = None
) -> list[NoiseFloor]:
    """The noise floor of each file's own repeats; `whole`, where known, serves for a single one."""
    parts = by_file(campaign)
    if len(parts) == 1 and whole is not None:
        return [whole]
    return [noise_floor(rows, machine) for rows in parts]


def campaign_records(
    campaign: Campaign, residual: F64, noise: Sequence[NoiseFloor]
) -> list[dict[str, Any]]:
    """One record for each file, in order; what is not known is left out.

    Parameters
    ----------
    campaign
        One or more files, joined.
    residual
        What a model leaves of each row, (n,), mm or rad.
    noise
        Of each file (`noise_by_file`).

    Returns
    -------
    ``file``, ``sha256``, ``n``; ``rms`` and ``noise_floor`` of its lengths, µm;
    ``rms_rotation_urad`` and ``noise_floor_rotation_urad``; ``conditions``, as said and as seen
    (`measuring_conditions`).
    """
    parts = by_file(campaign)
    run = campaign.conditions.run
    misfits = [residual]
    if run is not None and len(parts) > 1:
        misfits = [residual[run == run.min() + k] for k in range(len(parts))]
    stated = of_files(campaign)
    found = []
    for (file, sha256), rows, left, said, level in zip(
        campaign.files.items(), parts, misfits, stated, noise, strict=True
    ):
        record: dict[str, Any] = {"file": file, "sha256": sha256, "n": rows.n}
        lengths = level.lengths
        numbers = {
            "rms": _rms(rows, left, LENGTHS, 1e3),
            "noise_floor": _scaled(None if lengths is None else lengths.value, 1e3),
            "rms_rotation_urad": _rms(rows, left, (Kind.ROTATION,), 1e6),
            "noise_floor_rotation_urad": _scaled(level.value("rotation"), 1e6),
        }
        record |= {k: v for k, v in numbers.items() if v is not None}
        found.append({**record, "conditions": said})
    return found


def _rms(rows: Campaign, left: F64, kinds: Iterable[Kind], factor: float) -> float | None:
    chosen = left[np.isin(rows.kind, list(kinds))]
    return float(np.sqrt(np.mean(chosen**2))) * factor if chosen.size else None


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None or math.isnan(value) else value * factor


def conditions_of(record: Mapping[str, Any]) -> dict[str, Any]:
    """The conditions in a campaign's record; empty where an older version of Abbe wrote it."""
    said = record.get("conditions")
    return dict(said) if isinstance(said, Mapping) else {}
