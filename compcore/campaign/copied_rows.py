"""Rows that stand twice: a file pasted twice, the same measurement exported twice.

Two readings never agree in every digit unless their resolution is coarse. Rows that repeat others
to the last digit, in a row, are copies: they say nothing new and make everything look surer.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.sentences import Sentence, said

_FEWEST = 4
"""Rows in a row, none of them 0, from which on copies without a clock are told from chance."""
_CHANCE = 1e-4
"""Probability of as many readings that agree by chance from which on they are copies."""
_SHOWN = 3
_LOOKED_AT = 1000
"""Rows by which it is estimated how much a column differs."""


def of_copies(campaign: Campaign) -> Iterator[Sentence]:
    """Say which rows repeat others to the last digit, with their lines.

    With a clock a row that has another's time, place and value is a copy. Else copies are runs of
    rows, in the order of the others, whose readings all agree: more of them than readings of that
    resolution agree by chance, as the campaign's other repeats show.
    """
    copies = _copies(campaign)
    count = sum(len(rows) for rows, _ in copies)
    if not count:
        return
    blocks = [_block(campaign, rows, of) for rows, of in copies[:_SHOWN]]
    shown = "; ".join(blocks) + ("; …" if len(copies) > _SHOWN else "")
    yield said(
        "{n} of {all} rows stand twice, with every digit of their readings ({where}): pasted or "
        "exported twice? They say nothing new, and make everything look surer than it is; take "
        "them out",
        n=count, all=campaign.n, where=shown,
    )  # fmt: skip


def _copies(campaign: Campaign) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Blocks of rows that are copies, each with the rows that it repeats."""
    n = campaign.n
    if n < 2:
        return []
    pose = _numbered(campaign)
    same = _numbers([pose, campaign.value])
    partner = _earlier(same)
    if campaign.clocked:
        at_once = _earlier(_numbers([same, campaign.conditions.time]))
        rows = np.flatnonzero(at_once >= 0)
        if len(rows):
            return list(_blocks(rows, at_once[rows]))
    rows = np.flatnonzero(partner >= 0)
    if len(rows) < _FEWEST:
        return []
    again = int((_earlier(pose) >= 0).sum())
    found = []
    for block, of in _blocks(rows, partner[rows]):
        others = max(again - len(block), 0)
        agree = (len(rows) - len(block) + 1.0) / (others + 2.0)
        told = campaign.value[block]
        informative = int(((told != 0.0) & (np.abs(np.diff(told, prepend=np.nan)) > 0.0)).sum())
        # without other repeats readings that differ from row to row are of a fine resolution
        fine = len(np.unique(campaign.value[of])) >= 0.5 * len(of)
        if informative >= _FEWEST and fine and min(agree, 0.5) ** informative < _CHANCE:
            found.append((block, of))
    return found


def _blocks(
    rows: NDArray[np.int64], of: NDArray[np.int64]
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Rows that follow one another and repeat rows that follow one another."""
    breaks = np.flatnonzero((np.diff(rows) != 1) | (np.diff(of) != 1)) + 1
    yield from zip(np.split(rows, breaks), np.split(of, breaks), strict=True)


def _numbered(campaign: Campaign) -> NDArray[np.int64]:
    """Rows of one place, direction, tool, component, base and signals have one number, (n,)."""
    c = campaign.conditions
    columns: list[NDArray[np.generic]] = [*c.positions.values(), *c.directions.values()]
    columns += [campaign.kind, campaign.sd, campaign.base2, campaign.tool_name]
    columns += [*c.tool.T, *c.signals.values()]
    columns += [] if c.u is None else [*c.u.T]
    columns += [] if c.base is None else [c.base]
    return _numbers(columns)


def _numbers(columns: list[NDArray[np.generic]]) -> NDArray[np.int64]:
    number = np.zeros(len(columns[0]), dtype=np.int64)
    # what differs most comes first: once no two rows are alike the others say nothing more
    for column in sorted(columns, key=lambda c: -len(np.unique(c[:_LOOKED_AT]))):
        if int(number.max()) + 1 == len(number):
            break
        if (column == column[0]).all():
            continue
        own = np.unique(column, return_inverse=True)[1].reshape(-1)
        number = np.unique(number * (int(own.max()) + 1) + own, return_inverse=True)[1].reshape(-1)
    return number.astype(np.int64)


def _earlier(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Of each row the first one of its number, where that is another; else −1, (n,)."""
    _, first, back = np.unique(number, return_index=True, return_inverse=True)
    at = first[back.reshape(-1)]
    return np.where(at < np.arange(len(number)), at, -1)


def _block(campaign: Campaign, rows: NDArray[np.int64], of: NDArray[np.int64]) -> str:
    here, there = (_lines(campaign, r) for r in (rows, of))
    files = campaign.file_of(int(rows[0])), campaign.file_of(int(of[0]))
    if files[0] != files[1]:
        return str(said("{here} of {a} = {there} of {b}", here=here, a=files[0], there=there,
                        b=files[1]))  # fmt: skip
    return str(said("{here} = {there}", here=here, there=there))


def _lines(campaign: Campaign, rows: NDArray[np.int64]) -> Sentence:
    first, last = int(campaign.line[rows[0]]), int(campaign.line[rows[-1]])
    if first == last:
        return said("line {line}", line=first)
    return said("lines {first} to {last}", first=first, last=last)
