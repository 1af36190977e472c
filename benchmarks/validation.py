"""The sources' own experiments: writes their sections of ``docs/validation.md``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.measuring.report import write_section
from benchmarks.sources import flexing, iso16907, krulewich, zhang

PAGE = Path(__file__).resolve().parent.parent / "docs" / "validation.md"
SEEDS = (1, 2, 3, 4, 5)
MACHINES = range(1, 13)


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table; numbers right-aligned."""
    lines = [" | ".join(head), " | ".join("---" if i == 0 else "---:" for i in range(len(head)))]
    lines += [" | ".join(str(cell) for cell in row) for row in rows]
    return "\n".join(f"| {line} |" for line in lines)


def krulewich_section() -> str:
    """Distances to a whole machine."""
    rows = []
    for truth, shape, words in (
        ("polynomial", "polynomial", "polynomials, fitted by polynomials (degree 3 and 4)"),
        ("wavy", "polynomial", "no polynomials, fitted by polynomials"),
        ("wavy", "spline:7", "no polynomials, fitted by splines (7 coefficients)"),
        ("wavy", "spline:auto", "no polynomials, fitted by splines whose knots are found"),
    ):
        runs = [krulewich.run(seed, shape, truth=truth) for seed in MACHINES]
        after = [d.after.max() * 1e3 for _, _, d in runs]
        rows.append(
            [
                words,
                f"{np.median([d.before.max() for _, _, d in runs]) * 1e3:.0f}",
                f"{np.median(after):.1f} ({min(after):.1f} … {max(after):.1f})",
                f"{np.median([d.explained for _, _, d in runs]):.1%}",
                f"{np.median([r.chi2_per_dof for _, r, _ in runs]):.2f}",
                f"{np.mean([d.inside for _, _, d in runs]):.0%}",
            ]
        )
    biases = []
    for count in (3, 4):
        found = [
            krulewich.run(seed, "polynomial", bases=count, bias=5e-3)[1].model.terms[-1]
            for seed in SEEDS
        ]
        values = [term.values["bias"] for term in found]
        pulls = [(v.value - 5e-3) / (v.sd or 1.0) for v in values]
        biases.append(
            [
                count,
                ", ".join(f"{v.value * 1e3:.2f}" for v in values),
                f"{np.mean([v.sd or 0.0 for v in values]) * 1e3:.2f}",
                f"{max(abs(p) for p in pulls):.1f}",
            ]
        )
    rows.append(["Krulewich's measured mill", "25", "3", "88 %", "", ""])
    head = ["error motions", "before, µm", "after, µm", "explained", "χ²/dof", "within stated 95 %"]
    return f"""## Distances to a whole machine (Krulewich)

`w Z' b X Y (C) t`, 500 mm cube, 3 base points × 2 tools × 500 random positions and a turning
spindle, {krulewich.simulate(1).campaign.n} distances of 350 to 724 mm, noise 0.61 µm; unknown:
error motions, base points, tool offsets, the spindle's lean. What is compared are the 4 body and 12
face diagonals of the cube, which were not measured: peak to valley of the error, worst diagonal.
{len(MACHINES)} machines each, median (least … greatest).

{table(head, rows)}

A bias of 5 µm of the instrument:

{table(["bases", "found, µm", "stated uncertainty, µm", "greatest pull"], biases)}

Here the smooth model and the distances between base points make the bias observable with three
bases already; the fourth makes it surer."""


