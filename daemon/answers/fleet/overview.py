"""The answer of ``abbe fleet``: how each machine is, what is wrong, and whether its model holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal

from abbe.daemon.fleet.asked.reading import FleetMachine

SILENT = 300.0
"""s without a word after which a service counts as gone."""
_DAY = 86400.0
_LONGEST = 60
Health = Literal["good", "attention", "alarm", "unknown"]
_ORDER: Mapping[str, int] = {"alarm": 0, "attention": 1, "unknown": 2, "good": 3}


@dataclass(frozen=True, slots=True)
class MachineHealth:
    """How a machine is.

    Attributes
    ----------
    machine
        What the store knows of it.
    health
        In one word.
    words
        In a few.
    alarms
        What is wrong.
    model_age
        Days since the model that runs was fitted; None: not known.
    stale
        Why the model should be looked at again; empty: it need not.
    drift
        What check measurements say, in one line; empty: nothing.
    """

    machine: FleetMachine
    health: Health
    words: str
    alarms: tuple[str, ...]
    model_age: float | None
    stale: tuple[str, ...]
    drift: str

    def as_json(self) -> dict[str, Any]:
        """As ``abbe fleet --json`` prints it."""
        m = self.machine
        return {
            "machine": m.name,
            "type": m.type,
            "site": m.site,
            "structure": m.structure,
            "health": self.health,
            "words": self.words,
            "last_seen": None if m.seen is None else m.seen.isoformat(),
            "silent_s": m.silent,
            "model": {
                "sha256": m.model,
                "fitted": None if m.fitted is None else m.fitted.isoformat(),
                "age_days": self.model_age,
                "stale": list(self.stale),
            },
            "alarms": list(self.alarms),
            "errors_in_a_day": m.errors,
            "drift": self.drift,
        }


def health_of(machine: FleetMachine, now: datetime) -> MachineHealth:
    """Judge a machine by what it said last.

    Parameters
    ----------
    machine
        As the store knows it.
    now
        For the age of its model.
    """
    alarms = tuple(_alarms(machine))
    stale = tuple(_stale(machine))
    health, words = _in_words(machine, bool(alarms), bool(stale))
    age = None if machine.fitted is None else (now - machine.fitted).total_seconds() / _DAY
    return MachineHealth(machine, health, words, alarms, age, stale, _drift(machine))


def overview(machines: Sequence[FleetMachine]) -> list[MachineHealth]:
    """All machines, those that need somebody first."""
    now = datetime.now(UTC)
    found = [health_of(machine, now) for machine in machines]
    return sorted(found, key=lambda h: (_ORDER[h.health], h.machine.site, h.machine.name))


def headline(found: Sequence[MachineHealth]) -> str:
    """How the fleet is, in one line."""
    if not found:
        return "The store knows no machine that you may see: abbe fleet add"
    counts = {kind: sum(h.health == kind for h in found) for kind in _ORDER}
    named = {
        "alarm": "with alarms", "attention": "to be looked at", "unknown": "silent",
        "good": "in order",
    }  # fmt: skip
    said = ", ".join(f"{counts[kind]} {named[kind]}" for kind in _ORDER if counts[kind])
    return f"{len(found)} machine{'s' * (len(found) != 1)}: {said}"


def _in_words(machine: FleetMachine, alarmed: bool, stale: bool) -> tuple[Health, str]:
    status = machine.status
    if machine.seen is None or machine.silent is None:
        return "unknown", "never seen"
    if machine.silent > SILENT:
        return "unknown", f"silent for {duration(machine.silent)}"
    if not status.get("alive", False):
        return "alarm", "does not run"
    words = str(status.get("state", ""))
    if alarmed:
        return "alarm", words
    return ("attention" if stale or not status.get("in_full") else "good"), words


def _alarms(machine: FleetMachine) -> Iterator[str]:
    status = machine.status
    if machine.silent is not None and machine.silent <= SILENT:
        for what, why in dict(status.get("faults", {})).items():
            yield f"{what}: {why}"
        for name, link in dict(status.get("links", {})).items():
            if link.get("state") == "down":
                yield f"link {name} is down"
    if machine.errors:
        yield f"{machine.errors} error{'s' * (machine.errors != 1)} within a day"


def _stale(machine: FleetMachine) -> Iterator[str]:
    checks = machine.status.get("checks") or {}
    if checks.get("verdict") == "changed":
        yield "the machine has changed"
    if not machine.model:
        return
    if machine.fitted is None:
        yield "the model that runs was never fitted"
        return
    if machine.newest_fit is not None and machine.newest_fit > machine.fitted:
        yield f"a newer model was fitted on {machine.newest_fit:%Y-%m-%d}"
    if machine.measured is not None and (machine.measured - machine.fitted).total_seconds() > _DAY:
        yield f"measured again on {machine.measured:%Y-%m-%d}"


def _drift(machine: FleetMachine) -> str:
    """What changed, in the check points' own words, and the one that is nearest to its limit."""
    checks = machine.status.get("checks") or {}
    changed = checks.get("verdict") == "changed"
    said = [str(w).rstrip(".") for w in checks.get("words", ())[:1] if changed]
    surprises = [
        (name, s)
        for name, s in dict(checks.get("series", {})).items()
        if s.get("surprise") is not None
    ]
    if not surprises:
        return "; ".join(said)
    name, worst = max(surprises, key=lambda pair: float(pair[1].get("full", 0.0)))
    unit = {"um": "µm", "urad": "µrad"}.get(worst.get("unit", ""), "")
    sure = worst.get("uncertainty")
    about = f" ± {float(sure):.1f}" if sure is not None else ""
    full = 100.0 * float(worst.get("full", 0.0))
    read = f"{float(worst['surprise']):+.1f}{about} {unit} at {name} ({full:.0f} % of its limit)"
    return "; ".join([*said, read])


def duration(seconds: float) -> str:
    """A time for people, in its largest unit.

    >>> duration(42.0), duration(7200.0), duration(3e5)
    ('42 s', '2 h', '3 d')
    """
    for size, unit in ((_DAY, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * size or (unit != "min" and seconds >= size):
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


def rows(found: Sequence[MachineHealth]) -> list[list[str]]:
    """One row of texts a machine, in the order of `COLUMNS`."""
    return [
        [
            h.machine.name,
            h.machine.type,
            h.machine.site,
            f"{h.health}: {h.words}" if h.words else h.health,
            "–" if h.machine.silent is None else f"{duration(h.machine.silent)} ago",
            _model(h),
            "; ".join(h.alarms) or "–",
            h.drift or "–",
        ]
        for h in found
    ]


COLUMNS = ("machine", "type", "site", "health", "last seen", "model", "alarms", "drift")


def _model(h: MachineHealth) -> str:
    if not h.machine.model:
        return "–"
    age = "not fitted" if h.model_age is None else f"{max(h.model_age, 0.0):.0f} d old"
    return f"{age}, STALE: {'; '.join(h.stale)}" if h.stale else age
