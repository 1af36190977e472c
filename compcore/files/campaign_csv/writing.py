"""Writing a campaign file, in pieces, so that reading it back gives an equal campaign."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np
import tomli_w
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.errors import InputError, require_type
from abbe.compcore.files.campaign_csv.columns import RESERVED, TOOL, UNIT_VECTOR
from abbe.compcore.files.campaign_csv.rows import PER_UNIT
from abbe.compcore.files.formats import CAMPAIGN
from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]
_ROWS = 20_000
"""Rows formatted at once."""


def write_campaign(campaign: Campaign, path: str | Path) -> None:
    """Write a campaign file, whole or not at all.

    Reading it back gives equal rows: to the last bit where the campaign was itself read from a
    file, else within one unit in the last place (2e-16 relative), since a length in mm need not
    have a binary fraction in µm.

    Raises
    ------
    InputError
        When the campaign holds what the format cannot: several runs (clocks), a name with a line
        end or blanks around it, a number that is not finite; or when the file cannot be written.
    """
    require_type(campaign, Campaign, "campaign")
    run = campaign.conditions.run
    if run is not None and len(np.unique(run)) > 1:
        raise InputError(
            "several campaigns with clocks of their own do not fit into one file",
            file=path,
            found=campaign.name,
            expected="one file for each",
        )
    columns = list(_columns(campaign))
    lines = chain(
        (_head(campaign), ",".join(_quoted(name) for name, _ in columns) + "\n"),
        _rows([column for _, column in columns], campaign.n),
    )
    write_atomically(path, lines)


def _head(campaign: Campaign) -> str:
    data: dict[str, object] = {"format": CAMPAIGN}
    data.update(campaign.metadata[0] if campaign.metadata else {})
    if campaign.setups:
        data["setups"] = {s.name: {"free": list(s.free)} for s in campaign.setups.values()}
    if campaign.bases:
        data["bases"] = {name: {"position": list(p)} for name, p in campaign.bases.items()}
    if campaign.tools:
        data["tools"] = {
            t.name: {"offset": list(t.offset), "free": list(t.free)}
            for t in campaign.tools.values()
        }
    text = tomli_w.dumps(data)
    return "".join(f"# {line}".rstrip() + "\n" for line in text.rstrip("\n").split("\n"))


Column = Callable[[slice], list[str]]


def _columns(campaign: Campaign) -> Iterator[tuple[str, Column]]:
    """Name and text of every column, in the order of the format's own example."""
    c, kind = campaign.conditions, campaign.kind
    component = (kind == Kind.DISPLACEMENT) | (kind == Kind.ROTATION)
    per_unit = np.array([PER_UNIT[k] for k in Kind])[kind]
    yield "time", _numbers("time", c.time)
    yield "setup", _names("setup", c.setup if c.setup is not None else np.array([""]))
    yield "kind", _names("kind", np.array([k.name.lower() for k in Kind])[kind])
    for axis, q in c.positions.items():
        yield axis, _numbers(axis, _degrees(q) if is_rotary(axis) else q)
    for axis, s in c.directions.items():
        yield f"{axis}_dir", _numbers(f"{axis}_dir", s)
    if campaign.spindle is not None and c.spindle_angle is not None:
        name = campaign.spindle
        name = f"({name})" if name in c.positions else name
        yield name, _numbers(name, _degrees(c.spindle_angle))
    named = campaign.tool_name != ""
    if named.any():
        yield "tool", _names("tool", campaign.tool_name, optional=True)
    if c.tool[~named].any():
        for i, name in enumerate(TOOL):
            yield name, _numbers(name, c.tool[:, i], blank=named)
    if component.any():
        u = np.zeros((c.n, 3)) if c.u is None else c.u
        for i, name in enumerate(UNIT_VECTOR):
            yield name, _numbers(name, u[:, i], blank=~component)
    for name, base in (("base", c.base), ("base2", campaign.base2)):
        if base is not None and (base != "").any():
            yield name, _names(name, base, optional=True)
    yield "value", _numbers("value", _scaled(campaign.value, per_unit))
    if not np.isnan(campaign.sd).all():
        sd = _scaled(campaign.sd, per_unit)
        yield "sd", _numbers("sd", sd, blank=np.isnan(campaign.sd))
    if campaign.gauge is not None and campaign.gauge_sd is not None:
        yield "gauge", _names("gauge", campaign.gauge, optional=True)
        common = _scaled(campaign.gauge_sd, per_unit)
        yield "gauge_sd", _numbers("gauge_sd", common, blank=campaign.gauge == "")
    for name, signal in c.signals.items():
        if name in RESERVED or name in c.positions:
            raise InputError("a signal with the name of another column", field=name, found=name)
        yield name, _numbers(name, signal)


