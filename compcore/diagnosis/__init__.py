"""Diagnosis: which effect is missing, what else it could be, what to measure next."""

from __future__ import annotations

from abbe.compcore.diagnosis.advice import Advice, advise
from abbe.compcore.diagnosis.findings import Established
from abbe.compcore.diagnosis.verdict import Diagnosis, diagnose

__all__ = ["Advice", "Diagnosis", "Established", "advise", "diagnose"]
