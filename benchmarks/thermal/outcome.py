"""What came out of one run of thermal days, and the file that keeps outcomes between runs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from abbe.compcore.files.text.atomic import write_atomically


@dataclass(frozen=True)
class Outcome:
    """One run.

    Attributes
    ----------
    scenario, seed
        Which one.
    rms
        On later days, µm: ``before`` (nothing added), ``floor`` (the noise), ``abbe``,
        ``spreadsheet``, ``process``, ``boosting``.
    named
        Specs of the effects that were added, in their order.
    false
        Those of them that nothing in the simulated shop can have caused.
    wanted
        Directions in which the machine moves by more than the noise, with what drives them there.
    first
        Whether the first effect is a plausible cause.
    seconds
        CPU time of Abbe's loop.
    """

    scenario: str
    seed: int
    rms: Mapping[str, float]
    named: tuple[str, ...]
    false: tuple[str, ...]
    wanted: tuple[str, ...]
    first: bool
    seconds: float


def of_line(line: str) -> Outcome:
    """The outcome of a line of JSON."""
    kept = json.loads(line)
    for key in ("named", "false", "wanted"):
        kept[key] = tuple(kept[key])
    return Outcome(**kept)


def as_line(outcome: Outcome) -> str:
    """An outcome as a line of JSON, without its end."""
    return json.dumps(asdict(outcome))


def read(path: Path) -> list[Outcome]:
    """Outcomes of a file; none where there is no file."""
    if not path.exists():
        return []
    return [of_line(line) for line in path.read_text(encoding="utf-8").splitlines()]


def write(path: Path, outcomes: Iterable[Outcome]) -> None:
    """Write outcomes to a file, one a line."""
    write_atomically(path, "".join(as_line(o) + "\n" for o in outcomes))
