"""Renishaw laser measurements, ``.rtl`` and ``.rta``, to a campaign.

The layout is known from files and from others' readers of it, not from its maker: sections
``NAME::``; targets in mm (rotary: degrees); deviations as ``run target value``, µm (rotary: mrad).
Whether deviations are laser minus target is an assumption, said in the campaign's notes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv.columns import AXIS
from abbe.compcore.files.importers.lines.laser_environment import LaserEnvironment, Normalisation
from abbe.compcore.files.importers.placing import (
    ForeignPlacing,
    along_line,
    component_of,
    place,
    read_bytes,
)
from abbe.compcore.files.importers.sheets.words import scale_of
from abbe.compcore.files.text.encodings import decoded
from abbe.compcore.files.text.numbers import checked_number
from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.units import in_digits

_SECTION = re.compile(r"[A-Z][A-Z -]*::")


@dataclass
class _RtlFile:
    """What was read so far."""

    targets: list[float] = field(default_factory=list)
    target_count: int | None = None
    run_count: int | None = None
    texts: dict[str, str] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=dict)
    equipment: dict[str, str] = field(default_factory=dict)
    rows: list[tuple[int, int, float, int]] = field(default_factory=list)


def import_rtl(
    path: str | Path,
    placing: ForeignPlacing | None = None,
    *,
    axis: str | None = None,
    component: str | None = None,
    unit: str | None = None,
    machine: Machine | None = None,
    normalisation: Normalisation | None = None,
) -> Campaign:
    """Read a Renishaw laser measurement.

    Parameters
    ----------
    axis
        The axis that moved; the file's own ``Axis:`` where None.
    component
        What was measured (X Y Z A B C); the axis's own positioning where None.
    unit
        Unit of the deviations where it is not µm (rotary: mrad).
    normalisation
        Whether the readings were normalised to 20 °C; asked for where the file tells a coefficient.

    Raises
    ------
    InputError
        Naming file, line, what was found and what was expected.
    """
    source = Path(path)
    data = read_bytes(source)
    file = _parse(decoded(data), str(source))
    axis = axis or _own_axis(file, str(source))
    component = component_of(axis, component)
    unit = unit or ("mrad" if component in "ABC" else "um")
    scale = scale_of(unit, "rad" if component in "ABC" else "mm", str(path))
    targets = np.deg2rad(file.targets) if is_rotary(axis) else np.array(file.targets)
    run, target, deviation, line = (np.array(column) for column in zip(*file.rows, strict=True))
    position = targets[target - 1]
    direction, against = _directions(run, position)
    environment = LaserEnvironment.read(file.environment)
    value, normalised = deviation * scale, ""
    if component == own_component(axis) and not is_rotary(axis):
        kept = normalisation or Normalisation()
        value, normalised = kept.undone(value, position, environment, str(source))
    readings = along_line(axis, component, position, direction, value, line)
    sign = "laser − target, as assumed of this format"
    notes = [
        f"imported from {source.name} (Renishaw rtl)",
        f"sign: error = {'−(' if placing and placing.sign < 0 else ''}{sign}"
        + (")" if placing and placing.sign < 0 else ""),
        f"deviations in {unit}",
        "the file has no times",
    ]
    if normalised:
        notes.append(normalised)
    if against:
        notes.append("directions by the order of the targets, which is not odd runs up, even down")
    metadata = {"instrument": "Renishaw laser interferometer"}
    if machine_name := file.texts.get("machine"):
        metadata["machine"] = machine_name
    if date := file.texts.get("date"):
        metadata["date"] = date
    for name, lines in (("environment", file.environment), ("equipment", file.equipment)):
        if lines:
            metadata[name] = "; ".join(f"{k}: {v}" for k, v in lines.items())
    if environment.signals:
        recorded = ", ".join(f"{k} {in_digits(v, 5)}" for k, v in environment.signals.items())
        notes.append(f"conditions from the file: {recorded}")
    placing = placing or ForeignPlacing()
    placing = replace(placing, signals={**environment.signals, **placing.signals})
    return place(source, data, [readings], placing, notes, metadata, machine)


def _own_axis(file: _RtlFile, name: str) -> str:
    text = file.texts.get("axis", "").upper().removesuffix(" AXIS").strip()
    if not AXIS.fullmatch(text):
        raise InputError(
            "the file does not name its axis",
            file=name,
            field="Axis",
            found=file.texts.get("axis"),
            expected="--axis",
        )
    return text


def _directions(run: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, bool]:
    """Direction of each row, and whether some run goes against 'odd forward, even reverse'.

    Rows of a run stand in the order of travel, so that the targets tell; a run of one target goes
    by its number.
    """
    forward = 1 if position[run == run[0]][-1] >= position[run == run[0]][0] else -1
    direction = np.empty(len(run), dtype=np.int64)
    against = False
    for number in np.unique(run):
        mine = run == number
        by_number = forward if number % 2 else -forward
        travel = position[mine][-1] - position[mine][0]
        stated = int(np.sign(travel)) if travel else by_number
        against |= stated != by_number
        direction[mine] = stated
    return direction, against


def _parse(text: str, name: str) -> _RtlFile:
    file = _RtlFile()
    section, part = "", ""
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.strip()
        if not line:
            continue
        if _SECTION.fullmatch(line):
            section, part = line.removesuffix("::").strip(), ""
            continue
        key, colon, value = line.partition(":")
        if section == "TARGET DATA" and colon:
            part = key.strip().lower()
            if part == "target-count":
                file.target_count = _integer(value, name, number, "Target-count")
            elif part == "targets" and value.strip():
                file.targets += _numbers(value, name, number)
        elif section == "TARGET DATA" and part == "targets":
            file.targets += _numbers(line, name, number)
        elif section == "USER-TEXT" and colon:
            file.texts[key.strip().lower()] = value.strip()
        elif section in ("ENVIRONMENT", "EQUIPMENT") and line:
            kept = file.environment if section == "ENVIRONMENT" else file.equipment
            name_of_line = key.strip() if colon else f"line {number}"
            kept[name_of_line] = value.strip() if colon else line
        elif section == "RUNS" and key.strip().lower() == "run-count":
            file.run_count = _integer(value, name, number, "Run-count")
        elif section == "DEVIATIONS" and not colon:
            file.rows.append(_row(line, name, number, len(file.targets)))
    _check(file, name)
    return file


def _row(line: str, name: str, number: int, targets: int) -> tuple[int, int, float, int]:
    fields = line.split()
    if len(fields) != 3:
        raise InputError(
            "not a deviation",
            file=name,
            line=number,
            found=line,
            expected="three numbers: run, target, deviation",
        )
    run, target = (
        _integer(f, name, number, w) for f, w in zip(fields, ("run", "target"), strict=False)
    )
    if not 1 <= target <= targets:
        raise InputError(
            "no such target", file=name, line=number, field="target", found=target,
            expected=f"a number from 1 to {targets}",
        )  # fmt: skip
    (deviation,) = _numbers(fields[2], name, number)
    return run, target, deviation, number


def _integer(text: str, name: str, line: int, what: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise InputError(
            "not a whole number", file=name, line=line, field=what, found=text.strip()
        ) from None


def _numbers(text: str, name: str, line: int) -> list[float]:
    return [checked_number(word, file=name, line=line) for word in text.split()]


def _check(file: _RtlFile, name: str) -> None:
    if not file.targets:
        raise InputError("no targets", file=name, expected="a section TARGET DATA:: with Targets :")
    if file.target_count is not None and file.target_count != len(file.targets):
        raise InputError(
            "targets are missing",
            file=name,
            field="Target-count",
            found=len(file.targets),
            expected=f"{file.target_count}, as the file says",
        )
    if not file.rows:
        raise InputError("no deviations", file=name, expected="a section DEVIATIONS:: with rows")
    seen: dict[tuple[int, int], int] = {}
    for run, target, _, line in file.rows:
        if (run, target) in seen:
            raise InputError(
                f"run {run} has target {target} twice",
                file=name,
                line=line,
                found=f"the first on line {seen[run, target]}",
            )
        seen[run, target] = line
    runs = len({run for run, *_ in file.rows})
    if file.run_count is not None and file.run_count != runs:
        raise InputError(
            "runs are missing",
            file=name,
            field="Run-count",
            found=runs,
            expected=f"{file.run_count}, as the file says",
        )