def zhang_section() -> str:
    """A bridge with thermal scales."""
    studies = [zhang.run(seed) for seed in SEEDS]
    square = [
        [
            pair,
            f"{studies[0].squareness[pair][0] * 1e6:.2f}",
            ", ".join(f"{(f - t) * 1e6:+.2f}" for t, f, _ in (s.squareness[pair] for s in studies)),
            f"{studies[0].squareness[pair][2] * 1e6:.2f}",
        ]
        for pair in studies[0].squareness
    ]
    expansion = [
        [
            axis,
            f"{zhang.ALPHA[axis] * 1e6:.0f}",
            ", ".join(f"{s.expansion[axis][0] * 1e6:.2f}" for s in studies),
            f"{studies[0].expansion[axis][1] * 1e6:.2f}",
        ]
        for axis in "XYZ"
    ]
    first = studies[0]
    linear = np.abs([[e.linear_before or 0.0, e.linear_after or 0.0] for e in first.lines.lines])
    rest = np.array([[e.rest_before, e.rest_after] for e in first.lines.lines])
    both = [
        [
            name,
            f"{np.median(v[:, 0]) * 1e3:.1f}",
            f"{v[:, 0].max() * 1e3:.1f}",
            f"{np.median(v[:, 1]) * 1e3:.1f}",
            f"{v[:, 1].max() * 1e3:.1f}",
        ]
        for name, v in (("linear part, end to end", linear), ("rest, peak to valley", rest))
    ]
    block = [[name, f"{before:+.1f}", f"{after:+.1f}"] for name, before, after in first.block]
    plane = [
        [
            f"{temperature:g} °C",
            f"({p.true[0][0]:.0f}, {p.true[0][1]:.0f}) – ({p.true[1][0]:.0f}, {p.true[1][1]:.0f})",
            f"{p.true[2] * 1e3:+.1f}",
            f"{p.predicted * 1e3:+.1f}",
            f"{abs(p.left) * 1e3:.1f}",
        ]
        for temperature, p in first.plane.items()
    ]
    noise, rows = zhang.NOISE * 1e3, first.result.problem.campaign.n
    pair = ["at", "worst pair (X, Y), mm", "error, µm", "predicted, µm", "worst pair left, µm"]
    return f"""## A bridge with thermal scales (Zhang et al.)

`w b Y X Z t`, 700 × 900 × 360 mm; 18 error motions in tables every 50 mm (X, Y) and 20 mm (Z),
scale errors at {len(zhang.TEMPERATURES)} temperatures, opposite diagonals of the three planes;
{rows} rows, laser noise {noise:g} µm, angles 0.2 µrad. {len(SEEDS)} repetitions.

Squareness (the shear that no choice of frame changes), µrad:

{table(["plane", "true", "found − true", "stated uncertainty"], square)}

Effective expansion coefficients, ppm/K:

{table(["scale", "true", "found", "stated uncertainty"], expansion)}

{len(first.lines.lines)} lines in arbitrary directions at other temperatures, never fitted (µm; the
laser's noise alone makes a peak to valley of some 2 µm of 21 points):

{table(["", "before: median", "worst", "after: median", "worst"], both)}

A 515 mm gauge block in seven orientations, error of length in µm:

{table(["orientation", "before", "after"], block)}

The error map of the plane Z = −330 mm: the pair of points with the worst error of length.

{table(pair, plane)}"""


def flexing_section() -> str:
    """Before trusting a rigid body."""
    rows = []
    for words, flex in (("rigid", 0.0), ("beam bows 4 µm more at the far end of Y", flexing.FLEX)):
        for seed in SEEDS[:3]:
            best = flexing.run(seed, flex)[0]
            named = " = ".join([f"{best.motion} on {best.by}", *best.alike])
            rows.append([words, named, f"{best.f:.1f}", f"{best.adjusted:.2g}"])
    return f"""## Before trusting a rigid body

Straightness and positioning of every axis in nine places. The strongest dependence of an error
motion on another axis's position, with the p-value corrected for all dependences tested. A bow of X
that grows with Y and a tilt of Y that depends on X are one and the same, and reported as one.

{table(["machine", "strongest", "F", "p"], rows)}"""


def iso_section() -> str:
    """Direct, indirect, superposed, validated."""
    studies = [iso16907.run(seed) for seed in SEEDS]
    agreement = []
    for name in studies[0].agreement:
        within = [s.agreement[name].within for s in studies]
        agreement.append(
            [
                name,
                f"{np.mean([s.agreement[name].rms for s in studies]) * 1e3:.2f}",
                "" if np.isnan(within[0]) else f"{np.mean(within):.0%}",
            ]
        )
    superposed = [
        [words, f"{np.mean([s.superposed[key] for s in studies]) * 1e3:.2f}"]
        for key, words in (
            ("bare", "no compensation"),
            ("old", "old tables (only the linear parts)"),
            ("unaware", "new tables from measurements taken as if no compensation were active"),
            (
                "superposed",
                "superposed: measured with the old tables active, and fitted knowing it",
            ),
        )
    ]
    return f"""## ISO/TR 16907: two ways to measure, compensated machines, validation

The same bridge at 20 °C. *By hand*: the direct measurements evaluated in the order of 10.3 with
averages and interpolation only. *Direct*: the same measurements through Abbe's fit. *Indirect*:
3200 distances from four base points with two probes. Differences at 60 places of the volume, rigid
displacements of the frame taken out, {len(SEEDS)} repetitions:

{table(["", "rms, µm", "within the stated 95 % intervals"], agreement)}

A machine that is already compensated (10.5), judged by 56 lines that were not fitted (11.3), laser
noise 0.5 µm:

{table(["tables", "rms left, µm"], superposed)}"""


SECTIONS: dict[str, Callable[[], str]] = {
    "krulewich": krulewich_section,
    "zhang": zhang_section,
    "rigid-body": flexing_section,
    "iso-16907": iso_section,
}


def main() -> None:
    """Run the experiments that are named, or all, and write what they gave."""
    for name in sys.argv[1:] or SECTIONS:
        text = SECTIONS[name]()
        print(text, end="\n\n")
        write_section(name, text, page=PAGE)


if __name__ == "__main__":
    main()
