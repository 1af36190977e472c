"""Renewal of installed services after another version of Abbe has come in place of the old one.

What a machine's service may reach is written down in its unit by the version that installed it; the
new one writes it anew from the same configuration, which nobody but people changes. A machine whose
configuration the new version does not take goes on with what runs: that is said, loudly, and better
than a machine that is no longer corrected in the middle of a part.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

from abbe.compcore.errors import AbbeError
from abbe.daemon.config import load_config
from abbe.daemon.config.folders import CONFIGURATIONS
from abbe.daemon.systemd.install import RAMPS, install, installed, own_command, plan, run

Say = Callable[[str], None]


def renew(root: Path, say: Say, complain: Say) -> tuple[list[str], list[str]]:
    """Write the units of all installed machines anew; those that could be, and the others.

    Parameters
    ----------
    root
        Where the system's files begin.
    say, complain
        Receive, a line at a time, what was done and what could not be.
    """
    sound, bad = [], []
    for machine in installed(root):
        path = root / CONFIGURATIONS.relative_to("/") / machine / "config.toml"
        try:
            made = plan(load_config(path), machine, root, own_command())
            install(made)
        except AbbeError as error:
            complain(f"{machine}: {error}")
            bad.append(machine)
        else:
            say(f"renewed: {made.unit}")
            sound.append(machine)
    return sound, bad


def restart(sound: list[str], bad: list[str], say: Say, complain: Say) -> bool:
    """Restart the running services of machines that are in order; whether all went well.

    Each ramps its correction to zero and tells its controller before it begins anew.
    """
    well = True
    for machine in (m for m in sound if running(m)):
        unit = f"abbe@{machine}.service"
        say(f"restarting {unit}: the correction is ramped to zero and in again")
        try:
            run(["systemctl", "restart", unit], RAMPS)
        except AbbeError as error:
            complain(f"{error}; see: journalctl -u {unit} -n 20")
            well = False
    for machine in (m for m in bad if running(m)):
        complain(
            f"abbe@{machine}.service goes on with the version that it was started with; mend its "
            f"configuration, then: systemctl restart abbe@{machine}"
        )
    return well


def running(machine: str) -> bool:
    """Whether a machine's service runs."""
    command = ["systemctl", "is-active", "--quiet", f"abbe@{machine}.service"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0
