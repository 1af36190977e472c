"""The answer of ``abbe check-point``: what the checks of a machine say, as text and JSON."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import require_signals
from abbe.compcore.model.model import Model
from abbe.compcore.monitoring.charts import ChartDesign
from abbe.compcore.monitoring.judgement import Judgement, judge
from abbe.compcore.monitoring.readings import PLACING
from abbe.compcore.monitoring.words import judgement_words

_LONG_AGO = 1e9
"""s since 1970: a clock that shows less began with the campaign."""
_SHOWN = 12
"""Series of the last check that are printed; all are in ``--json``."""


@dataclass(frozen=True, eq=False)
class CheckAnswer:
    """A machine's checks, judged.

    Attributes
    ----------
    judgement
        What they say.
    since
        From when on checks count, s since 1970; None: all.
    before
        How many rows are older.
    diagnosing
        The commands that hand the rows to a diagnosis.
    """

    judgement: Judgement
    since: float | None
    before: int
    diagnosing: str


def judged(
    model: Model, campaign: Campaign, design: ChartDesign, since: float | None, diagnosing: str
) -> CheckAnswer:
    """Judge the checks from a moment on.

    Raises
    ------
    InputError
        When none is so late, or a signal that the model reads was not recorded.
    """
    require_signals(campaign, model)
    time = campaign.conditions.time
    late = np.ones(campaign.n, dtype=np.bool_) if since is None else time >= since
    if not late.any():
        raise InputError(
            "all checks are older than what the model was fitted to"
            if since is not None
            else "no checks",
            field="--since",
            found=f"the last of {day(float(time.max()))}",
            expected=f"one since {day(since or 0.0)}, or an earlier --since",
        )
    known = campaign if late.all() else campaign.rows(late)
    return CheckAnswer(judge(model, known, design), since, int((~late).sum()), diagnosing)


def calibrated(model: Model) -> float | None:
    """When the machine was measured as its model has it, s since 1970; None: nobody has said.

    The newest date that a campaign of the fit states, or else the date of the fit.
    """
    stated = [
        moment
        for record in model.fit.get("campaigns", ())
        if (moment := _moment(record.get("conditions", {}).get("date"))) is not None
    ]
    return max(stated) if stated else _moment(model.fit.get("date"))


def _moment(value: object) -> float | None:
    if value is None:
        return None
    try:
        return datetime.fromisoformat(str(value).strip()).astimezone().timestamp()
    except (ValueError, OverflowError):
        return None


def placed(campaign: Campaign, when: float | None, now: float, *, lasting: bool) -> Campaign:
    """A campaign as checks: at its moment, its instruments placed for it alone.

    Parameters
    ----------
    when
        Of the first row, s since 1970; None: what the rows' clock says, or else `now` for the last.
    lasting
        Whether the artefacts stay where they are from check to check.
    """
    time = campaign.conditions.time
    if when is not None:
        time = time - time.min() + when
    elif float(time.min()) < _LONG_AGO:
        time = time - time.max() + now
    run = campaign.conditions.run
    moved = replace(campaign, conditions=replace(campaign.conditions, time=time, run=None))
    if run is not None and len(np.unique(run)) > 1:
        raise InputError("one campaign at a time", field="--campaign")
    if lasting or moved.conditions.setup is None:
        return moved
    suffix = datetime.fromtimestamp(float(time.min())).strftime("%Y-%m-%dT%H:%M:%S")
    free = [name for name, setup in campaign.setups.items() if setup.free]
    new = {name: f"{name.split(PLACING)[0]}{PLACING}{suffix}" for name in free}
    setups = {new.get(n, n): replace(s, name=new.get(n, n)) for n, s in campaign.setups.items()}
    names = np.array([new.get(str(n), str(n)) for n in moved.conditions.setup])
    return replace(moved, setups=setups, conditions=replace(moved.conditions, setup=names))


def diagnosing(machine: Path, model: Path, checks: Path | None, since: str, changed: Path) -> str:
    """The commands that write the rows since a change and diagnose them, as one line."""
    words = ["abbe", "check-point", str(machine)]
    words += [] if checks is None else ["--checks", str(checks)]
    words += ["--since", since] if since else []
    first = shlex.join([*words, "--changed", str(changed)])
    return f"{first} && {shlex.join(['abbe', 'diagnose', str(model), str(changed)])}"


def day(time: float) -> str:
    """A moment of a check, for people, in the computer's zone."""
    return datetime.fromtimestamp(time).strftime("%Y-%m-%d %H:%M")


