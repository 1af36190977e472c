"""Which Abbe is installed."""

from __future__ import annotations


def abbe_version() -> str:
    """The installed version of Abbe, as its package says it."""
    from importlib.metadata import version  # reads e-mail's headers: not before it is asked for

    return version("abbe")
