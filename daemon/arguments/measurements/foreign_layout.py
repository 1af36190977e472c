"""Layouts of other measuring systems' files, as ``--as`` names them."""

from __future__ import annotations

from enum import StrEnum


class ForeignLayout(StrEnum):
    """The layout of a foreign file."""

    ISO230_2 = "iso230-2"
    RTL = "rtl"
    BALLBAR = "ballbar"
    MAP = "map"
    LENGTHS = "lengths"
    PLATE = "plate"
    RTEST = "rtest"
    PROBED = "probed"
    LOG = "log"
    POINTS = "points"
    TPOINT = "tpoint"