def _rows(columns: list[Column], n: int) -> Iterator[str]:
    for first in range(0, n, _ROWS):
        part = slice(first, min(first + _ROWS, n))
        rows = zip(*(column(part) for column in columns), strict=True)
        yield "\n".join(map(",".join, rows)) + "\n"


def _numbers(name: str, values: F64, blank: NDArray[np.bool_] | None = None) -> Column:
    bad = ~np.isfinite(values) if blank is None else ~np.isfinite(values) & ~blank
    if bad.any():
        found = values[int(np.argmax(bad))]
        raise InputError("not a finite number", field=name, found=float(found))

    def text(part: slice) -> list[str]:
        texts = _texts(np.ascontiguousarray(values[part], dtype=np.float64))
        if blank is not None:
            texts = ["" if b else t for t, b in zip(texts, blank[part].tolist(), strict=True)]
        return texts

    return text


def _texts(values: F64) -> list[str]:
    """Each number's shortest text; what repeats, as positions do row after row, is written once."""
    # by their bits: −0 is not 0
    bits, where = np.unique(values.view(np.int64), return_inverse=True)
    often = 2 * len(bits) <= len(values)
    written = [
        repr(x).removesuffix(".0") for x in (bits.view(np.float64) if often else values).tolist()
    ]
    return np.array(written, dtype=object)[where].tolist() if often else written


def _names(name: str, values: NDArray[np.str_], *, optional: bool = False) -> Column:
    texts = {}
    for value in np.unique(values).tolist():
        texts[value] = _quoted(value)
        if (not value and not optional) or value != value.strip() or len(value.splitlines()) > 1:
            raise InputError("not a name that a campaign file can hold", field=name, found=value)
    return lambda part: [texts[value] for value in values[part].tolist()]


def _quoted(text: str) -> str:
    if any(c in text for c in ',"#'):
        return '"' + text.replace('"', '""') + '"'
    return text


def as_cell(value: str | float | None) -> str:
    """A text or a number as a cell of a campaign file; None is a blank one.

    >>> as_cell("a,b"), as_cell(12.0), as_cell(-0.25), as_cell(None)
    ('"a,b"', '12', '-0.25', '')
    """
    if value is None:
        return ""
    if isinstance(value, str):
        return _quoted(value)
    return repr(float(value) + 0.0).removesuffix(".0")


def _degrees(angle: F64) -> F64:
    return _inverse(angle, np.rad2deg(angle), np.deg2rad)


def _scaled(value: F64, per_unit: F64) -> F64:
    return _inverse(value, value * per_unit, lambda x: x / per_unit)


def _inverse(value: F64, guess: F64, read: Callable[[F64], F64]) -> F64:
    """Numbers for the file that read back as `value`, the shortest decimals that do."""
    found = guess.copy()
    open_ = np.ones(value.shape, dtype=np.bool_)
    for candidate in (
        np.round(guess, 6),
        np.round(guess, 10),
        guess,
        np.nextafter(guess, np.inf),
        np.nextafter(guess, -np.inf),
    ):
        fits = open_ & (read(candidate) == value)
        found[fits] = candidate[fits]
        open_ &= ~fits
    return found
