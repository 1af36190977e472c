"""Abbe's loop beside what a user would otherwise do: a black box, a sparse regression.

``python -m benchmarks.black_box`` writes the section of docs/validation.md; ``--quick`` runs two
scenarios and writes nothing.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.linear_model import LassoCV
from sklearn.model_selection import GroupKFold

from benchmarks.diagnosis import VALIDATION, as_campaign
from benchmarks.hidden.causes import Cause
from benchmarks.hidden.scenario import Scenario, hide, scenarios
from benchmarks.hidden.scene import scene
from benchmarks.report import write_section
from compcore.campaign import Campaign, Kind
from compcore.compare import compare
from compcore.diagnose import Diagnosis, diagnose
from compcore.effects import make_effect
from compcore.fit import fit
from compcore.model import Model
from compcore.model_file import parse_model
from compcore.revise import with_effect
from compcore.threads import threads_for
from compcore.toml_source import TomlSource

F64 = NDArray[np.float64]

HIDDEN = (
    "backlash",
    "thermal_tilt",
    "thermal_offset lagged",
    "scale_expansion",
    "cross_angular",
    "feed_lag",
    "cosine",
    "two positions and a temperature",
    "saddle of two positions",
    "oscillation in time",
    "direction of one axis over another's position",
    "square of a temperature",
)
MULTIPLE = 6
SUBSAMPLE = 300
"""Rows from which the Gaussian process learns its length scales; it then takes all rows."""
FOLDS = 3


@dataclass(frozen=True)
class Outcome:
    """One scenario: RMS on unseen lines in mm, and what each says of the cause.

    Attributes
    ----------
    before, oracle
        Without the cause, and fitted by one who knows it (NaN where no effect of the catalogue is
        it).
    abbe, process, boosting, lasso
        After Abbe's loop, a Gaussian process, gradient boosting, Lasso.
    said
        Abbe's verdict and what it named.
    kept, leading, leads
        Terms that the Lasso keeps, the largest, and whether that one is the cause's own.
    """

    scenario: Scenario
    before: float
    oracle: float
    abbe: float
    process: float
    boosting: float
    lasso: float
    said: str
    kept: int
    leading: str
    leads: str


@dataclass(frozen=True, eq=False)
class Table:
    """What a campaign recorded, one column each, scaled as the fitted campaign's."""

    names: tuple[str, ...]
    columns: F64
    u: F64

    @classmethod
    def of(cls, campaign: Campaign, like: Campaign) -> Table:
        """Positions, directions, tool, signals, time of displacement rows, and the direction u."""

        def raw(of: Campaign) -> dict[str, F64]:
            c = of.conditions
            found = dict(c.positions)
            found |= {f"{a}_dir": s for a, s in c.directions.items()}
            found |= {f"tool_{k}": c.tool[:, i] for i, k in enumerate("xyz")}
            return found | dict(c.signals) | {"t": c.time}

        own, other = raw(campaign), raw(like)
        scaled = []
        for name, values in own.items():
            middle = 0.0 if name.endswith("_dir") else float(other[name].mean())
            scaled.append((values - middle) / (float(other[name].std()) or 1.0))
        u = campaign.conditions.u
        return cls(
            tuple(own), np.stack(scaled, axis=1), np.zeros((campaign.n, 3)) if u is None else u
        )

    def features(self) -> F64:
        """For a black box: everything beside each other."""
        return np.hstack([self.columns, self.u])

    def library(self) -> tuple[list[tuple[tuple[str, ...], str]], F64]:
        """Products of up to three recorded quantities times each component of u."""
        terms: list[tuple[tuple[str, ...], str]] = []
        columns = []
        used = [i for i, name in enumerate(self.names) if not name.startswith("tool_")]
        directions = {i for i, name in enumerate(self.names) if name.endswith("_dir")}
        for order in range(4):
            for which in combinations_with_replacement(used, order):
                if len(set(which) & directions) < sum(i in directions for i in which):
                    continue  # the square of a direction says nothing
                product = np.prod(self.columns[:, list(which)], axis=1)
                for k, axis in enumerate("XYZ"):
                    terms.append((tuple(self.names[i] for i in which), axis))
                    columns.append(product * self.u[:, k])
        return terms, np.stack(columns, axis=1)


def held_out(model: Model, campaign: Campaign, unseen: Campaign, taken: F64, there: F64) -> float:
    """RMS on unseen lines of a model fitted to what a correction leaves, mm.

    `taken` and `there`, (n,): the correction at the rows of the campaign and of the unseen lines.
    """
    fitted = fit(model, replace(campaign, value=campaign.value - taken)).model
    return compare(fitted, replace(unseen, value=unseen.value - there)).lengths.rms


def _with(model: Model, effects: Sequence[tuple[str, dict[str, object]]]) -> Model:
    for kind, where in effects:
        if make_effect(kind, where).scope != "instrument":
            model, _ = with_effect(model, kind, where)
    return model


