"""The fit beside `scipy.optimize.least_squares` and lmfit on the same problems, in one run.

Distances: a machine from distances to unknown base points, non-linear. Lines: a bridge from lines,
levels and diagonals, linear, with a zero or slope for each of its set-ups. Rows: cost and memory up
to a million rows, each number in a process of its own.

    python benchmarks/fit.py
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.effects import make_effect
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.fit import fit
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model
from benchmarks.measuring.report import machine, write_section
from benchmarks.sources import krulewich

F64 = NDArray[np.float64]
DATA = Path(__file__).resolve().parent.parent / "tests" / "data" / "p02-bridge"
ROWS = (10_000, 100_000, 1_000_000)
TURNS = 5


def distances() -> tuple[Model, Campaign]:
    """3000 distances and 80 unknowns: 69 coefficients, the spindle's lean, three base points."""
    experiment = krulewich.simulate(1)
    campaign = experiment.campaign
    # tools as measured on a presetter; every other row of the turning spindle left out
    tools = {n: type(t)(n, krulewich.TOOLS[n]) for n, t in campaign.tools.items()}
    from dataclasses import replace

    keep = np.flatnonzero(campaign.conditions.spindle_angle == 0.0)[:3000]
    tool = campaign.conditions.tool.copy()
    for name, offset in krulewich.TOOLS.items():
        tool[campaign.tool_name == name] = offset
    campaign = replace(
        campaign, tools=tools, conditions=replace(campaign.conditions, tool=tool)
    ).rows(keep)
    full = krulewich.model()
    effects = []
    for effect in full.effects:
        keys = dict(effect.where())
        if "shape" in keys:
            roll = effect.kind == "angular" and keys["about"] == keys["axis"]
            keys["shape"] = f"polynomial:{2 if roll else 3}"
        effects.append(make_effect(effect.kind, keys))
    return Model(full.machine).with_effects(*effects), campaign


def lines() -> tuple[Model, Campaign]:
    """2117 rows, 18 error motions as splines of 12, three expansions, three squarenesses."""
    model = load_model(DATA / "model.toml")
    effects = []
    for effect in model.effects:
        keys = dict(effect.where())
        if "shape" in keys or effect.kind in ("positioning", "straightness", "angular"):
            keys["shape"] = "spline:12"
        effects.append(make_effect(effect.kind, keys))
    return Model(model.machine).with_effects(*effects), read_campaign(
        DATA / "fit.csv", model.machine
    )


def by_hand(
    model: Model, campaign: Campaign
) -> tuple[F64, Callable[[F64], F64], Callable[[F64], F64]]:
    """Start, weighted residuals and their Jacobian as one would write them for an optimiser.

    All that does not depend on the unknowns is computed beforehand.
    """
    problem = Problem(model, campaign)
    layout, start = problem.layout, problem.start()
    observation = problem.observation(start)
    m = layout.model_size
    if not layout.bases:
        dense = problem.jacobian(start)
        scale = np.linalg.norm(dense, axis=0)
        dense = dense / np.where(scale > 0.0, scale, 1.0)
        y = campaign.value / campaign.sd
        return np.zeros(dense.shape[1]), lambda x: dense @ x - y, lambda _: dense
    motions = [motion for i in range(len(model.effects)) for motion in problem.motions(i, start)]
    moves = np.zeros((campaign.n, 3, m))
    at = 0
    for motion in motions:
        k = motion.columns.shape[1]
        moved, _ = observation.chain.influence(motion.error_motion)
        moves[:, :, at : at + k] = moved[:, :, None] * motion.columns[:, None, :]
        at += k
    scale = layout.scale
    point = observation.chain.point
    far = observation.distance
    number = np.full(campaign.n, -1)
    first = campaign.conditions.base
    assert first is not None
    for k, name in enumerate(layout.bases):
        number[first == name] = k
    second = np.array([list(layout.bases).index(b) if b else -1 for b in campaign.base2])
    between = observation.base_distance

    def vectors(x: F64) -> F64:
        theta = x * scale
        bases = theta[m:].reshape(-1, 3)
        v = np.empty((campaign.n, 3))
        v[far] = point[far] + moves[far] @ theta[:m] - bases[number[far]]
        v[between] = bases[number[between]] - bases[second[between]]
        return v

    def residual(x: F64) -> F64:
        return (np.linalg.norm(vectors(x), axis=1) - campaign.value) / campaign.sd

    def jacobian(x: F64) -> F64:
        v = vectors(x)
        u = v / np.linalg.norm(v, axis=1)[:, None]
        out = np.zeros((campaign.n, layout.size))
        out[:, :m] = np.einsum("ni,nip->np", u, moves)
        rows = np.arange(campaign.n)
        for k in range(3):
            np.add.at(out, (far, m + 3 * number[far] + k), -u[far, k])
            np.add.at(out, (between, m + 3 * number[between] + k), u[between, k])
            np.add.at(out, (between, m + 3 * second[between] + k), -u[between, k])
        del rows
        return out * scale / campaign.sd[:, None]

    return start / scale, residual, jacobian


