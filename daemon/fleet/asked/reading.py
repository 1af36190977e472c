"""Questions to the plant's store: which machines, how they are, their models and campaigns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, LiteralString

from abbe.compcore.errors import AbbeError, InputError
from abbe.daemon.fleet.store.connecting import Store
from abbe.daemon.fleet.store.migrating import require_current


@dataclass(frozen=True, slots=True)
class FleetMachine:
    """A machine as the store knows it.

    Attributes
    ----------
    number
        In the store.
    site, name, type
        As it was added.
    structure
        As its model has it.
    seen
        When its service last said that it is there, by the store's clock; None: never.
    silent
        s since then.
    status
        What the run said of itself then, as `RunStatus` has it; empty: nothing yet.
    model
        SHA-256 of the model that runs; empty: not known.
    fitted
        When that was fitted.
    newest_fit
        When the newest model of the machine in the store was.
    measured
        When the newest campaign was changed last.
    errors
        Events of level ERROR or worse within the last day.
    last_check
        When check points were measured last.
    """

    number: int
    site: str
    name: str
    type: str
    structure: str
    seen: datetime | None
    silent: float | None
    status: Mapping[str, Any]
    model: str
    fitted: datetime | None
    newest_fit: datetime | None
    measured: datetime | None
    errors: int
    last_check: datetime | None


@dataclass(frozen=True, slots=True)
class FleetFile:
    """A model or a campaign in the store.

    Attributes
    ----------
    path
        As the machine's configuration reaches it.
    sha256
        Of its content.
    at
        Of a model: when it was fitted; of a campaign: when it was changed last; None: not known.
    stored
        When it came.
    size
        Bytes.
    """

    path: str
    sha256: str
    at: datetime | None
    stored: datetime
    size: int


@dataclass(frozen=True, slots=True)
class FleetEvent:
    """One event of a machine's journal."""

    time: datetime
    level: str
    part: str
    message: str


@dataclass(frozen=True, slots=True)
class FleetSeries:
    """A series' least, mean and greatest over some time."""

    name: str
    unit: str
    least: float
    mean: float
    greatest: float
    count: int


_MACHINES: LiteralString = """
SELECT m.machine, m.site, m.name, m.type, m.structure, m.seen,
    extract(epoch FROM now() - m.seen)::float8, coalesce(m.status, '{}'), m.model,
    (SELECT fitted FROM abbe.models f WHERE f.machine = m.machine AND f.sha256 = m.model),
    (SELECT max(fitted) FROM abbe.models f WHERE f.machine = m.machine),
    (SELECT max(changed) FROM abbe.campaigns c WHERE c.machine = m.machine AND c.current),
    (SELECT count(*) FROM abbe.events e WHERE e.machine = m.machine
        AND e.time > now() - interval '1 day' AND e.level IN ('ERROR', 'CRITICAL')),
    (SELECT max(time) FROM abbe.checks k WHERE k.machine = m.machine)
FROM abbe.machines m
WHERE (%(site)s = '' OR m.site = %(site)s) AND (%(type)s = '' OR m.type = %(type)s)
ORDER BY m.site, m.name
"""


class FleetStore:
    """The store, as far as the one who asks may see it.

    Parameters
    ----------
    store
        A connection.

    Raises
    ------
    AbbeError
        Where it has not what this Abbe needs.
    """

    def __init__(self, store: Store) -> None:
        require_current(store)
        self._store = store

    def machines(self, site: str = "", kind: str = "") -> list[FleetMachine]:
        """All machines; of a site, of a type, where these are named."""
        rows = self._store.execute(_MACHINES, {"site": site, "type": kind}).fetchall()
        return [FleetMachine(*row) for row in rows]

    def machine(self, name: str, site: str = "") -> FleetMachine:
        """The machine of a name.

        Raises
        ------
        InputError
            Where there is none, or several of different sites.
        """
        there = self.machines(site)
        found = [m for m in there if m.name == name]
        if len(found) == 1:
            return found[0]
        if found:
            raise InputError(
                "machines of several sites have this name",
                field="--site",
                found=name,
                expected=", ".join(m.site for m in found),
            )
        raise InputError(
            "the store has no such machine, or does not show it to you",
            field="MACHINE",
            found=name,
            expected=", ".join(sorted({m.name for m in there})[:20]) or "none is known yet",
        )

    def models(self, machine: FleetMachine) -> list[FleetFile]:
        """A machine's models, oldest first."""
        rows = self._store.execute(
            "SELECT path, sha256, fitted, stored, length(content) FROM abbe.models "
            "WHERE machine = %s ORDER BY fitted NULLS FIRST, stored",
            (machine.number,),
        )
        return [FleetFile(*row) for row in rows]

    def campaigns(self, machine: FleetMachine, *, past: bool = False) -> list[FleetFile]:
        """A machine's campaigns, oldest first; with `past` also contents that were replaced."""
        rows = self._store.execute(
            "SELECT path, sha256, changed, stored, length(content) FROM abbe.campaigns "
            "WHERE machine = %s AND (current OR %s) ORDER BY changed, path",
            (machine.number, past),
        )
        return [FleetFile(*row) for row in rows]

    def model_content(self, machine: FleetMachine, sha256: str) -> bytes:
        """A model's file.

        Raises
        ------
        AbbeError
            Where it is not there.
        """
        return self._content("models", machine, sha256)

    def campaign_content(self, machine: FleetMachine, sha256: str) -> bytes:
        """A campaign's file.

        Raises
        ------
        AbbeError
            Where it is not there.
        """
        return self._content("campaigns", machine, sha256)

    def checks(self, machine: FleetMachine) -> tuple[str, list[dict[str, str]]]:
        """The head and the rows of a machine's file of check measurements."""
        head = self._store.execute(
            "SELECT checks_head FROM abbe.machines WHERE machine = %s", (machine.number,)
        ).fetchone()
        rows = self._store.execute(
            "SELECT reading FROM abbe.checks WHERE machine = %s ORDER BY time, number",
            (machine.number,),
        )
        return (head[0] if head else ""), [row[0] for row in rows]

    def events(
        self, machine: FleetMachine, most: int, levels: Sequence[str] = ()
    ) -> list[FleetEvent]:
        """The last events, oldest first; of some levels where these are named."""
        rows = self._store.execute(
            "SELECT time, level, part, message FROM abbe.events WHERE machine = %s "
            "AND (%s OR level = ANY(%s)) ORDER BY time DESC, event DESC LIMIT %s",
            (machine.number, not levels, list(levels), most),
        )
        return [FleetEvent(*row) for row in rows][::-1]

    def series(self, machine: FleetMachine, days: float) -> list[FleetSeries]:
        """Least, mean and greatest of every series in the last days."""
        rows = self._store.execute(
            "SELECT s.name, s.unit, min(h.least), sum(h.mean * h.count) / sum(h.count), "
            "max(h.greatest), sum(h.count)::bigint FROM abbe.history h "
            "JOIN abbe.series s USING (machine, series) WHERE h.machine = %s "
            "AND h.time > now() - make_interval(secs => %s) "
            "GROUP BY s.series, s.name, s.unit ORDER BY s.series",
            (machine.number, 86400.0 * days),
        )
        return [FleetSeries(*row) for row in rows]

    def _content(self, table: str, machine: FleetMachine, sha256: str) -> bytes:
        row = self._store.execute(
            f"SELECT content FROM abbe.{table} WHERE machine = %s AND sha256 = %s".encode(),
            (machine.number, sha256),
        ).fetchone()
        if row is None:
            raise AbbeError(f"the store has not this file of {machine.name}: {sha256[:12]}")
        return bytes(row[0])
