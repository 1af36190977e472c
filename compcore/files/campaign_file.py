"""The campaign file ``*.csv``, format ``abbe-campaign/1``: read, write, check against a model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.join import join_campaigns
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv.columns import AXIS, read_columns
from abbe.compcore.files.campaign_csv.head import (
    CampaignHead,
    add_metadata,
    plain_line,
    read_head,
)
from abbe.compcore.files.campaign_csv.lines import LineSource, csv_cells
from abbe.compcore.files.campaign_csv.rows import CampaignRows
from abbe.compcore.files.campaign_csv.table import parse_rows
from abbe.compcore.files.campaign_csv.writing import write_campaign
from abbe.compcore.files.formats import CAMPAIGN
from abbe.compcore.machine.machine import Axis, Machine, OfMachine, machine_of
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import said

__all__ = ["bare_machine", "read_campaign", "read_campaigns", "require_signals", "write_campaign"]


def read_campaign(path: str | Path, machine: Machine) -> Campaign:
    """Read one campaign file of a machine, whole or not at all.

    The file is read once, in pieces: beside the campaign itself, memory for some 40 MB is needed
    however long the file is.

    Raises
    ------
    InputError
        For every bad input that docs/campaigns.md names: file, line, column, found, expected.
    """
    with LineSource(path) as source:
        chunks = source.chunks()
        rows, first, lines = _opened(source.file, chunks, machine)
        rows.add(parse_rows(first, lines, rows.columns))
        for first, lines in chunks:
            rows.add(parse_rows(first, lines, rows.columns))
        return rows.campaign(Path(path).name, source.sha256)


def bare_machine(path: str | Path) -> Machine:
    """A machine with the axes that a campaign file's header names, for use without a model.

    Column names of axes (X … C, a digit may follow) are taken as axes in the order of the header;
    their true order, travels and signals are not known.

    Raises
    ------
    InputError
        As `read_campaign`, for what stands above the rows.
    """
    with LineSource(path) as source:
        _, header, line, _ = _head_and_header(source.file, source.chunks())
    names = [name.strip() for name in header]
    axes = [name for name in names if AXIS.fullmatch(name)]
    if not axes:
        raise InputError(
            "no column of an axis",
            file=path,
            line=line,
            found=", ".join(names),
            expected="columns such as X, Y, Z",
        )
    spindle = next((name for name in names if AXIS.fullmatch(name[1:-1]) and name[0] == "("), "")
    try:
        structure = Structure.parse(f"w b {' '.join(axes)} {spindle} t")
    except InputError as error:
        raise error.at(file=path, line=line) from None
    return Machine("", structure, {name: Axis(name, (-_FAR, _FAR)) for name in axes})


_FAR = 1e6
"""Travel of an axis of which nothing is known, mm or rad."""


def _opened(
    file: str, chunks: Iterator[tuple[int, list[str]]], machine: Machine
) -> tuple[CampaignRows, int, list[str]]:
    """An empty table, and what is left of the piece that metadata and header ended in."""
    head, header, line, rest = _head_and_header(file, chunks)
    return CampaignRows(machine, head, read_columns(header, machine, file, line)), line + 1, rest


def _head_and_header(
    file: str, chunks: Iterator[tuple[int, list[str]]]
) -> tuple[CampaignHead, list[str], int, list[str]]:
    """Metadata, header cells, the header's line number, and the lines left of that piece."""
    top: list[str] = []
    for first, lines in chunks:
        for i, line in enumerate(lines):
            if (text := plain_line(line)) is not None:
                add_metadata(top, text, file)
                continue
            head = read_head(top, file)
            return head, _header(line, file, first + i), first + i, lines[i + 1 :]
    if not any(text.strip() for text in top):
        expected = f'# format = "{CAMPAIGN}"'
        raise InputError("the file is empty", file=file, line=1, expected=expected)
    read_head(top, file)
    raise InputError(
        "the header is missing",
        file=file,
        line=len(top) + 1,
        expected="a line with the names of the columns below the metadata",
    )


def read_campaigns(
    paths: str | Path | Sequence[str | Path], machine: Machine | OfMachine
) -> Campaign:
    """Read one or more campaign files of a machine and join them (`join_campaigns`).

    Parameters
    ----------
    paths
        The files; one alone need not stand in a list.
    machine
        The machine, or a model of it.

    Raises
    ------
    InputError
        As `read_campaign`; and when a file is given twice, since its rows would count double.
    """
    machine = machine_of(machine)
    seen: dict[str, str] = {}
    campaigns = []
    for path in [paths] if isinstance(paths, str | Path) else paths:
        campaign = read_campaign(path, machine)
        (sha256,) = campaign.files.values()
        if sha256 in seen:
            raise InputError("the same campaign twice", file=path, found=seen[sha256])
        seen[sha256] = str(path)
        campaigns.append(campaign)
    if not campaigns:
        raise InputError("no campaign given", expected="at least one campaign file")
    return join_campaigns(campaigns)


def require_signals(campaign: Campaign, model: Model) -> None:
    """Refuse a campaign that lacks a signal which an effect of the model needs.

    Raises
    ------
    InputError
        Naming the file, the signal, the effect and the signals that were recorded.
    """
    for term in model.terms:
        for signal in term.effect.signals_needed():
            if signal in campaign.conditions.signals:
                continue
            if signal in campaign.unseen:
                file, line = campaign.unseen[signal]
                raise InputError(
                    said(
                        "not seen here, and the effect {effect} needs it in every row",
                        effect=f"'{term.effect.spec}'",
                    ),
                    file=file, line=line, field=signal, found="a blank cell",
                    expected=said("a number, or the row left out"),
                )  # fmt: skip
            files = campaign.lacking.get(signal) or tuple(campaign.files) or (campaign.name,)
            recorded = ", ".join(campaign.conditions.signals) or "no signals"
            raise InputError(
                said(
                    "a signal that the effect {effect} needs is not recorded",
                    effect=f"'{term.effect.spec}'",
                ),
                file=files[0],
                field=signal,
                found=recorded,
                expected=said("a column {name}", name=repr(signal)),
            )


def _header(text: str, file: str, line: int) -> list[str]:
    return csv_cells(text, file, line, said("a header line"))