def _offered(diagnosis: Diagnosis) -> list[tuple[str, dict[str, object]]]:
    """The empirical formula that is offered where nothing in the catalogue explains."""
    for structure in diagnosis.structure:
        pattern = structure.pattern
        if pattern.terms:
            terms = [t.replace(" ", "") for t in pattern.terms]
            return [("formula", {"channel": str(pattern.channel), "terms": terms})]
    return []


def run(scenario: Scenario) -> Outcome:
    """One scenario, all ways, with one thread each."""
    with threads_for(0):
        return _run(scenario)


def _run(scenario: Scenario) -> Outcome:
    stage = scene(scenario.seed, scenario.kind)
    hidden = hide(scenario, stage)
    omits = [cause.omits for cause, _ in hidden if cause.omits]
    model = parse_model(TomlSource(stage.model_text(omits)))
    campaign = as_campaign(stage.simulate(hidden).text, model)
    unseen = as_campaign(stage.simulate(hidden, held_out=True).text, model)
    nothing = np.zeros(campaign.n), np.zeros(unseen.n)
    diagnosis = diagnose(model, campaign)
    effects = [e.found.candidate.effect for e in diagnosis.established]
    named = [(e.kind, dict(e.where())) for e in effects] or _offered(diagnosis)
    before = held_out(model, campaign, unseen, *nothing)
    true = [(k, dict(w)) for c, _ in hidden for k, w in c.answers[:1]]
    oracle = float("nan")
    if len(true) == len(hidden):
        oracle = held_out(_with(model, true), campaign, unseen, *nothing)
    added = held_out(_with(model, named), campaign, unseen, *nothing)
    said = "; ".join(e.spec for e in effects)
    if not said:
        said = diagnosis.verdict
        if diagnosis.structure:
            said += ": depends on " + ", ".join(diagnosis.structure[0].depends_on)

    rows = campaign.kind == Kind.DISPLACEMENT
    residual = diagnosis.result.residual[rows]
    seen, other = Table.of(campaign, campaign), Table.of(unseen, campaign)
    corrections = {}
    for name, method in (("process", _process), ("boosting", _boosting)):
        taken = np.zeros(campaign.n)
        taken[rows], there = method(seen.features()[rows], residual, other.features())
        corrections[name] = held_out(model, campaign, unseen, taken, there)
    setups = np.unique(np.asarray(campaign.conditions.setup), return_inverse=True)[1]
    terms, library = seen.library()
    residualised = diagnosis.result.residualise(
        library * (diagnosis.result.problem.weight * rows)[:, None]
    )
    coefficients, sizes = _lasso(residualised, diagnosis.result.weighted, setups)
    kept = np.flatnonzero(coefficients)
    lasso = before
    leading, leads = "–", "–"
    if kept.size:
        taken = library @ coefficients * rows
        lasso = held_out(model, campaign, unseen, taken, other.library()[1] @ coefficients)
        first = terms[int(np.argmax(np.abs(coefficients) * sizes))]
        leading = "·".join([*first[0], f"u_{first[1]}"])
        leads = _is_own(first, hidden[0][0]) if hidden else "no"
    return Outcome(
        scenario,
        before,
        oracle,
        added,
        corrections["process"],
        corrections["boosting"],
        lasso,
        said,
        len(kept),
        leading,
        leads,
    )


def _process(features: F64, residual: F64, unseen: F64) -> tuple[F64, F64]:
    """A Gaussian process with a length scale for each feature: at the rows, and at unseen ones."""
    size = float(residual.std())
    y = residual / size
    kernel = ConstantKernel(0.5) * RBF(np.full(features.shape[1], 3.0), (0.3, 100.0))
    kernel += WhiteKernel(0.5, (0.01, 2.0))
    chosen = np.random.default_rng(0).permutation(len(y))[:SUBSAMPLE]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        few = GaussianProcessRegressor(kernel).fit(features[chosen], y[chosen])
    whole = GaussianProcessRegressor(few.kernel_, optimizer=None).fit(features, y)
    return size * whole.predict(features), size * whole.predict(unseen)


def _boosting(features: F64, residual: F64, unseen: F64) -> tuple[F64, F64]:
    """Gradient boosting on the same features; stops where rows left out no longer improve."""
    trees = HistGradientBoostingRegressor(
        learning_rate=0.05, max_iter=400, early_stopping=True, random_state=0
    )
    trees.fit(features, residual)
    return trees.predict(features), trees.predict(unseen)


def _lasso(columns: F64, weighted: F64, setups: NDArray[np.int64]) -> tuple[F64, F64]:
    """Coefficients of the library's terms and the columns' sizes.

    Columns and residual (n,) are weighted, and what model and set-ups imitate is taken out of both.
    """
    sizes = np.linalg.norm(columns, axis=0)
    usable = sizes > 1e-6 * sizes.max()
    scale = np.where(usable, sizes, 1.0) / np.sqrt(len(weighted))
    folds = list(GroupKFold(FOLDS).split(columns, groups=setups))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        found = LassoCV(
            eps=0.03, alphas=12, cv=folds, fit_intercept=False, max_iter=150, tol=1e-3
        ).fit(np.where(usable, columns / scale, 0.0), weighted)
    return np.where(usable, found.coef_ / scale, 0.0), sizes


