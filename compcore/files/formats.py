"""The names and versions of the formats of Abbe's files, as their ``format`` key holds them."""

from __future__ import annotations

MODEL = "abbe-model/1"
CAMPAIGN = "abbe-campaign/1"
TABLES = "abbe-tables/1"
"""The record beside a set of compensation tables."""
CALIBRATION = "abbe-calibration/1"
"""How far a calibration is, beside its files."""
PLAN = "abbe-plan/1"
"""Set-ups that are to be measured."""
PART = "abbe-part/1"
"""A part program: what is touched, and what is evaluated."""
