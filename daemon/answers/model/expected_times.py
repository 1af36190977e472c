"""Expected times of an analysis, stage by stage, by the size of its campaigns.

Seconds on a processor of 2.5 GHz for a model of 150 parameters (docs/performance.md); only their
ratios matter once the first stage is over (`abbe.daemon.progress.TimeLeft`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from abbe.compcore.campaign.thinning import ENOUGH_ROWS
from abbe.daemon.progress import Stages

_ROW = 200.0
"""Bytes of a campaign's row."""


def _megabytes(campaigns: Sequence[Path]) -> float:
    return sum(path.stat().st_size for path in campaigns if path.is_file()) / 1e6


def fitting(campaigns: Sequence[Path]) -> Stages:
    """Of ``abbe fit``, and of ``abbe add``, which fits twice."""
    mb = _megabytes(campaigns)
    return (
        ("reading", 0.05 + 0.035 * mb),
        ("searching", 0.0),
        ("least squares", 0.05 + 0.06 * mb),
        ("looking for outliers", 0.0),
        ("what is not determined", 0.05 + 0.015 * mb),
        ("noise floor", 0.01 * mb),
        ("outliers", 0.2 + 0.025 * mb),
        ("drawing", 0.0),
    )


def adding(campaigns: Sequence[Path]) -> Stages:
    """Of ``abbe add`` and ``abbe remove``."""
    mb = _megabytes(campaigns)
    return (
        ("reading", 0.05 + 0.035 * mb),
        ("fitting the model as it is", 0.1 + 0.08 * mb),
        ("fitting the next version", 0.1 + 0.08 * mb),
        ("campaigns that are not fitted", 0.1 + 0.04 * mb),
    )


def comparing(campaigns: Sequence[Path]) -> Stages:
    """Of ``abbe compare``."""
    mb = _megabytes(campaigns)
    return (
        ("reading", 0.05 + 0.035 * mb),
        ("comparing", 0.05 + 0.015 * mb),
        ("drawing", 0.0),
    )


def diagnosing(campaigns: Sequence[Path], *, advised: bool = True) -> Stages:
    """Of ``abbe diagnose``; `advised` where it says what to measure next."""
    mb = _megabytes(campaigns)
    tested = min(1e6 * mb / _ROW, float(ENOUGH_ROWS)) / ENOUGH_ROWS
    more = max(0.0, mb - 1.25e-6 * _ROW * ENOUGH_ROWS)
    return (
        ("reading", 0.05 + 0.035 * mb),
        ("fitting the model", 0.1 + 0.07 * mb),
        ("enumerating", 0.3 + 1.5 * tested),
        ("testing", 0.1 + 0.3 * tested),
        ("looking for structure", 0.6 + 5.0 * tested),
        ("aliases", 0.1 + 0.2 * tested),
        ("what was found", 0.06 * more),
        ("what to measure next", 0.2 if advised else 0.0),
        ("noise floor", 0.01 * mb),
    )


def making_tables(axes: int) -> Stages:
    """Of ``abbe table`` for a machine of so many axes, where rotary ones count most."""
    return (("making tables", 0.3 if axes < 4 else 0.6 * (axes - 2)), ("drawing", 0.3))