def timed(work: Callable[[], float], turns: int) -> tuple[float, float]:
    """Median time in s, and the χ² that came out."""
    times, chi2 = [], 0.0
    for _ in range(turns):
        began = time.perf_counter()
        chi2 = work()
        times.append(time.perf_counter() - began)
    return median(times), chi2


def side_by_side(model: Model, campaign: Campaign) -> list[tuple[str, float, float]]:
    """(name, s, χ²) of each, in one run."""
    import lmfit
    from scipy.optimize import least_squares

    start, residual, jacobian = by_hand(model, campaign)

    def with_scipy(**keys: object) -> float:
        return 2.0 * float(least_squares(residual, start, **keys).cost)

    def with_lmfit(**keys: object) -> float:
        parameters = lmfit.Parameters()
        for i, value in enumerate(start):
            parameters.add(f"p{i}", value=value)

        def left(p: lmfit.Parameters) -> F64:
            return residual(np.array([p[f"p{i}"].value for i in range(len(start))]))

        def slopes(p: lmfit.Parameters) -> F64:
            return jacobian(np.array([p[f"p{i}"].value for i in range(len(start))]))

        extra = {"Dfun": slopes} if keys else {}
        return float(lmfit.minimize(left, parameters, **extra).chisqr)

    with threads_for(0):
        return [
            ("Abbe", *timed(lambda: fit(model, campaign).chi2, TURNS)),
            ("scipy least_squares, numeric Jacobian", *timed(with_scipy, 1)),
            (
                "scipy least_squares, analytic Jacobian by hand",
                *timed(lambda: with_scipy(jac=jacobian), 1),
            ),
            ("lmfit (leastsq), numeric Jacobian", *timed(with_lmfit, 1)),
            (
                "lmfit (leastsq), analytic Jacobian by hand",
                *timed(lambda: with_lmfit(analytic=True), 1),
            ),
        ]


def table(results: list[tuple[str, float, float]], dof: int) -> str:
    """One problem's Markdown table."""
    own = results[0][1]
    rows = [
        f"| {name} | {seconds:.2f} | {seconds / own:.1f} | {chi2 / dof:.4f} |"
        for name, seconds, chi2 in results
    ]
    return "\n".join(
        ["| | s | times Abbe's | χ²/dof reached |", "| --- | ---: | ---: | ---: |", *rows]
    )


def grown(rows: int) -> dict[str, float]:
    """Time and peak memory of one fit of a campaign with so many rows (in this very process)."""
    model = load_model(DATA / "model.toml")
    campaign = read_campaign(DATA / "fit.csv", model.machine)
    rng = np.random.default_rng(0)
    large = campaign.rows(np.sort(rng.integers(0, campaign.n, rows)))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    began, cpu = time.perf_counter(), time.process_time()
    result = fit(model, large)
    return {
        "rows": rows,
        "unknowns": result.problem.layout.size,
        "seconds": time.perf_counter() - began,
        "cpu": time.process_time() - cpu,
        "before": before,
        "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    }


def main() -> None:
    """Run everything and write the section."""
    if len(sys.argv) == 3 and sys.argv[1] == "--rows":
        print(json.dumps(grown(int(sys.argv[2]))))
        return
    parts = ["## Fit", machine() + "."]
    for name, build in (("Distances", distances), ("Lines", lines)):
        model, campaign = build()
        result = fit(model, campaign)
        layout = result.problem.layout
        parts.append(
            f"{name}: {campaign.n} rows, {layout.size} unknowns, {result.eliminator.rank} unknowns "
            "of the set-ups. Abbe's time includes covariance, what is not determined, the choice "
            "of frame and the model; the others only minimise, from functions with everything "
            "precomputed. They reach a hair less by moving what the data do not determine; Abbe "
            "leaves that alone."
        )
        found = side_by_side(model, campaign)
        parts.append(table(found, result.dof))
        print(parts[-2], parts[-1], sep="\n\n", end="\n\n", flush=True)
    rows = []
    for count in ROWS:
        command = [sys.executable, __file__, "--rows", str(count)]
        measured = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        rows.append(
            f"| {count} | {measured['seconds']:.1f} | {measured['cpu']:.1f} | "
            f"{measured['cpu'] / count * 1e6:.0f} | {measured['before']:.0f} | "
            f"{measured['peak'] - measured['before']:.0f} |"
        )
        print(rows[-1], flush=True)
    head = "| rows | s | processor s | µs/row | campaign and libraries, MB | the fit's peak, MB |"
    parts.append(
        "\n".join(
            [
                "Rows of the lines' campaign drawn again and again, 150 unknowns; each in its own "
                "process:",
                "",
                head,
                "| ---: | ---: | ---: | ---: | ---: | ---: |",
                *rows,
            ]
        )
    )
    write_section("fit", "\n\n".join(parts))


if __name__ == "__main__":
    main()
