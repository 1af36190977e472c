"""Where a configuration's data lie: beside it, or, of an installed service, in its state folder."""

from __future__ import annotations

from pathlib import Path

CONFIGURATIONS = Path("/etc/abbe")
"""Holds a folder for each machine that is a service of this computer."""
STATE = Path("/var/lib/abbe")
"""Holds a folder for each machine's data: journals, backups."""


def data_folder(configuration: Path) -> Path:
    """The folder that relative names of journals and backups begin in.

    Of ``/etc/abbe/MACHINE/config.toml`` it is ``/var/lib/abbe/MACHINE``, because a service does not
    write among its configuration; of any other, the configuration's own.

    >>> data_folder(Path("/etc/abbe/mill-7/config.toml"))
    PosixPath('/var/lib/abbe/mill-7')
    >>> data_folder(Path("mill-7/config.toml"))
    PosixPath('mill-7')
    """
    folder = configuration.parent
    if folder.absolute().parent == CONFIGURATIONS:
        return STATE / folder.name
    return folder
