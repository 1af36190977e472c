"""Where a session's model and campaigns were taken from, where they are no files of a person's."""

from __future__ import annotations

from typing import NamedTuple


class FromStore(NamedTuple):
    """A machine in a plant's store.

    Attributes
    ----------
    place
        Store, site and machine, for people.
    take_out
        The command that writes its files into a folder.
    """

    place: str
    take_out: str
