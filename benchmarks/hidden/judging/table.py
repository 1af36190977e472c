"""The table of all scenarios and what it says in sum, as Markdown."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Sequence

import numpy as np

from benchmarks.hidden.judging.outcome import Outcome
from benchmarks.hidden.scenario import MULTIPLES

METHODS = {
    "before": "before",
    "oracle": "oracle",
    "abbe": "Abbe",
    "process": "Gaussian process",
    "boosting": "boosting",
    "lasso": "Lasso",
}
RIGHT = ("named", "right", "described")
NEAR = 1.1
"""Over the oracle's RMS: what counts as near to it."""
SAME = 1.005
"""RMS within this of another's is as good."""

HEADING = """## Hidden causes: are they named, and what do others make of them?

`python -m benchmarks.diagnosis`: simulated campaigns (exact chain, other shapes than the model's,
drifting temperatures, 0.5 µm + 0.3 ppm of noise), with causes hidden in them. The size is the
greatest contribution to a row beyond its set-up's mean. *alias*: named among what the campaign
cannot tell from the leader. *described*: the verdict is `unexplained` and names what the structure
depends on.

Five machines with three linear axes, whose users model all 21 error motions and the scales'
expansion, are measured in three rounds through a day: laser lines, straightness, angles, diagonals,
three tools, a master point between. Where such a model would imitate the cause, or such a campaign
could not show it, others stand in: machines with few errors and users who model no more; machines
with rotary axes and a ball on the table; lasers that stay all day with one zero, in air whose
pressure changes; displacements read against one zero; a ball plate in a fixture; one thermometer
for all scales; distances from four base points.

Held-out RMS in µm: lines of another day that nothing was fitted to, measured by a faultless
instrument. *Before*: the user's model, fitted. *Oracle*: with the true effect added (where the
catalogue has none, the true formula). *Abbe*: one `diagnose`, what it established added, and the
formula that it offers for what no cause explains. The others learn what the same fitted model
leaves in each measured direction, from positions (of rotary axes sine and cosine), directions of
approach, tool, temperatures, feed, load, time and the direction itself, of distances also the base
point. {settings}, with what the model and the set-ups imitate taken out of all columns; of
distances also their length and base points. In every case the model is fitted again to what is
left, and what was found of the instrument is kept out of the compensation.

*Readable*: whether the Lasso's largest terms (as many as causes are hidden) are the cause's own
recorded quantities in its own direction."""


def line(o: Outcome) -> str:
    """One outcome, for the terminal."""
    s = o.scenario
    rms = " ".join(f"{1e3 * v:6.3f}" for v in o.rms.values())
    cpu = " ".join(f"{v:.1f}" for v in o.seconds.values())
    said = "; ".join(o.named) or o.verdict
    return (
        f"{s.label:40} {s.multiple:2}× {s.kind:7} {s.seed} {o.score:12} {o.ratio:5.2f} | {rms} | "
        f"{cpu} s | {o.readable} {', '.join(o.leading)} | {said} {o.offered}"
    )


def section(outcomes: Sequence[Outcome], settings: str) -> str:
    """Everything that the page says; `settings`: of the learners, in words."""
    text = HEADING.format(settings=settings).split("\n\n")
    heading = [textwrap.fill(part, 100, break_on_hyphens=False) for part in text]
    return "\n\n".join([*heading, summary(outcomes), table(outcomes), _failures(outcomes)])


def table(outcomes: Sequence[Outcome]) -> str:
    """One line for each cause and size; of several campaigns the counts and the medians."""
    lines = [
        "| hidden | size | outcome | " + " | ".join(METHODS.values()) + " | readable |",
        "| --- | --- | --- |" + " ---: |" * len(METHODS) + " --- |",
    ]
    groups: dict[tuple[str, int], list[Outcome]] = {}
    for o in outcomes:
        groups.setdefault((o.scenario.label, o.scenario.multiple), []).append(o)
    for (label, multiple), group in groups.items():
        several = len(group) > 1
        label += f" ({len(group)} campaigns; medians)" if several else ""
        counts = Counter(o.score for o in group).most_common()
        scores = ", ".join(f"{n} {s}" if several else s for s, n in counts)
        figures = [_micrometres(float(np.median([o.rms[m] for o in group]))) for m in METHODS]
        yes = sum(o.readable == "yes" for o in group)
        read = f"{yes} of {len(group)}" if several and multiple else group[0].readable
        size = f"{multiple}×" if multiple else "–"
        lines.append(f"| {label} | {size} | {scores} | {' | '.join(figures)} | {read} |")
    return "\n".join(lines)


def _micrometres(rms: float) -> str:
    return "–" if np.isnan(rms) else f"{1e3 * rms:.3f}"


