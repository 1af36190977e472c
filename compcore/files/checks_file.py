"""The file of a machine's check measurements: a campaign that only ever grows."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.continued import continued
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign, write_campaign
from abbe.compcore.machine.machine import Machine

_NOTES = "check measurements, s since 1970; kept by Abbe, rows are only ever added"


def read_checks(path: Path, machine: Machine) -> Campaign:
    """Read a machine's check measurements.

    Raises
    ------
    InputError
        As `read_campaign`; for checks of another machine; when there are none.
    """
    if not path.exists():
        raise InputError(
            "no check was recorded yet",
            file=path,
            expected="a reading by abbe check-point, typed in or from a campaign",
        )
    campaign = read_campaign(path, machine)
    _require_machine(path, campaign, machine)
    return campaign


def add_checks(path: Path, new: Campaign, machine: Machine) -> Campaign:
    """Add check measurements to a machine's, made where there are none yet; returns all.

    The file is replaced as a whole, so that a process that dies leaves the old one or the new one.
    Two that add at once wait for each other.

    Raises
    ------
    InputError
        When the file cannot be read or written, or the rows do not go with those that are there
        (`continued`); nothing is changed then.
    """
    with _one_at_a_time(path):
        if path.exists():
            found = read_campaign(path, machine)
            _require_machine(path, found, machine)
            try:
                together = continued(found, new)
            except InputError as error:
                raise error if error.file else error.at(file=path) from None
        else:
            head = {"machine": machine.name, "notes": _NOTES}
            together = replace(new, metadata=({k: v for k, v in head.items() if v},))
        write_campaign(together, path)
    return read_campaign(path, machine)


def _require_machine(path: Path, campaign: Campaign, machine: Machine) -> None:
    known = str(campaign.metadata[0].get("machine", "")) if campaign.metadata else ""
    if known and machine.name and known != machine.name:
        raise InputError(
            "checks of another machine",
            file=path,
            field="machine",
            found=known,
            expected=f"{machine.name}, or another file (--checks)",
        )


@contextmanager
def _one_at_a_time(path: Path) -> Iterator[None]:
    lock = path.with_name(path.name + ".lock")
    try:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}", file=lock) from None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