def as_text(answer: CheckAnswer) -> Iterator[str]:
    """What ``abbe check-point`` prints."""
    found = answer.judgement
    yield from judgement_words(found, day)
    if found.change is not None:
        yield f"next: {answer.diagnosing}"
    yield ""
    yield from _last_check(found)
    if answer.before and answer.since is not None:
        yield ""
        yield f"{answer.before} readings before {day(answer.since)} do not count (--since)."


def _last_check(found: Judgement) -> Iterator[str]:
    r, last = found.readings, len(found.readings.times) - 1
    rows = [k for k in range(len(r.series)) if math.isfinite(found.expected.sd[last, k])]
    full = found.charts.fullness
    rows.sort(key=lambda k: -full[last, k])
    absolute = _absolute(found)
    width = max(len(r.series[k].name) for k in rows)
    yield f"the check of {day(float(r.times[last]))}, {last + 1} of {len(r.times)}:"
    yield f"{'':{width}}  {'beyond expected':>22}  {'beyond predicted':>22}  {'chart':>6}"
    for k in rows[:_SHOWN]:
        unit = r.series[k].unit
        surprise = (
            f"{found.expected.surprise[last, k]:+.2f} ± {2 * found.expected.sd[last, k]:.2f} {unit}"
        )
        predicted = absolute.get(k)
        beside = "" if predicted is None else f"{predicted[0]:+.2f} ± {2 * predicted[1]:.2f} {unit}"
        yield (f"{r.series[k].name:{width}}  {surprise:>22}  {beside:>22}  {full[last, k]:>6.0%}")
    if len(rows) > _SHOWN:
        yield f"… and {len(rows) - _SHOWN} more, their charts emptier (--json has all)"


def _absolute(found: Judgement) -> dict[int, tuple[float, float]]:
    """Series of the last check that are read absolutely: residual and its sd, µm or µrad."""
    r = found.readings
    known = np.ones(len(r.check), dtype=np.bool_)
    for block in r.placings:
        known[block.rows] = False
    spread = r.predicted_sd
    out = {}
    for k in range(len(r.series)):
        rows = np.flatnonzero((r.check == len(r.times) - 1) & (r.of == k) & known)
        if rows.size:
            reading = float((1.0 / r.sd[rows] ** 2).sum() ** -0.5)
            out[k] = float(r.residual[rows].mean()), math.hypot(reading, float(spread[rows].max()))
    return out


def as_json(answer: CheckAnswer) -> dict[str, Any]:
    """One object for ``--json``; lengths µm, angles µrad."""
    found = answer.judgement
    r, e, charts = found.readings, found.expected, found.charts
    last = len(r.times) - 1
    absolute = _absolute(found)
    return {
        "verdict": "changed" if found.change is not None else "sound",
        "checks": len(r.times),
        "first": _iso(r.times[0]),
        "last": _iso(r.times[last]),
        "since": None if answer.since is None else _iso(answer.since),
        "false_alarm_every": found.design.false_alarm_every,
        "learning": found.learning,
        "series": [
            {
                "name": s.name,
                "unit": "urad" if s.unit == "µrad" else "um",
                "readings": int(np.isfinite(e.sd[:, k]).sum()),
                "surprise": _finite(e.surprise[last, k]),
                "sd": _finite(e.sd[last, k]),
                "usual": float(found.usual[k]),
                "beyond_prediction": None if k not in absolute else absolute[k][0],
                "beyond_prediction_sd": None if k not in absolute else absolute[k][1],
                "ewma": float(charts.ewma[last, k] / charts.ewma_limit),
                "cusum": float(
                    max(charts.upper[last, k], charts.lower[last, k]) / charts.cusum_limit
                ),
            }
            for k, s in enumerate(r.series)
        ],
        "wild": [r.series[k].name for k in found.wild],
        "alarm": _alarm(found),
        "diagnose": answer.diagnosing if found.change is not None else None,
        "words": list(judgement_words(found, day)),
    }


def _alarm(found: Judgement) -> Mapping[str, Any] | None:
    alarm, change, r = found.charts.alarm, found.change, found.readings
    if alarm is None or change is None:
        return None
    return {
        "check": _iso(r.times[alarm.check]),
        "series": r.series[alarm.series].name,
        "chart": alarm.chart,
        "last_sound": _iso(r.times[change.last_sound]),
        "first_changed": _iso(r.times[change.first_changed]),
        "course": change.course,
        "explained": change.explained,
        "patterns": [
            {
                "component": p.component,
                "along": p.along or None,
                "constant": p.constant,
                "constant_sd": p.constant_sd,
                "slope": p.slope if p.along else None,
                "slope_sd": p.slope_sd if p.along else None,
                "per": p.unit or p.along or None,
            }
            for p in change.patterns
        ],
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _iso(time: float) -> str:
    return datetime.fromtimestamp(float(time)).astimezone().isoformat("T", "seconds")
