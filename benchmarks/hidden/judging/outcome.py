"""What came out of one scenario, and the file that keeps outcomes between runs."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from abbe.compcore.files.text.atomic import write_atomically
from benchmarks.hidden.scenario import Scenario


@dataclass(frozen=True)
class Outcome:
    """What the diagnosis made of a scenario, and what the others made of it.

    Attributes
    ----------
    verdict, named, offered
        The verdict; the specs of the established causes, best first; the formula that is offered
        for what no cause explains, empty where there is none.
    score
        See `score`.
    catalogued
        Whether the catalogue has an effect for everything that is hidden.
    rms
        On unseen lines, mm: ``before``, with nothing added; ``oracle``, who knows the truth;
        ``abbe``, ``process``, ``boosting``, ``lasso``. NaN where it was not tried.
    kept, leading
        How many terms the Lasso keeps; the largest ones.
    readable
        Whether those name what is hidden: ``yes``, ``no``, ``–`` where nothing is.
    seconds
        CPU time of the diagnosis (``abbe``) and of each learner.
    """

    scenario: Scenario
    verdict: str
    named: tuple[str, ...]
    offered: str
    score: str
    catalogued: bool
    rms: Mapping[str, float]
    kept: int
    leading: tuple[str, ...]
    readable: str
    seconds: Mapping[str, float]

    @property
    def ratio(self) -> float:
        """RMS on unseen lines with what Abbe adds, over the oracle's."""
        return self.rms["abbe"] / self.rms["oracle"]

    @property
    def falls(self) -> float:
        """RMS on unseen lines with what Abbe adds, over that before."""
        return self.rms["abbe"] / self.rms["before"]


def of_line(line: str) -> Outcome:
    """The outcome of a line of JSON."""
    data = json.loads(line)
    scenario = data.pop("scenario")
    scenario["causes"] = tuple(scenario["causes"])
    rms = {k: math.nan if v is None else v for k, v in data.pop("rms").items()}
    for name in ("named", "leading"):
        data[name] = tuple(data[name])
    return Outcome(Scenario(**scenario), rms=rms, **data)


def as_line(outcome: Outcome) -> str:
    """An outcome as a line of JSON, without its end."""
    data = asdict(outcome)
    data["rms"] = {k: None if math.isnan(v) else v for k, v in data["rms"].items()}
    return json.dumps(data, ensure_ascii=False)


def read(path: Path) -> list[Outcome]:
    """The outcomes in a file, one JSON object a line; none where there is no file."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else ()
    return [of_line(line) for line in lines]


def write(path: Path, outcomes: Iterable[Outcome]) -> None:
    """Put outcomes into a file, in place of what it held."""
    write_atomically(path, "".join(as_line(outcome) + "\n" for outcome in outcomes))
