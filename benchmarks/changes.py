"""Is what changed in a machine named? Fitted models, one effect moved, new campaigns.

``python -m benchmarks.changes`` prints one line for each change and a summary: a fitted model's
effect is moved so that the new campaign shows it at 3, 6 and 12 times the noise; two effects; none.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.changed import standing
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model, Value
from benchmarks.hidden.campaigns.campaign import STRUCTURES
from benchmarks.hidden.campaigns.measuring import NOISE
from benchmarks.hidden.judging.trial import as_campaign
from benchmarks.hidden.scenes.scene import scene

MULTIPLES = (3, 6, 12)


def moved(model: Model, campaign: Campaign, term: int, size: float, seed: int) -> Model:
    """A model of which one effect moved; rows of a campaign show it by `size` at most, mm."""
    rng = np.random.default_rng(seed)
    result = fit(model, campaign)
    problem = result.problem
    where = problem.layout.linear_of(term)
    columns = problem.eliminator(result.theta).project(problem.columns(result.theta)[:, where])
    by = rng.normal(size=where.stop - where.start)
    seen = float(np.abs((columns @ by) * problem.sd).max())
    if seen <= 0.0:
        return model
    values = dict(model.terms[term].values)
    for (name, value), step in zip(list(values.items()), by * size / seen, strict=False):
        values[name] = Value(value.value + float(step), value.sd)
    terms = list(model.terms)
    terms[term] = replace(terms[term], values=values)
    return replace(model, terms=tuple(terms))


def trials(count: int) -> Iterator[tuple[str, int, list[str], list[str]]]:
    """What changed, how large, its specs, and the specs that were named."""
    for number in range(count):
        kind = list(STRUCTURES)[number % len(STRUCTURES)]
        stage = scene(900 + number, kind)
        model = parse_model(TomlSource(stage.model_text()))
        before = as_campaign(stage.simulate([]).text, model)
        after = as_campaign(scene(900 + number, kind).simulate([], held_out=True).text, model)
        fitted = fit(model, before).model
        result = fit(fitted, after)
        none = standing(fitted, result.thin)
        yield "nothing", 0, [], [] if none is None else [c.effect.spec for c in none.changes]
        kinds = list(dict.fromkeys(e.kind for e in fitted.effects))
        rng = np.random.default_rng(number)
        for name in kinds:
            own = [i for i, e in enumerate(fitted.effects) if e.kind == name]
            term = int(rng.choice(own))
            for multiple in MULTIPLES:
                given = moved(fitted, after, term, multiple * NOISE, number)
                found = standing(given, fit(given, after).thin)
                named = [] if found is None else [c.effect.spec for c in found.changes]
                yield name, multiple, [fitted.effects[term].spec], named


def main() -> None:
    """Run, print every line and the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=10)
    counts: Counter[tuple[str, int, str]] = Counter()
    for name, multiple, true, named in trials(parser.parse_args().campaigns):
        if named == true:
            score = "right"
        elif set(true) <= set(named):
            score = "with others"
        else:
            score = "nothing named" if not named else "another"
        counts[name, multiple, score] += 1
        print(f"{name:20} {multiple:2}× {score:14} {'; '.join(named)}", flush=True)
    for key, count in sorted(counts.items()):
        print(*key, count)


if __name__ == "__main__":
    main()
