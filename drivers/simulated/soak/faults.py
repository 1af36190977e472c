"""The kinds of fault of the computer that Abbe runs on: how long and how strong each is."""

from __future__ import annotations

from abbe.drivers.simulated.torment.kinds import TormentKind

COMPUTER_FAULTS: dict[str, TormentKind] = {
    "killed": TormentKind((0.2, 2.0), (0, 0), "SIGKILL; the supervisor starts it again after this"),
    "frozen_process": TormentKind((0.05, 2.5), (0, 0), "SIGSTOP, and SIGCONT after this"),
    "hung": TormentKind((6.0, 8.0), (0, 0), "SIGSTOP until the watchdog has it killed"),
    "reloaded": TormentKind(
        (0.5, 1.5), (0, 1), "other limits are reloaded; below 0.3 a broken file"
    ),
    "disk_full": TormentKind((1.0, 8.0), (0, 0), "no file can grow"),
    "disk_slow": TormentKind((1.0, 6.0), (0, 0), "the disk is busy, the records are locked"),
    "records_damaged": TormentKind((0.5, 1.0), (0, 0), "the middle of the file is overwritten"),
    "clock_jump": TormentKind((1.0, 5.0), (-90_000.0, 90_000.0), "the date is so many s off"),
}

DEADLY = frozenset({"killed", "hung"})
"""Faults that end a life; memory is watched on one that goes on."""
CALM = (2.0, 5.0, 10.0)
"""s between two faults."""
