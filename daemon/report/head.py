"""The head of a page: which machine, measured when, by whom, with what, where; and which files.

What ISO/TR 16907, 9.1, asks to be written down beside results. A fact that nobody stated is shown
as such: who prints the page sees what its campaign lacks.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path, PurePath
from typing import Any

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.measuring_conditions import STATED, extent, of_files, together
from abbe.compcore.files.model_toml.campaign_record import conditions_of
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import said

ALWAYS = ("date", "machine", "serial", "operator", "instrument", "environment")
"""What stands on every page, stated or not."""
_UNSTATED = said("not stated")
_RESTS = said("Rests on")
_SHORT = 12
AIR = ("ambient", "air")
"""Roles of signals that say how warm the air is."""


@dataclass(frozen=True)
class FileOnPage:
    """One file that a page rests on: what it is to the page, its name, its SHA-256."""

    part: str
    file: str
    sha256: str


@dataclass(frozen=True)
class PageHead:
    """What stands at the top of a page.

    Attributes
    ----------
    facts
        Name → what is known of it; empty: not stated.
    files
        What the page rests on.
    """

    facts: Mapping[str, str]
    files: Sequence[FileOnPage] = ()

    def html(self, say: Callable[[str], str] = str) -> str:
        """The head as HTML.

        Parameters
        ----------
        say
            A text in the language of the page.
        """
        unstated = escape(say(_UNSTATED))
        cells = "".join(
            f"<div><dt>{escape(say(name))}</dt>"
            + (f"<dd>{escape(say(text))}</dd>" if text else f'<dd class="unstated">{unstated}</dd>')
            + "</div>"
            for name, text in self.facts.items()
        )
        rows = "".join(
            f"<tr><td>{escape(say(f.part))}</td><td>{escape(PurePath(f.file).name)}</td>"
            f"<td>{_digest(f.sha256)}</td></tr>"
            for f in self.files
        )
        table = (
            f'<table class="files"><thead><tr><th scope="col">{escape(say(_RESTS))}</th>'
            f'<th scope="col">{escape(say("File"))}</th><th scope="col">SHA-256</th></tr></thead>'
            f"<tbody>{rows}</tbody></table>"
        )
        return f'<dl class="facts">{cells}</dl>' + (table if rows else "")


def _digest(digest: str) -> str:
    """Its beginning on the screen, the whole where the pointer rests and on paper."""
    if not digest:
        return "–"
    known = escape(digest)
    rest = f"<span>{known[_SHORT:]}</span>" if len(known) > _SHORT else ""
    return f'<code class="sha" title="{known}">{known[:_SHORT]}{rest}</code>'


def file_on_page(part: str, path: str | Path) -> FileOnPage:
    """A file as it is now; without SHA-256 where it is not there."""
    try:
        with Path(path).open("rb") as file:
            return FileOnPage(part, str(path), hashlib.file_digest(file, "sha256").hexdigest())
    except OSError:
        return FileOnPage(part, str(path), "")


def head_of(
    model: Model, files: Iterable[FileOnPage], campaign: Campaign | None = None
) -> PageHead:
    """The head of a page about a model.

    Parameters
    ----------
    model
        The model; where no campaign is given the conditions are those of the campaigns that it was
        fitted to.
    files
        Files that are not campaigns.
    campaign
        What the page is about, beside the model.
    """
    fitted = [c for c in model.fit.get("campaigns", ()) if isinstance(c, Mapping)]
    if campaign is not None:
        known = {str(c.get("sha256")) for c in fitted}
        conditions = of_files(campaign)
        measured = [
            FileOnPage("campaign, fitted" if digest in known else "campaign", file, digest)
            for file, digest in campaign.files.items()
        ]
    else:
        conditions = [conditions_of(c) for c in fitted]
        measured = [_recorded("campaign, fitted", c) for c in fitted]
        held = model.fit.get("holdout", ())
        measured += [_recorded("campaign, held out", c) for c in held if isinstance(c, Mapping)]
    return PageHead(facts_of(conditions, model.machine), (*files, *measured))


def _recorded(part: str, record: Mapping[str, Any]) -> FileOnPage:
    return FileOnPage(part, str(record.get("file", "–")), str(record.get("sha256", "")))


def facts_of(
    conditions: Sequence[Mapping[str, Any]], machine: Machine | None = None
) -> dict[str, str]:
    """What is known of the conditions of some campaigns, and of their machine, name → text."""
    found = together(conditions)
    if machine is not None:
        found["machine"] = machine.name or found.get("machine", "")
        found["serial"] = machine.serial or found.get("serial", "")
        said = [found["environment"]] if "environment" in found else []
        found["environment"] = "; ".join([*said, *_air(conditions, machine)])
        if "other_axes" not in found:
            found["other_axes"] = _positions(conditions, machine)
        if "measuring_tool" not in found:
            found["measuring_tool"] = _tool(conditions)
    facts = {STATED[key]: found.get(key, "") for key in ALWAYS}
    more = {STATED[key]: found[key] for key in STATED if key not in ALWAYS and found.get(key)}
    return {**facts, **more}


def facts_before(machine: Machine) -> dict[str, str]:
    """What is known of a machine before anything is measured: neither date nor operator lacks."""
    return {name: text for name, text in facts_of([], machine).items() if text}


def _air(conditions: Sequence[Mapping[str, Any]], machine: Machine) -> Iterable[str]:
    """What thermometers in the air showed."""
    for name, signal in machine.signals.items():
        if signal.role in AIR:
            low, high = extent(conditions, "signals", name)
            if low <= high:
                unit = "°C" if signal.unit == "degC" else signal.unit
                yield f"{name} {_range(low, high, 3)} {unit}"


def _positions(conditions: Sequence[Mapping[str, Any]], machine: Machine) -> str:
    """Where the axes stood."""
    ranges = []
    for axis in machine.structure.axes:
        low, high = extent(conditions, "positions", axis)
        if low <= high:
            unit = "°" if is_rotary(axis) else " mm"
            ranges.append(_unbroken(f"{axis} {_range(low, high)}{unit}"))
    return ", ".join(ranges)


def _tool(conditions: Sequence[Mapping[str, Any]]) -> str:
    """The offsets of the tools, as the rows have them."""
    tools = [c["tool"] for c in conditions if len(c.get("tool", ())) == 3]
    if not tools:
        return ""
    ends = [(min(t[k][0] for t in tools), max(t[k][1] for t in tools)) for k in range(3)]
    if not any(value for pair in ends for value in pair):
        return "no offset"
    parts = (
        _unbroken(f"{name} {_range(*pair)} mm") for name, pair in zip("xyz", ends, strict=True)
    )
    return "offset " + ", ".join(parts)


def _unbroken(text: str) -> str:
    """A text that stays in one line."""
    return text.replace(" ", "\u00a0")


def _range(low: float, high: float, digits: int = 4) -> str:
    one, two = (f"{v:.{digits}g}".replace("-", "−") for v in (low, high))
    return one if one == two else f"{one} … {two}"
