"""The answer of ``abbe identify-convention``: as JSON and as text; differences in µm."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from abbe.compcore.maps.convention import Convention, selectors
from abbe.compcore.maps.conventions.hypotheses import Hypothesis
from abbe.compcore.maps.conventions.identify import Identification
from abbe.compcore.maps.conventions.ranking import DistinguishingPose, RankedHypothesis, Tie
from abbe.compcore.maps.table import COLUMNS, COMPONENTS
from abbe.compcore.units import in_digits
from abbe.daemon.answers.typed import free_name

_MOST_LISTED = 6


def import_command(
    found: Identification, source: str | None, squareness: Sequence[str] = ()
) -> str | None:
    """The command that imports the map as the best hypothesis has it; None where there is none.

    `source` is the map's file (None: the subject was a model), `squareness` what was stated beside
    it, as it was typed.
    """
    h = found.best.hypothesis
    if source is None or found.verdict == "none" or h.artefact:
        return None
    words = ["abbe import-map", shlex.quote(source), f'--structure "{h.structure}"']
    words += [f"--squareness {shlex.quote(text)}" for text in squareness]
    if options := h.convention.options(h.structure.linear):
        words.append(options)
    return " ".join([*words, f"-o {free_name(Path('model.toml'))}"])


def as_json(found: Identification, command: str | None = None) -> dict[str, Any]:
    """One object for ``--json``; `command` as `import_command` tells it."""
    return {
        "verdict": found.verdict,
        "n": found.n,
        "unit": "um",
        "observed_rms": found.observed_rms * 1e3,
        "rounding_sd": found.sigma * 1e3,
        "tolerance": found.tolerance * 1e3,
        "opposite_sign": found.opposite,
        "gain": found.gain,
        "best": _judged(found, found.best),
        "import_command": command,
        "if_measured_otherwise": None if found.twin is None else _hypothesis(found, found.twin),
        "rotation_point": {
            "unit": "mm",
            "estimate": dict(found.point.position),
            "sd": dict(found.point.sd),
            "undetermined": list(found.point.undetermined),
        },
        "changes": [_judged(found, j) for j in found.changes],
        "ties": [_tie(found, t) for t in found.ties],
        "open_columns": open_columns(found),
        "ranking": [_judged(found, j) for j in found.ranking],
    }


def _hypothesis(found: Identification, h: Hypothesis) -> dict[str, Any]:
    c = h.convention
    return {
        "convention": h.describe(found.stated),
        "structure": str(h.structure),
        "options": c.options(h.structure.linear),
        "reversed": sorted(f"{a}.{COLUMNS[COMPONENTS.index(k)]}" for a, k in c.reversed),
        "rotation_point": None if c.rotation_point is None else dict(c.rotation_point),
        "own_travel": c.own_travel,
        "squareness": c.squareness,
        "stated_squareness": c.stated,
        "artefact": h.artefact,
    }


def _judged(found: Identification, judged: RankedHypothesis) -> dict[str, Any]:
    return {
        **_hypothesis(found, judged.hypothesis),
        "rms": judged.rms * 1e3,
        "max": judged.worst * 1e3,
    }


def _tie(found: Identification, tie: Tie) -> dict[str, Any]:
    t = tie.telling
    return {
        **_judged(found, tie.judged),
        "told_by": None
        if t is None
        else {**t.positions, "tool": list(t.tool), "difference": t.difference * 1e3},
    }


def open_columns(found: Identification) -> list[str]:
    """Columns whose sign these points cannot show: ``Z.Rx``."""
    return [f"{a}.{COLUMNS[COMPONENTS.index(k)]}" for a, k in found.unseen if a]


def as_text(found: Identification, command: str | None = None) -> Iterator[str]:
    """Lines for people; `command` as `import_command` tells it."""
    digit = "not rounded" if not found.sigma else f"rounding {_um(found.sigma)} µm"
    yield (
        f"{found.n} points: the correction does {_um(found.observed_rms)} µm RMS there ({digit})."
    )
    yield ""
    yield _headline(found)
    best = found.best
    yield (
        f"    left unexplained: RMS {_um(best.rms)} µm, greatest {_um(best.worst)} µm "
        f"(reproduced means RMS up to {_um(found.tolerance)} µm)"
    )
    yield from _sign_story(found)
    if found.verdict == "none":
        yield (
            "    Another map, another chain order (--any-order), a correction of temperature or "
            "of the tool besides the map, or a convention that Abbe does not know."
        )
    yield ""
    yield from _point_story(found)
    if found.ties or found.unseen:
        yield ""
        yield from _open_questions(found)
    if found.changes:
        yield ""
        reported = [(_difference(found, j.hypothesis), j) for j in found.changes]
        width = max(len(words) for words, _ in reported)
        yield f"{'If one thing were otherwise':<{width + 2}}    RMS µm   greatest µm"
        for words, judged in reported:
            yield f"  {words:<{width}} {judged.rms * 1e3:>9.2f} {judged.worst * 1e3:>13.2f}"
    if command is not None:
        yield ""
        yield "The same map in Abbe's conventions:"
        yield f"  {command}"


def _headline(found: Identification) -> str:
    words = found.best.hypothesis.describe(found.stated)
    return {
        "identified": f"Identified: {words}.",
        "ambiguous": f"Not settled: {words}, or one of those below, all as good.",
        "none": f"None reproduces the points. The closest: {words}.",
    }[found.verdict]


def _sign_story(found: Identification) -> Iterator[str]:
    if not found.opposite:
        return
    if found.best.hypothesis.artefact:
        yield "    The differences have the opposite sign of the map: what one gets from measuring"
        yield "    an artefact instead of switching the correction on and off at standing points."
    else:
        yield "    The linear errors appear with the opposite sign of the map."
    if found.twin is not None:
        other = found.twin.describe(found.stated)
        how = "switched on and off" if found.best.hypothesis.artefact else "measured on an artefact"
        yield f"    If these points were {how}, they mean: {other}."
    else:
        yield "    Or the columns of on and off are exchanged."


def _point_story(found: Identification) -> Iterator[str]:
    point = found.point
    reported = [
        f"{axis} {point.position[axis] + 0.0:.1f} ± {sd:.1f} mm" for axis, sd in point.sd.items()
    ]
    if reported:
        yield "Rotation point by least squares: " + ", ".join(reported) + "."
    if point.undetermined:
        yield (
            "Not determined: its " + ", ".join(point.undetermined) + " (no lever of any angular "
            "error that these points show)."
        )


def _open_questions(found: Identification) -> Iterator[str]:
    yield "What these points cannot tell:"
    if found.unseen:
        yield f"  the signs of {', '.join(open_columns(found))}: they do next to nothing here"
    for tie in found.ties[:_MOST_LISTED]:
        words = _difference(found, tie.judged.hypothesis)
        if tie.telling is None:
            yield f"  {words}: no point in the volume would (nor does it matter)"
        else:
            yield f"  {words}: {_pose(tie.telling)} would"
    if len(found.ties) > _MOST_LISTED:
        yield f"  and {len(found.ties) - _MOST_LISTED} more (--json lists all)"


def _pose(telling: DistinguishingPose) -> str:
    where = " ".join(f"{a}={q:g}" for a, q in telling.positions.items())
    if any(telling.tool):
        where += " tool=" + ",".join(f"{v:g}" for v in telling.tool)
    return f"{where} ({telling.difference * 1e3:.1f} µm apart)"


def _difference(found: Identification, other: Hypothesis) -> str:
    """In what a hypothesis differs from the best, in few words."""
    best = found.best.hypothesis
    mine, theirs = best.convention, other.convention
    words = []
    if other.structure != best.structure:
        words.append(f"chain {' '.join(other.structure.axes)}")
    turned = selectors(mine.reversed ^ theirs.reversed, found.stated.linear)
    if turned:
        words.append(f"the sign{'s' if len(turned) > 1 else ''} of {', '.join(turned)} reversed")
    if _point(theirs) != _point(mine):
        words.append(f"rotation point {_point(theirs)}")
    if theirs.own_travel != mine.own_travel:
        words.append(f"own travel in the lever: {theirs.own_travel}")
    if theirs.squareness != mine.squareness:
        how = "" if theirs.squareness == "as written" else "as "
        words.append(f"the map's own squareness {how}{theirs.squareness}")
    if theirs.stated != mine.stated:
        words.append(f"the stated squareness as {theirs.stated}")
    if other.artefact != best.artefact:
        words.append("measured on an artefact" if other.artefact else "switched on and off")
    return "; ".join(words) or "the same"


def _point(convention: Convention) -> str:
    if convention.rotation_point is None:
        return "as the model has it"
    placed = {a: p for a, p in convention.rotation_point.items() if p != 0.0}
    return ", ".join(f"{a}={p:g}" for a, p in placed.items()) or "zero"


def _um(millimetres: float) -> str:
    return in_digits(millimetres * 1e3)
