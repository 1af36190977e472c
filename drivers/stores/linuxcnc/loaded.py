"""The set of compensation files that the running LinuxCNC loaded when it started.

Kept beside the sets, at each switch: when it was (on the clock of processes' starts, which nobody
sets), what ran then, and which set that had loaded.
"""

from __future__ import annotations

import contextlib

from abbe.drivers.linuxcnc.running import Task, boot, since_boot
from abbe.drivers.stores.set_folders import SetFolders


def note_switch(folders: SetFolders, task: Task | None, before: str) -> None:
    """Keep what is known right after a switch.

    Parameters
    ----------
    folders
        Where the switch was.
    task
        What runs now.
    before
        The set that it had loaded before; empty: not known.

    Raises
    ------
    OSError
        When it cannot be written.
    """
    folders.note({"boot": boot(), "since_boot": since_boot(), "task": task, "loaded": before})


def restart_needed(folders: SetFolders, task: Task | None) -> bool:
    """Whether a LinuxCNC runs that has not loaded the current set.

    Parameters
    ----------
    folders
        Its sets.
    task
        What runs; None: nothing.
    """
    if not folders.current.is_symlink():
        return False
    facts = folders.switched()
    if facts is None:
        if not folders.is_own():
            return False  # made by hand, and loaded as anybody made it
        # Abbe was ended just after it switched: what runs may have started before
        with contextlib.suppress(OSError):
            note_switch(folders, task, "")
        return task is not None
    if task is None or facts["boot"] != boot():
        return False
    if facts["task"] == list(task):
        return bool(facts["loaded"] != str(folders.current.readlink()))
    return bool(task.started <= facts["since_boot"])


def loaded(folders: SetFolders, task: Task | None) -> str:
    """The set that the LinuxCNC that runs has loaded; empty when that is not known.

    Parameters
    ----------
    folders
        Its sets.
    task
        What runs; None: nothing.
    """
    if not restart_needed(folders, task):
        return str(folders.current.readlink()) if folders.current.is_symlink() else ""
    facts = folders.switched()
    if facts is None or task is None or facts["task"] != list(task):
        return ""
    return str(facts["loaded"])
