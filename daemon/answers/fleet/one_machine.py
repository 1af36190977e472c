"""The answer of ``abbe fleet show``: what the store knows of one machine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

from abbe.daemon.answers.fleet.overview import duration, health_of
from abbe.daemon.fleet.asked.reading import FleetMachine, FleetStore

_EVENTS = 10
_SHOWN = 12


def one_machine(store: FleetStore, machine: FleetMachine, days: float) -> dict[str, Any]:
    """All of it, as ``--json`` prints it.

    Parameters
    ----------
    store, machine
        Who is asked, of which machine.
    days
        Of which history is told.
    """
    health = health_of(machine, datetime.now(UTC))

    def plain(found: list[Any]) -> list[dict[str, Any]]:
        return [
            {k: v.isoformat() if isinstance(v, datetime) else v for k, v in asdict(f).items()}
            for f in found
        ]

    return {
        **health.as_json(),
        "models": plain(store.models(machine)),
        "campaigns": plain(store.campaigns(machine)),
        "checks": len(store.checks(machine)[1]),
        "days": days,
        "series": plain(store.series(machine, days)),
        "events": plain(store.events(machine, _EVENTS)),
    }


def lines(found: dict[str, Any]) -> Iterator[str]:
    """The same for people."""
    yield f"{found['machine']} · {found['type']} · site {found['site']} · {found['structure']}"
    silent = found["silent_s"]
    seen = "never seen" if silent is None else f"last seen {duration(silent)} ago"
    yield f"{found['health']}: {found['words']} ({seen})" if silent is not None else seen
    for alarm in found["alarms"]:
        yield f"  alarm: {alarm}"
    for why in found["model"]["stale"]:
        yield f"  stale model: {why}"
    if found["drift"]:
        yield f"  drift: {found['drift']}"
    for what in ("models", "campaigns"):
        yield f"{what}: {len(found[what])}"
        for file in found[what][-_EVENTS:]:
            at = (file["at"] or "never fitted")[:16].replace("T", " ")
            runs = " (runs)" if file["sha256"] == found["model"]["sha256"] else ""
            yield f"  {at:16}  {file['path']}  SHA-256 {file['sha256'][:_SHOWN]}{runs}"
    yield f"check readings: {found['checks']}"
    if found["series"]:
        width = max(len(s["name"]) for s in found["series"])
        yield f"history of {found['days']:g} d:"
        yield f"  {'':{width}}  {'least':>12} {'mean':>12} {'greatest':>12}"
        for s in found["series"]:
            yield (
                f"  {s['name']:{width}}  {s['least']:12.6g} {s['mean']:12.6g} "
                f"{s['greatest']:12.6g} {s['unit']}"
            )
    if found["events"]:
        yield "last events:"
    for event in found["events"]:
        at = event["time"][:19].replace("T", " ")
        yield f"  {at}  {event['level'].lower():7} {event['message']}"
