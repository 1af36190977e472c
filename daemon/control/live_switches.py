"""Switches changed while a correction runs: what the model file says, and until when they count.

The model file says what is on at every start and after every reload (docs/decisions); what
``abbe switch`` has changed counts until then.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from abbe.compcore.model.days import of_their_day
from abbe.compcore.model.model import Model, Switch

Switches = Mapping[str, Switch]


def changed_live(now: Switches, in_file: Switches) -> dict[str, tuple[Switch, Switch]]:
    """What is not as the model file says: effect, or effect and table → (now, in the file).

    >>> changed_live({"drift": "off", "scale axis=X": "on"}, {"drift": "on", "scale axis=X": "on"})
    {'drift': ('off', 'on')}
    """
    found = {}
    for name in dict.fromkeys([*in_file, *now]):
        one, other = _of(now, name), _of(in_file, name)
        if one is not None and other is not None and one != other:
            found[name] = (one, other)
    return found


def _of(switches: Switches, name: str) -> Switch | None:
    """An effect's switch, or a table's: its effect's, unless it has one; None: not in the model."""
    if name in switches:
        return switches[name]
    owners = [spec for spec in switches if name.startswith(f"{spec} ")]
    return switches[max(owners, key=len)] if owners else None


def until_words(now: Switches, in_file: Switches, model: Path) -> str:
    """Until when the changed switches count, and how they last; empty where none is changed."""
    changed = changed_live(now, in_file)
    if not changed:
        return ""
    there = ", ".join(f"{name} is {switch}" for name, (_, switch) in changed.items())
    return (
        f"until this correction ends, begins anew or is reloaded; then {model} counts again: "
        f"{there}. To have it last, write the switch into {model}"
    )


def back_words(now: Switches, in_file: Switches, then: Switches, model: Path) -> str:
    """What of the live switches an end, or a reload with the switches `then`, takes back."""
    live = changed_live(now, in_file)
    return "; ".join(
        f"{name} was {one} by abbe switch, from here on it is {other}, as {model} says"
        for name, (one, other) in changed_live(now, then).items()
        if name in live
    )


def start_words(model: Model, path: Path) -> str:
    """What is on at the start, as the model file says."""
    off = [f"{name} is {switch}" for name, switch in model.switches.items() if switch != "on"]
    off += of_their_day(model)
    return f"compensations as {path} says: {'; '.join(off) or 'all on'}"
