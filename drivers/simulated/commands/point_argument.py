"""A place as an argument of a command: ``X,Y,Z`` in mm."""

from __future__ import annotations

import argparse


def point(text: str) -> tuple[float, float, float]:
    """Read a place.

    Raises
    ------
    argparse.ArgumentTypeError
        When it is not three numbers with commas.
    """
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"found {text!r}; expected X,Y,Z in mm") from None
    return (x, y, z)