def _failures(outcomes: Sequence[Outcome]) -> str:
    """What was not named first, and what was said instead."""
    lines = ["What was not named first, and what was said instead:", ""]
    for o in outcomes:
        s = o.scenario
        if o.score not in RIGHT:
            said = "; ".join(o.named) or o.verdict
            lines.append(
                f"- {s.label} at {s.multiple}× ({s.kind}, seed {s.seed}): {o.score}: {said}"
            )
    far = [o for o in outcomes if o.ratio > NEAR]
    if far:
        lines += ["", f"Further than {NEAR - 1:.0%} from the oracle on unseen lines:", ""]
        lines += [
            f"- {o.scenario.label} at {o.scenario.multiple}× ({o.scenario.kind}, seed "
            f"{o.scenario.seed}): {o.ratio:.2f}"
            for o in far
        ]
    return "\n".join(lines)


def summary(outcomes: Sequence[Outcome]) -> str:
    """Counts, as a list."""
    return "\n".join([*_by_size(outcomes), *_others(outcomes), *_methods(outcomes)])


def _by_size(outcomes: Sequence[Outcome]) -> list[str]:
    lines = []
    for multiple in MULTIPLES:
        single = [
            o
            for o in outcomes
            if o.scenario.multiple == multiple and len(o.scenario.causes) == 1 and o.catalogued
        ]
        if single:
            count = Counter(o.score for o in single)
            lines.append(
                f"- one cause at {multiple} × noise: {count['named']} of {len(single)} named "
                f"first, {count['alias']} more among the declared aliases and not to be "
                f"distinguished from what was named, {count['too small']} too small to be seen "
                f"by who knows the truth, {count['missed']} missed, "
                f"{count['wrong'] + count['separable alias']} wrong; {_near(single)}"
            )
    return lines


def _others(outcomes: Sequence[Outcome]) -> list[str]:
    lines = []
    empty = [o for o in outcomes if not o.scenario.causes]
    if empty:
        right = sum(o.score == "right" for o in empty)
        lines.append(f"- nothing hidden: {right} of {len(empty)} called complete")
    other = [o for o in outcomes if len(o.scenario.causes) == 1 and not o.catalogued]
    if other:
        good = sum(o.score == "described" for o in other)
        offered = [o for o in other if o.offered]
        lines.append(
            f"- in no catalogue: {good} of {len(other)} described, without a wrong name; "
            f"{len(offered)} with a ready formula, {_near(offered)}"
        )
    pairs = [o for o in outcomes if len(o.scenario.causes) == 2]
    if pairs:
        good = sum(o.score == "named" for o in pairs)
        lines.append(
            f"- two at once: {good} of {len(pairs)} with all catalogue causes named; {_near(pairs)}"
        )
    return lines


def _near(outcomes: Sequence[Outcome]) -> str:
    known = [o for o in outcomes if np.isfinite(o.ratio)]
    near = sum(o.ratio <= NEAR for o in known)
    return f"{near} of {len(known)} within {NEAR - 1:.0%} of the oracle on unseen lines"


def _methods(outcomes: Sequence[Outcome]) -> list[str]:
    """Each method beside the others, where something is hidden and where nothing is."""
    tried = [o for o in outcomes if np.isfinite(o.rms["lasso"])]
    hidden = [o for o in tried if o.scenario.causes]
    empty = [o for o in tried if not o.scenario.causes]
    lines = []
    methods = ("abbe", "process", "boosting", "lasso")
    for method in methods if tried else ():
        text = []
        if hidden:
            falls = np.median([o.rms[method] / o.rms["before"] for o in hidden])
            best = sum(o.rms[method] <= SAME * min(o.rms[m] for m in methods) for o in hidden)
            known = [o for o in hidden if np.isfinite(o.rms["oracle"])]
            near = sum(o.rms[method] <= NEAR * o.rms["oracle"] for o in known)
            text += [
                f"unseen RMS falls to {falls:.2f} of what it was (median)",
                f"best or within {SAME - 1:.1%} of the best in {best} of {len(hidden)}",
                f"within {NEAR - 1:.0%} of the oracle in {near} of {len(known)}",
                f"worse than adding nothing in {_worse(hidden, method)}",
            ]
        if empty:
            text.append(
                f"where nothing is hidden, worse than adding nothing in "
                f"{_worse(empty, method)} of {len(empty)}"
            )
        seconds = np.median([o.seconds[method] for o in tried])
        text.append(f"{seconds:.1f} s of one processor a campaign (median)")
        lines.append(f"- {METHODS[method]}: " + "; ".join(text))
    if hidden:
        read = sum(o.readable == "yes" for o in hidden)
        right = sum(o.score in RIGHT for o in hidden)
        lines.append(
            f"- the cause can be read off the Lasso's largest terms in {read} of {len(hidden)}, "
            f"off Abbe's answer in {right}; the other two name nothing"
        )
    return lines


def _worse(outcomes: Sequence[Outcome], method: str) -> int:
    return sum(o.rms[method] > SAME * o.rms["before"] for o in outcomes)
