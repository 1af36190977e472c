"""Does the diagnosis name hidden causes? Many campaigns with known answers, one table.

``python -m benchmarks.diagnosis`` runs all scenarios (about half an hour on two cores) and writes
the section of docs/validation.md; ``--quick`` runs a few and writes nothing; ``--only NAME`` runs
one cause.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.hidden.scenario import MULTIPLES, Scenario, hide, scenarios
from benchmarks.hidden.scene import scene
from benchmarks.hidden.score import score
from benchmarks.report import write_section
from compcore.campaign import Campaign
from compcore.campaign_file import read_campaign
from compcore.compare import compare
from compcore.diagnose import diagnose
from compcore.effects import make_effect
from compcore.effects.base import Effect
from compcore.fit import fit
from compcore.model import Model
from compcore.model_file import parse_model
from compcore.revise import with_effect
from compcore.toml_source import TomlSource


@dataclass(frozen=True)
class Outcome:
    """What the diagnosis made of a scenario.

    Attributes
    ----------
    verdict, named
        The verdict; the specs of the established causes, best first.
    score
        ``named``; ``alias``: not first, but among what was declared confusable, and the truth
        explains no more than what was named; ``separable alias``: it explains more; ``wrong``,
        ``missed``; ``too small``: nothing said, and who knows the truth finds no evidence for it
        either. Nothing hidden: ``right``, ``false alarm``. For what is in no catalogue
        ``described``, ``named a cause`` or ``missed``.
    ratio
        Held-out RMS after adding what was named over the oracle's, who knows the truth.
    falls
        Held-out RMS after over before.
    """

    scenario: Scenario
    verdict: str
    named: tuple[str, ...]
    score: str
    ratio: float
    falls: float
    seconds: float


def as_campaign(text: str, model: Model) -> Campaign:
    """A simulated campaign's text as the reader of campaign files takes it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "campaign.csv"
        path.write_text(text, encoding="utf-8")
        return read_campaign(path, model.machine)


def run(scenario: Scenario) -> Outcome:
    """Simulate, diagnose, add what was named, look at unseen lines."""
    stage = scene(scenario.seed, scenario.kind)
    hidden = hide(scenario, stage)
    omits = [cause.omits for cause, _ in hidden if cause.omits]
    model = parse_model(TomlSource(stage.model_text(omits)))
    campaign = as_campaign(stage.simulate(hidden).text, model)
    unseen = as_campaign(stage.simulate(hidden, held_out=True).text, model)
    start = time.perf_counter()
    diagnosis = diagnose(model, campaign)
    seconds = time.perf_counter() - start
    named = [e.found.candidate.effect for e in diagnosis.established]
    before = _held_out(model, [], campaign, unseen)
    after = _held_out(model, named, campaign, unseen) if named else before
    true = [c.answers[0] for c, _ in hidden if c.answers]
    oracle = _held_out(model, [make_effect(k, w) for k, w in true], campaign, unseen)
    return Outcome(
        scenario,
        diagnosis.verdict,
        tuple(e.spec for e in named),
        score(diagnosis, [c for c, _ in hidden]),
        after / oracle if len(true) == len(hidden) else float("nan"),
        after / before,
        seconds,
    )


def _held_out(
    model: Model, effects: Sequence[Effect], campaign: Campaign, unseen: Campaign
) -> float:
    """RMS on unseen lines after adding effects that are not the instrument's, mm."""
    for effect in effects:
        if effect.scope != "instrument":
            model, _ = with_effect(model, effect.kind, effect.where())
    fitted = fit(model, campaign).model
    return compare(fitted, unseen).lengths.rms


def _table(outcomes: Sequence[Outcome]) -> str:
    """The confusion table and the failures, as Markdown."""
    lines = [
        "| hidden | size | campaigns | outcome | held-out RMS over the oracle's |",
        "| --- | --- | --- | --- | --- |",
    ]
    groups: dict[tuple[str, int], list[Outcome]] = {}
    for o in outcomes:
        names = o.scenario.causes
        label = "nothing" if not names else " + ".join(names)
        groups.setdefault((label, o.scenario.multiple), []).append(o)
    for (label, multiple), group in groups.items():
        counts = ", ".join(f"{n} {s}" for s, n in Counter(o.score for o in group).most_common())
        ratios = [o.ratio for o in group if np.isfinite(o.ratio)]
        ratio = f"{np.median(ratios):.2f}" if ratios else "–"
        size = f"{multiple} × noise" if multiple else "–"
        lines.append(f"| {label} | {size} | {len(group)} | {counts} | {ratio} |")
    failures = [o for o in outcomes if o.score not in ("named", "right", "described")]
    lines += [
        "",
        f"Median time of a diagnosis: {np.median([o.seconds for o in outcomes]):.1f} s.",
        "",
        "What was not named first, and what was said instead:",
        "",
    ]
    for o in failures:
        s = o.scenario
        said = "; ".join(o.named) or o.verdict
        lines.append(
            f"- {' + '.join(s.causes) or 'nothing'} at {s.multiple}× ({s.kind}, seed {s.seed}): "
            f"{o.score}: {said}"
        )
    return "\n".join(lines)


