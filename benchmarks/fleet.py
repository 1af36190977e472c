"""Is a cause that machines show too weakly alone named together, and none in empty fleets?

``python -m benchmarks.fleet`` makes fleets of twelve bridge machines of one type, with a cause
hidden in five of them or in none, and writes the section of docs/validation.md. ``--keep FOLDER``
keeps what each campaign tells, and makes only what is not there.
"""

from __future__ import annotations

import argparse
import json
import pickle
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

from abbe.compcore.diagnosis import diagnose
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fleet.common_cause import ALIKE as ALIKE_EVIDENCE
from abbe.compcore.fleet.common_cause import ENOUGH, CommonCause, ranked_causes
from abbe.compcore.fleet.told import CampaignTold, diagnosed
from abbe.daemon.spreading.process_pool import ProcessPool
from abbe.daemon.spreading.spread import SpreadPlace, spread
from abbe.daemon.spreading.spread_work import SpreadTask
from benchmarks.hidden.campaigns.campaign import draw
from benchmarks.hidden.campaigns.measuring import NOISE
from benchmarks.hidden.judging.trial import as_campaign
from benchmarks.hidden.scenes.scene import Usual
from benchmarks.measuring.report import write_section

VALIDATION = Path(__file__).parents[1] / "docs" / "validation.md"
KIND = "bridge"
TYPE = 17
"""Seed of what may be hidden in machines of the type: the same axes and directions for all."""
FLEET, HAVING = 12, 5
FLEETS = 50
EMPTY = 20
"""Empty machines, of which the fleets are drawn."""
SIZES = {
    "thermal_offset": (3.0, 1.0),
    "thermal_bending": (3.0, 1.0),
    "backlash": (3.0,),
}
"""Cause → the most that it adds to a row, in noise."""
ALIKE = 0.2
"""Standard deviation of the cause's size over machines, as a part of it."""


@dataclass(frozen=True)
class Campaigned:
    """One machine measured once: its seed, and what is hidden in it, so large."""

    seed: int
    cause: str = ""
    multiple: float = 0.0

    @property
    def file(self) -> str:
        """Name of what is kept of it."""
        return f"{self.cause or 'nothing'}-{self.multiple:g}-{self.seed}.pickle"