def _is_own(term: tuple[tuple[str, ...], str], cause: Cause) -> str:
    """Whether a term of the library is what the cause does: its quantities and its direction.

    Through an angle also a lever, a position or tool offset; a warm-up may be a power of time.
    """
    names = set(term[0])
    if not cause.answers:
        return "yes" if names == set(cause.depends) else "no"
    kind, where = cause.answers[0]
    wanted = {
        "backlash": [{f"{where.get('axis')}_dir"}],
        "feed_lag": [{f"{where.get('axis')}_dir", "feed"}],
        "scale_expansion": [{str(where.get("axis")), "T_amb"}],
        "thermal_offset": [{str(where.get("signal"))}],
        "warm_up": [{"t"}],
        "cross_angular": [{str(where.get("by"))}],
        "thermal_tilt": [{"T_col_front"}, {"T_col_rear"}],
    }.get(kind, [])
    levers = {"X", "Y", "Z", "tool_x", "tool_y", "tool_z"} if "about" in where else set()
    own = any(w <= names and names <= w | levers for w in wanted)
    if levers:
        towards = set("XYZ") - {str(where["about"])}
    else:
        towards = {str(where.get("axis", where.get("direction")))}
    return "yes" if own and term[1] in towards else "no"


def _table(outcomes: Sequence[Outcome]) -> str:
    lines = [
        "| hidden | machine | nothing added | knows it | Abbe | Gaussian process | boosting "
        "| Lasso | Abbe says | Lasso keeps | largest term | the cause's own |",
        "| --- | --- |" + " ---: |" * 6 + " --- | ---: | --- | --- |",
    ]
    for o in outcomes:
        figures = (o.before, o.oracle, o.abbe, o.process, o.boosting, o.lasso)
        told = " | ".join("–" if np.isnan(f) else f"{1e3 * f:.3f}" for f in figures)
        lines.append(
            f"| {' + '.join(o.scenario.causes) or 'nothing'} | {o.scenario.kind} | {told} | "
            f"{o.said} | {o.kept} | {o.leading} | {o.leads} |"
        )
    return "\n".join(lines)


def _summary(outcomes: Sequence[Outcome]) -> str:
    lines = []
    for name, label in (
        ("abbe", "Abbe"),
        ("process", "Gaussian process"),
        ("boosting", "gradient boosting"),
        ("lasso", "Lasso"),
    ):
        other = [getattr(o, name) / o.before for o in outcomes]
        best = sum(
            getattr(o, name) <= 1.005 * min(o.abbe, o.process, o.boosting, o.lasso)
            for o in outcomes
        )
        worse = sum(r > 1.005 for r in other)
        lines.append(
            f"- {label}: unseen RMS falls to {np.median(other):.2f} of what it was (median), "
            f"best or within 0.5 % of the best in {best} of {len(outcomes)}, worse than adding "
            f"nothing in {worse}"
        )
    return "\n".join(lines)


TEXT = f"""## Beside a black box and a sparse regression

`python -m benchmarks.black_box`: scenarios of the diagnosis benchmark at {MULTIPLE} × noise; RMS in
µm on 36 lines of another day that nothing was fitted to. All start from the same fitted model.
*Abbe*: one `diagnose`, what it established added, refitted (what it calls the instrument's is not
added; where it says `unexplained`, the empirical formula that it offers, if any).
*Gaussian process*, *boosting*: scikit-learn, fitted to that model's residuals per measured
direction, from positions, directions of approach, tool, temperatures, feed, load, time and the
measured direction itself; the process has one length scale for each, learnt from {SUBSAMPLE} rows,
and then takes all rows. *Lasso*: LassoCV, set-ups left out whole, over all products of up to three
of these (tools apart) times each component of the direction, with what the model and the set-ups
imitate taken out of all columns. In every case the
model is fitted again to what is left, so that nobody suffers from what the first fit absorbed.
*Knows it*: the model with the true effect, where the catalogue has it."""


def main() -> None:
    """Run, print, write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    chosen = [
        s
        for s in scenarios()
        if s.multiple == MULTIPLE and len(s.causes) == 1 and s.causes[0] in HIDDEN
    ]
    chosen.append(next(s for s in scenarios() if not s.causes))
    if options.quick:
        chosen = chosen[:2]
    outcomes = []
    began = time.perf_counter()
    with ProcessPoolExecutor(options.workers) as pool:
        for outcome in pool.map(run, chosen):
            outcomes.append(outcome)
            print(
                _table([outcome]).splitlines()[-1],
                f"{time.perf_counter() - began:.0f} s",
                flush=True,
            )
    print(_summary(outcomes))
    if not options.quick:
        parts = [TEXT, _table(outcomes), _summary(outcomes)]
        write_section("black-box", "\n\n".join(parts), page=VALIDATION)


if __name__ == "__main__":
    main()
