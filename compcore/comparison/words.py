"""A comparison in words; lengths in µm, angles in µrad."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.noise import NoiseFloor
from abbe.compcore.campaign.sampling import sampling_words
from abbe.compcore.comparison.lines import MeasuredLine
from abbe.compcore.comparison.parts import ComparedRows
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import Sentence, said
from abbe.compcore.units import in_digits

_MOST_LISTED = 8
OTHER_SETUPS = said(
    "ISO/TR 16907, 11.3, asks for other set-ups and other points than those of the tables"
)


def clock_words(other_day: Sequence[str], same_day: Sequence[str]) -> Iterator[Sentence]:
    """What of a model ran by the clock of another day, or is applied as if it were the same."""
    if other_day:
        yield said(
            "left out: {specs} (by the clock of the day to which the model was fitted; this is "
            "another one)",
            specs=", ".join(other_day),
        )
    if same_day:
        yield said(
            "{specs}: by the clock of the day to which the model was fitted, and applied as if "
            "this were the same one: the campaigns do not say their days (`date` in their heads)",
            specs=", ".join(same_day),
        )


def comparison_words(
    campaign: Campaign,
    lengths: ComparedRows,
    rotations: ComparedRows,
    lines: Sequence[MeasuredLine],
    noise: NoiseFloor,
    left_out: Sequence[str],
    waves: Sequence[tuple[str, float]] = (),
) -> Iterator[str]:
    """Lines for people: overall, worst set-ups and regions, worst points, lines."""
    for spec in left_out:
        yield f"left out: {spec} (belongs to a placing of the instrument in another campaign)"
    for part, name, unit, factor in (
        (lengths, "lengths", "µm", 1e3),
        (rotations, "rotations", "µrad", 1e6),
    ):
        if not part.n:
            continue
        yield (
            f"{name}: {part.n} rows, rms {in_digits(part.rms * factor)} {unit}, "
            f"95 % within {in_digits(part.p95 * factor)}, max {in_digits(part.max * factor)}; "
            f"χ²/dof {part.chi2_per_dof:.2f}"
        )
        yield from _worst_groups(part, unit)
        for point in part.worst[:3]:
            yield (
                f"  worst: {campaign.file_of(point.row)}, line {point.line}, "
                f"set-up {point.setup}: "
                f"{in_digits(point.residual * factor, sign=True)} {unit} "
                f"(sd {in_digits(point.sd * factor, 2)})"
            )
    yield str(noise)
    if lines:
        yield "lines: linear part end to end and rest (peak to valley), before → after, µm"
        ordered = sorted(lines, key=lambda line: -line.rest_after)
        for line in ordered[:_MOST_LISTED]:
            linear = (
                "slope free"
                if line.linear_before is None or line.linear_after is None
                else f"{line.linear_before * 1e3:+.1f} → {line.linear_after * 1e3:+.1f}"
            )
            yield (
                f"  {line.setup} ({line.length:.0f} mm): {linear}; "
                f"{line.rest_before * 1e3:.1f} → {line.rest_after * 1e3:.1f}"
            )
    yield from sampling_words(campaign, waves)


def known_waves(model: Model) -> tuple[tuple[str, float], ...]:
    """Axis and length (mm or rad) of each wave that a model's fitted effects repeat with."""
    machine = model.machine
    return tuple(
        (axis, length)
        for term in model.terms
        if term.fitted
        for axis, length in term.effect.repeats(machine, term.nonlinear(machine)).items()
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
                f"  {name} {where}: rms {in_digits(group.rms)} {unit}, "
                f"mean {in_digits(group.mean, sign=True)}, {group.n} rows"
            )


def _short(value: object) -> str:
    return in_digits(value, 5) if isinstance(value, float) else str(value)


def fitted_note(files: Sequence[str]) -> str:
    """What a comparison with fitted campaigns says, and what not."""
    if len(files) == 1:
        return said(
            "FITTED: {files} is a campaign that this model was fitted to: what is left over says "
            "how close the fit is, not how well the machine is predicted ({other})",
            files=files[0],
            other=OTHER_SETUPS,
        )
    return said(
        "FITTED: {files} are campaigns that this model was fitted to: what is left over says "
        "how close the fit is, not how well the machine is predicted ({other})",
        files=", ".join(files),
        other=OTHER_SETUPS,
    )
