"""What live check points say, as a part of the run's status."""

from __future__ import annotations

import math
from datetime import datetime

from abbe.daemon.status.live_checks import LiveChecksState
from abbe.daemon.status.run_status import CheckSeries, CheckStatus


def check_status(state: LiveChecksState) -> CheckStatus:
    """The status of what is known of a machine by its checks."""
    answer = state.answer
    if answer is None:
        return CheckStatus(
            verdict="unknown",
            checks=0,
            last=None,
            learning=0,
            words=[],
            component=[],
            along=[],
            next=None,
            series={},
            refused=dict(state.refused),
            problem=state.problem,
        )
    patterns = [] if answer["alarm"] is None else answer["alarm"]["patterns"]
    return CheckStatus(
        verdict=answer["verdict"],
        checks=answer["checks"],
        last=datetime.fromisoformat(answer["last"]),
        learning=answer["learning"],
        words=list(answer["words"]),
        component=[p["component"] for p in patterns],
        along=[p["along"] for p in patterns if p["along"]],
        next=answer["diagnose"],
        series={
            s["name"]: CheckSeries(
                unit=s["unit"],
                surprise=_rounded(s["surprise"]),
                uncertainty=None if s["sd"] is None else _rounded(2.0 * s["sd"]),
                full=round(max(abs(s["ewma"]), s["cusum"]), 4),
            )
            for s in answer["series"]
        },
        refused=dict(state.refused),
        problem=state.problem,
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, 4)
