"""The answer of ``abbe compare``: as JSON (formats.md) and as text; lengths µm, angles µrad."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from abbe.compcore.comparison.compare import ComparedRows, Comparison
from abbe.daemon.answers.fit import finite, floor_of_lengths
from abbe.daemon.answers.inputs import file_of

_MOST_TOLD = 8


def as_json(comparison: Comparison) -> dict[str, Any]:
    """One object for ``--json``; tables of lengths at the top, those of rotations apart."""
    noise = comparison.noise
    lengths = floor_of_lengths(noise)
    rotation = noise.levels.get("rotation")
    return {
        **_part(comparison, comparison.lengths, "um", 1e3),
        "noise_floor": None if lengths is None or lengths.value is None else lengths.value * 1e3,
        "noise": {kind: str(level) for kind, level in noise.levels.items()},
        "lines": [
            {
                "setup": line.setup,
                "n": line.n,
                "length": line.length,
                "linear_before": None if line.linear_before is None else line.linear_before * 1e3,
                "linear_after": None if line.linear_after is None else line.linear_after * 1e3,
                "rest_before": line.rest_before * 1e3,
                "rest_after": line.rest_after * 1e3,
            }
            for line in comparison.lines
        ],
        "uncertainty": {k.name.lower(): s for k, s in comparison.uncertainty.source.items()},
        "left_out": list(comparison.left_out),
        "rotation": {
            **_part(comparison, comparison.rotations, "urad", 1e6),
            "noise_floor": (
                None if rotation is None or rotation.value is None else rotation.value * 1e6
            ),
        },
    }


def _part(comparison: Comparison, part: ComparedRows, unit: str, factor: float) -> dict[str, Any]:
    campaign = comparison.problem.campaign
    positions = campaign.conditions.positions
    return {
        "n": part.n,
        "unit": unit,
        "rms": finite(part.rms, factor),
        "max": finite(part.max, factor),
        "p95": finite(part.p95, factor),
        "chi2_per_dof": finite(part.chi2_per_dof),
        **part.tables.as_dict(),
        "worst": [
            {
                "row": point.row,
                "file": file_of(campaign, point.row),
                "line": point.line,
                "setup": point.setup,
                "residual": point.residual * factor,
                "sd": point.sd * factor,
                "at": {axis: float(values[point.row]) for axis, values in positions.items()},
            }
            for point in part.worst
        ],
    }


def as_text(comparison: Comparison) -> Iterator[str]:
    """Lines for people: overall, worst set-ups and regions, lines, worst points."""
    for spec in comparison.left_out:
        yield f"left out: {spec} (belongs to a placing of the instrument in another campaign)"
    for part, name, unit, factor in (
        (comparison.lengths, "lengths", "µm", 1e3),
        (comparison.rotations, "rotations", "µrad", 1e6),
    ):
        if not part.n:
            continue
        yield (
            f"{name}: {part.n} rows, rms {part.rms * factor:.3g} {unit}, "
            f"95 % within {part.p95 * factor:.3g}, max {part.max * factor:.3g}; "
            f"χ²/dof {part.chi2_per_dof:.2f}"
        )
        yield from _worst_groups(part, unit)
        for point in part.worst[:3]:
            yield (
                f"  worst: {file_of(comparison.problem.campaign, point.row)}, line {point.line}, "
                f"set-up {point.setup}: "
                f"{point.residual * factor:+.3g} {unit} (sd {point.sd * factor:.2g})"
            )
    yield str(comparison.noise)
    if comparison.lines:
        yield "lines: linear part end to end and rest (peak to valley), before → after, µm"
        ordered = sorted(comparison.lines, key=lambda line: -line.rest_after)
        for line in ordered[:_MOST_TOLD]:
            linear = (
                "slope free"
                if line.linear_before is None or line.linear_after is None
                else f"{line.linear_before * 1e3:+.1f} → {line.linear_after * 1e3:+.1f}"
            )
            yield (
                f"  {line.setup} ({line.length:.0f} mm): {linear}; "
                f"{line.rest_before * 1e3:.1f} → {line.rest_after * 1e3:.1f}"
            )


def _worst_groups(part: ComparedRows, unit: str) -> Iterator[str]:
    for name, groups in (
        ("set-up", part.tables.setups),
        ("region", part.tables.regions),
        ("direction", part.tables.directions),
        ("signal", part.tables.signals),
    ):
        for group in sorted(groups, key=lambda g: -g.rms)[:2]:
            where = " ".join(_short(v) for v in group.of.values())
            yield (
                f"  {name} {where}: rms {group.rms:.3g} {unit}, mean {group.mean:+.3g}, "
                f"{group.n} rows"
            )


def _short(value: object) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)