def _summary(outcomes: Sequence[Outcome]) -> str:
    lines = []
    unknown = {o.scenario.causes for o in outcomes if np.isnan(o.ratio)}
    for multiple in MULTIPLES:
        single = [
            o
            for o in outcomes
            if o.scenario.multiple == multiple
            and len(o.scenario.causes) == 1
            and o.scenario.causes not in unknown
        ]
        if single:
            count = Counter(o.score for o in single)
            near = sum(o.ratio <= 1.1 for o in single)
            lines.append(
                f"- one cause at {multiple} × noise: {count['named']} of {len(single)} named "
                f"first, {count['alias']} more among the declared aliases and not to be told from "
                f"what was named, {count['too small']} too small to be seen by who knows the "
                f"truth, {count['missed']} missed, "
                f"{count['wrong'] + count['separable alias']} wrong; "
                f"{near} within 10 % of the oracle on unseen lines"
            )
    empty = [o for o in outcomes if not o.scenario.causes]
    if empty:
        right = sum(o.score == "right" for o in empty)
        lines.append(f"- nothing hidden: {right} of {len(empty)} told complete")
    other = [o for o in outcomes if len(o.scenario.causes) == 1 and o.scenario.causes in unknown]
    if other:
        good = sum(o.score == "described" for o in other)
        lines.append(f"- in no catalogue: {good} of {len(other)} described, without a wrong name")
    pairs = [o for o in outcomes if len(o.scenario.causes) == 2]
    if pairs:
        good = sum(o.score == "named" for o in pairs)
        lines.append(f"- two at once: {good} of {len(pairs)} with all catalogue causes named")
    return "\n".join(lines)


def main() -> None:
    """Run the scenarios, print, write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", default=None)
    parser.add_argument("--empty", type=int, default=None)
    parser.add_argument("--sizes", type=int, nargs="*", default=list(MULTIPLES))
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    chosen = list(scenarios())
    if options.only:
        chosen = [s for s in chosen if options.only in s.causes]
    chosen = [s for s in chosen if not s.causes or s.multiple in options.sizes]
    if options.empty is not None:
        kept = [s for s in chosen if s.causes]
        chosen = kept + [s for s in chosen if not s.causes][: options.empty]
    if options.quick:
        chosen = [s for s in chosen if s.multiple in (0, 6)][:: max(1, len(chosen) // 12)]
    outcomes = []
    with ProcessPoolExecutor(options.workers) as pool:
        for outcome in pool.map(run, chosen):
            outcomes.append(outcome)
            s = outcome.scenario
            print(
                f"{' + '.join(s.causes) or 'nothing':40} {s.multiple:2}× {s.kind:7} {s.seed} "
                f"{outcome.score:12} {outcome.ratio:5.2f} {outcome.seconds:5.1f} s  "
                f"{'; '.join(outcome.named) or outcome.verdict}",
                flush=True,
            )
    print(_summary(outcomes))
    if not (options.quick or options.only):
        text = f"{_HEADING}\n\n{_summary(outcomes)}\n\n{_table(outcomes)}"
        write_section("diagnosis", text, page=VALIDATION)


_HEADING = """## Hidden causes: are they named?

`python -m benchmarks.diagnosis`: simulated campaigns (exact chain, other shapes than the model's,
drifting temperatures, master points, 0.5 µm + 0.3 ppm of noise) over five structures, with causes
hidden in them. The size is the greatest contribution to a row beyond its set-up's mean. *alias*:
named among what the campaign cannot tell from the leader. *described*: the verdict is
`unexplained` and names what the structure depends on."""

VALIDATION = Path(__file__).parents[1] / "docs" / "validation.md"

if __name__ == "__main__":
    main()
