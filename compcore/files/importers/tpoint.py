"""Pointing files of a telescope, as TPOINT reads them, to a campaign.

A caption, lines of options (``: ALTAZ``), a line of run parameters (latitude, date, weather), then
a line a star: where it stood and what the encoders read, azimuth and elevation of each in decimal
degrees; ``!`` begins a comment, ``END`` ends the file (the manual's format 4). Azimuth counts from
south through east, so that it is right-handed about a Z that points up, X south, Y east.

An alt-azimuth mount is a machine of two rotary axes: C turns with the azimuth, B with the distance
from the zenith. A star says two components of the tool's error of orientation, across the direction
in which it looks; the third, about that direction, no star shows.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.placing import ForeignPlacing, Readings, place, read_bytes
from abbe.compcore.files.text.encodings import decoded
from abbe.compcore.files.text.numbers import checked_number
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import Range

F64 = NDArray[np.float64]

_AZIMUTH = Range(-720.0, 720.0, "degrees")
_ELEVATION = Range(-5.0, 95.0, "degrees")
_COLUMNS = ("azimuth", "elevation", "azimuth read", "elevation read")
_EXPECTED = (
    "azimuth and elevation of the star, azimuth and elevation read, in degrees (format 4); "
    "right ascensions must be turned into these first"
)
_ZERO = 1e-3
"""rad from which on an encoder's zero is taken off: what is left must be small angles."""


def import_tpoint(
    path: str | Path,
    placing: ForeignPlacing | None = None,
    *,
    zero: tuple[float, float] | None = None,
    machine: Machine | None = None,
) -> Campaign:
    """Read the stars of a pointing run.

    Where an encoder's zero is arbitrary, its mean difference from the stars is taken off and said
    in the notes. Another night of the same telescope needs the same ``zero``: what each night's
    stars say by themselves would hide that the axis moved between them, or say that it did.

    Parameters
    ----------
    zero
        What is added to azimuth and elevation as read, degrees; None: found from the stars.

    Raises
    ------
    InputError
        Naming file, line, what was found and what was expected.
    """
    source = Path(path)
    placing = placing or ForeignPlacing()
    data = read_bytes(source)
    caption, stars, line = _stars(source, decoded(data))
    star, read = np.deg2rad(stars[:, :2]), np.deg2rad(stars[:, 2:])
    notes = [
        f"imported from {source.name} (TPOINT: {caption or 'no caption'})",
        "sign: error = where the star stands − what the encoders read",
        "C = azimuth from south through east, B = distance from the zenith, X south, Y east, Z up",
    ]
    apart = star - read
    apart[:, 0] = np.angle(np.exp(1j * apart[:, 0]))
    taken = _zeros(apart) if zero is None else np.deg2rad(zero)
    for name, off in zip(("azimuth", "elevation"), taken, strict=True):
        if off:
            notes.append(f"zero of the {name}: {np.rad2deg(off):.6f} degrees added to what it read")
    read += taken
    if zero is None and np.any(taken):
        same = ",".join(f"{degrees:.6f}" for degrees in np.rad2deg(taken))
        notes.append(f"other nights of the same telescope: --zero {same}")
    c, b = read[:, 0], 0.5 * np.pi - read[:, 1]
    c = np.angle(np.exp(1j * c))
    looks = _direction(c, b)
    off = np.cross(looks, _direction(star[:, 0], 0.5 * np.pi - star[:, 1]))
    size = np.linalg.norm(off, axis=1, keepdims=True)
    off *= np.where(size > 0.0, np.arcsin(np.minimum(size, 1.0)) / np.where(size > 0, size, 1), 1.0)
    # across the tool: about the axis of elevation, and upwards
    level = np.stack([-np.sin(c), np.cos(c), np.zeros(len(c))], axis=1)
    across = np.stack([level, np.cross(looks, level)], axis=1)
    readings = Readings(
        positions={"C": np.repeat(c, 2), "B": np.repeat(b, 2)},
        directions={a: np.zeros(2 * len(c), dtype=np.int64) for a in "CB"},
        kind=Kind.ROTATION,
        value=np.einsum("nki,ni->nk", across, off).reshape(-1),
        u=across.reshape(-1, 3),
        free=(),
        line=np.repeat(line, 2),
    )
    notes.append("the file has no times")
    return place(source, data, [readings], placing, notes, {"instrument": "stars"}, machine)


def _zeros(apart: F64) -> F64:
    """Mean difference of star and encoder, (2,) rad, of angles round a circle; 0 where small."""
    mean: F64 = np.angle(np.mean(np.exp(1j * apart), axis=0))
    # as it is said, so that it can be typed for other nights
    said = np.deg2rad(np.round(np.rad2deg(mean), 6))
    return np.where(np.abs(mean) > _ZERO, said, 0.0)


def _direction(azimuth: F64, zenith: F64) -> F64:
    """Unit vectors, (n, 3), from azimuth about Z and distance from Z."""
    level = np.sin(zenith)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.cos(zenith)], axis=1)


def _stars(source: Path, text: str) -> tuple[str, F64, NDArray[np.int64]]:
    """Caption; (n, 4) degrees; the line of each."""
    lines = _content(text)
    caption, options = "", list[str]()
    number, words = next(lines, (0, ""))
    if not words.startswith(":"):  # else the caption was written as a comment
        caption = words
        number, words = next(lines, (0, ""))
    while words.startswith(":"):
        options += words[1:].upper().split()
        number, words = next(lines, (0, ""))
    # what comes now are the run parameters
    if not words:
        raise _refused(source, None, caption or None)
    if "ALTAZ" not in options:
        raise InputError(
            "not an alt-azimuth mount",
            file=source,
            line=number,
            field="options",
            found=" ".join(options) or "none",
            expected="a line ': ALTAZ' behind the caption",
        )
    found, places = [], []
    for number, words in lines:
        if words.upper() == "END":
            break
        cells = words.split()
        if len(cells) != len(_COLUMNS):
            raise _refused(source, number, words)
        found.append(
            [
                checked_number(
                    cell,
                    file=source,
                    line=number,
                    field=name,
                    expected="degrees",
                    allowed=_AZIMUTH if name.startswith("azimuth") else _ELEVATION,
                )
                for cell, name in zip(cells, _COLUMNS, strict=True)
            ]
        )
        places.append(number)
    if not found:
        raise InputError("no stars", file=source, expected=_EXPECTED)
    return caption, np.array(found), np.array(places)


def _content(text: str) -> Iterator[tuple[int, str]]:
    """Lines that say something, with their numbers."""
    for number, words in enumerate(text.splitlines(), start=1):
        if words.strip() and not words.lstrip().startswith("!"):
            yield number, words.strip()


def _refused(source: Path, line: int | None, found: str | None) -> InputError:
    return InputError(
        "not a pointing file of TPOINT", file=source, line=line, found=found, expected=_EXPECTED
    )