def every(empty: int = EMPTY) -> Iterator[Campaigned]:
    """All campaigns: with a cause, and without."""
    for i, (cause, sizes) in enumerate(SIZES.items()):
        for multiple in sizes:
            for k in range(HAVING):
                yield Campaigned(5000 + 100 * i + int(10 * multiple) + k, cause, multiple)
    for k in range(empty):
        yield Campaigned(7000 + 10 * (k // 4) + k % 4)


def tell(asked: Campaigned) -> CampaignTold:
    """Measure a machine, diagnose it alone; what that tells of all causes."""
    stage = Usual(draw(asked.seed, KIND), asked.seed)
    hidden = []
    if asked.cause:
        like = Usual(draw(TYPE, KIND), TYPE)
        cause = like.causes()[asked.cause]
        seen = like.simulate([(cause, cause.size)]).hidden
        size = cause.size * asked.multiple * NOISE / float(np.abs(seen).max())
        own = np.random.default_rng(asked.seed).normal(1.0, ALIKE)
        hidden = [(cause, size * float(own))]
    model = parse_model(TomlSource(stage.model_text()))
    campaign = as_campaign(stage.simulate(hidden).text, model)
    found = diagnosed(str(asked.seed), None, diagnose(model, campaign))
    return found.without_findings()


def told(_: Mapping[str, bytes], argument: str) -> bytes:
    """What a campaign tells, pickled; what a worker does."""
    return pickle.dumps(tell(Campaigned(**json.loads(argument))))


def kept(folder: Path, workers: int, empty: int) -> dict[Campaigned, CampaignTold]:
    """What each campaign tells, made where it is not kept yet."""
    folder.mkdir(parents=True, exist_ok=True)
    asked = list(every(empty))
    # some of each first, so that what was broken off is of use
    order = sorted(asked, key=lambda c: c.seed % 10)
    missing = [c for c in order if not (folder / c.file).exists()]
    tasks = [
        partial(SpreadTask, "benchmarks.fleet:told", json.dumps(asdict(c)), {}, c.file)
        for c in missing
    ]
    for number, body in spread(tasks, SpreadPlace(ProcessPool(workers)), "campaigns"):
        file = folder / missing[number].file
        file.with_suffix(".part").write_bytes(body)
        file.with_suffix(".part").rename(file)
        print(file.name, flush=True)
    return {c: pickle.loads((folder / c.file).read_bytes()) for c in asked}


@dataclass(frozen=True)
class Judged:
    """What became of one fleet.

    Attributes
    ----------
    cause, multiple
        What is hidden in five machines; empty: nothing.
    alone
        In how many of them its own campaign names something.
    named
        The strongest common cause, where one is named; empty: none.
    right
        Whether it is the hidden one, or one that is not told from it.
    on
        Of the machines that have it: how many are said to; of the others likewise.
    evidence
        Of the strongest, named or not.
    """

    cause: str
    multiple: float
    alone: int
    named: str
    right: bool
    on: tuple[int, int]
    evidence: float


def judged(told: dict[Campaigned, CampaignTold], fleets: int) -> Iterator[Judged]:
    """All fleets: with a cause, and without."""
    rng = np.random.default_rng(1)
    empty = [t for c, t in told.items() if not c.cause]
    like = Usual(draw(TYPE, KIND), TYPE).causes()
    for cause, sizes in SIZES.items():
        for multiple in sizes:
            having = [t for c, t in told.items() if (c.cause, c.multiple) == (cause, multiple)]
            others = [empty[i] for i in rng.choice(len(empty), FLEET - HAVING, replace=False)]
            yield _judged(having, others, cause, multiple, like[cause].answers)
    for _ in range(fleets):
        others = [empty[i] for i in rng.choice(len(empty), FLEET, replace=False)]
        yield _judged([], others, "", 0.0, ())


def _judged(
    having: Sequence[CampaignTold], others: Sequence[CampaignTold], cause: str, multiple: float,
    answers: Sequence[tuple[str, object]],
) -> Judged:  # fmt: skip
    ranked = ranked_causes([*having, *others])
    best: CommonCause | None = ranked[0] if ranked else None
    evidence = best.evidence if best is not None else 0.0
    named = best if best is not None and evidence > ENOUGH else None
    alike = [] if named is None else [w for w in ranked if w.evidence > evidence - ALIKE_EVIDENCE]
    right = any((w.effect.kind, w.effect.where()) in list(answers) for w in alike)
    on = (0, 0)
    if named is not None:
        on = (
            sum(t.name in named.having for t in having),
            sum(t.name in named.having for t in others),
        )
    alone = sum(bool(t.named) for t in having)
    spec = "" if named is None else named.effect.spec
    return Judged(cause, multiple, alone, spec, right, on, evidence)


def section(found: Sequence[Judged]) -> str:
    """The section of docs/validation.md."""
    lines = [
        "## Causes that several machines have in common",
        "",
        f"Fleets of {FLEET} {KIND} machines, each measured once; in {HAVING} of them the same "
        f"cause, its size over machines ± {100 * ALIKE:.0f} %. *3 ×*: it adds at most three times "
        f"the noise to a row. Without a cause: {sum(not j.cause for j in found)} fleets drawn of "
        f"{EMPTY} empty machines (`python -m benchmarks.fleet`).",
        "",
        "| hidden in 5 of 12 | size | named by their own campaigns | named together | said of: "
        "those that have it, the other 7 |",
        "| --- | --- | --- | --- | --- |",
    ]
    for j in found:
        if j.cause:
            what = f"`{j.named}`" + ("" if j.right else " (**not it**)") if j.named else "–"
            on = f"{j.on[0]} of {HAVING}, {j.on[1]}" if j.named else "–"
            lines.append(f"| {j.cause} | {j.multiple:g} × | {j.alone} | {what} | {on} |")
    empty = [j for j in found if not j.cause]
    false = sum(bool(j.named) for j in empty)
    most = max((j.evidence for j in empty), default=0.0)
    lines += [
        "",
        f"Empty fleets: {false} of {len(empty)} name a cause; the strongest evidence in any is "
        f"{most:.1f} ({ENOUGH:g} is enough).",
    ]
    return "\n".join(lines)


def main() -> None:
    """Make what is missing, judge, print, write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keep", type=Path, default=None)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--empty", type=int, default=EMPTY)
    parser.add_argument("--without-section", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        told = kept(options.keep or Path(made), options.workers, options.empty)
    found = list(judged(told, FLEETS))
    text = section(found)
    print(text)
    if not options.without_section:
        write_section("fleet", text, page=VALIDATION)


if __name__ == "__main__":
    main()
