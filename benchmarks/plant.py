"""Ten minutes of a plant with fifty machines: ``python -m benchmarks.plant``, half an hour.

Simulated machines, a run of Abbe for each with HTTP, MQTT and the upload to the store, a real
PostgreSQL, Mosquitto and Prometheus, all on this computer. Writes its section of
docs/performance.md: rows a second, how long what a machine says is on its way, memory of each part,
and the same rows put in by other ways. ``--machines N``, ``--seconds S``, ``--print-only``.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.parse
import urllib.request
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import psycopg

from benchmarks.many.alternatives import MINUTES, SERIES, WayIn, ways_in
from benchmarks.many.plant import PACE, SimulatedPlant, plant
from benchmarks.many.taken import ProcessTaken, below, parts_of, taken
from benchmarks.measuring.report import machine, write_section

COMMITTED = "extract(epoch FROM pg_xact_commit_timestamp({table}.xmin))::float8"


@dataclass
class Watched:
    """What was seen of the ten minutes.

    Attributes
    ----------
    delays
        Way → s, of each message or row.
    rows
        Table → rows that came into it.
    memory
        Part → MB of each of its processes at the end.
    processor
        Part → s of the processor, all of its processes together.
    load
        Least and greatest load of the computer.
    seconds
        How long.
    pages
        s that each answer of a run to Prometheus took.
    overview
        s that `abbe fleet` took, from its start to its end.
    full
        Part of the looks at the store at which a machine was corrected in full.
    """

    delays: dict[str, list[float]] = field(default_factory=dict)
    rows: dict[str, int] = field(default_factory=dict)
    memory: dict[str, list[float]] = field(default_factory=dict)
    processor: dict[str, float] = field(default_factory=dict)
    load: tuple[float, float] = (0.0, 0.0)
    seconds: float = 0.0
    pages: list[float] = field(default_factory=list)
    overview: float = 0.0
    full: float = 0.0


def watch(running: SimulatedPlant, machines: int, seconds: float) -> Watched:
    """Watch a plant that runs; every machine probes its spheres once, in turn."""
    found = Watched()
    parts = parts_of(running.runs)
    parts |= {name: below([process]) for name, process in running.engines.items()}
    parts["simulated machines"] = [running.simulator.pid]
    before = {name: _sum(taken(p) for p in ids).processor for name, ids in parts.items()}
    loads, fulls, orders = [os.getloadavg()[0]], [], {}
    begin, clock = time.time(), time.monotonic()
    with _listening(running.broker) as messages:
        for k in range(machines):
            time.sleep(max(0.0, clock + (k + 0.5) * 0.8 * seconds / machines - time.monotonic()))
            orders[k + 1] = time.time()
            running.probe(k + 1)
            loads.append(os.getloadavg()[0])
            if k % 5 == 0:
                fulls.append(_in_full(running.store))
        time.sleep(max(0.0, clock + seconds - time.monotonic()))
        after = time.time()
        found.seconds = after - begin
        found.delays["MQTT: a state, made → at a subscriber"] = [
            arrived - at for arrived, at in messages if at >= begin
        ]
    for name, ids in parts.items():
        each = [taken(p) for p in ids]
        found.memory[name] = [t.memory for t in each if t.memory]
        found.processor[name] = _sum(each).processor - before[name]
    found.load = min(loads), max(loads)
    found.full = statistics.fmean(fulls) / machines
    # what was under way when the time was over arrives, too
    time.sleep(PACE.upload + 10.0)
    _of_store(running.store, begin, after, orders, found)
    found.pages = _scrapes(running.prometheus, seconds)
    start = time.monotonic()
    command = [sys.executable, "-m", "abbe.daemon", "fleet", "--store", running.store, "--report"]
    command += [str(running.folder / "fleet.html")]
    subprocess.run(command, check=True, capture_output=True)
    found.overview = time.monotonic() - start
    return found


def _sum(each: Iterable[ProcessTaken]) -> ProcessTaken:
    found = list(each)
    return ProcessTaken(sum(t.memory for t in found), sum(t.processor for t in found))


def _in_full(store: str) -> int:
    with psycopg.connect(store, autocommit=True) as connection:
        row = connection.execute(
            "SELECT count(*) FROM abbe.machines WHERE status->>'in_full' = 'true'"
        ).fetchone()
    return 0 if row is None else int(row[0])


@contextmanager
def _listening(port: int) -> Iterator[list[tuple[float, float]]]:
    """When each state came, and when it was made, s since 1970."""
    import paho.mqtt.client as mqtt
    from paho.mqtt.enums import CallbackAPIVersion

    found: list[tuple[float, float]] = []

    def on_message(_client: Any, _data: Any, message: Any) -> None:
        now = time.time()
        at = datetime.fromisoformat(json.loads(message.payload)["at"])
        found.append((now, at.timestamp()))

    client = mqtt.Client(CallbackAPIVersion.VERSION2)
    client.on_message = on_message
    client.connect("127.0.0.1", port)
    client.subscribe("plant/+/state", 1)
    client.loop_start()
    try:
        yield found
    finally:
        client.disconnect()
        client.loop_stop()


def _of_store(
    store: str, begin: float, after: float, orders: dict[int, float], found: Watched
) -> None:
    """Rows that came into the store, and how long after what they tell."""
    history, events, checks = (COMMITTED.format(table=t) for t in ("history", "events", "checks"))
    with psycopg.connect(store, autocommit=True) as connection:

        def column(question: str, *values: float) -> list[Any]:
            return [row[0] for row in connection.execute(question.encode(), values)]

        came = f"{history} BETWEEN %s AND %s"
        found.delays["store: history, end of its minute → committed"] = column(
            f"SELECT {history} - extract(epoch FROM time)::float8 - span "
            f"FROM abbe.history WHERE {came} AND extract(epoch FROM time) >= %s",
            begin, after + PACE.upload + 5.0, begin,
        )  # fmt: skip
        found.delays["store: an event, journal → committed"] = column(
            f"SELECT {events} - extract(epoch FROM time)::float8 FROM abbe.events "
            "WHERE extract(epoch FROM time) BETWEEN %s AND %s",
            begin, after,
        )  # fmt: skip
        machines = dict(connection.execute("SELECT machine, name FROM abbe.machines").fetchall())
        rows = connection.execute(
            f"SELECT machine, {checks} FROM abbe.checks "  # type: ignore[arg-type]
            "WHERE extract(epoch FROM time) >= %s",
            (begin,),
        ).fetchall()
        found.delays["store: a sphere, the machine probes it → committed"] = [
            committed - orders[int(machines[number].split()[-1])] for number, committed in rows
        ]
        for table, committed in (("history", history), ("events", events), ("checks", checks)):
            question = f"SELECT count(*) FROM abbe.{table} WHERE {committed} BETWEEN %s AND %s"
            found.rows[table] = column(question, begin, after)[0]


def _scrapes(port: int, seconds: float) -> list[float]:
    query = urllib.parse.quote(f'scrape_duration_seconds{{job="abbe"}}[{seconds:.0f}s]')
    url = f"http://127.0.0.1:{port}/api/v1/query?query={query}"
    with urllib.request.urlopen(url, timeout=30.0) as answer:
        result = json.load(answer)["data"]["result"]
    return [float(value) for series in result for _, value in series["values"]]


def section(found: Watched, ways: Sequence[WayIn], machines: int) -> str:
    """The section of docs/performance.md."""
    abbe = ways[0]
    total = sum(found.rows.values())
    rate = total / found.seconds
    lines = [
        "## A plant of many machines",
        "",
        f"{machine()}. {machines} simulated machines for {found.seconds / 60.0:.0f} minutes, a run "
        "of Abbe for each with HTTP, MQTT and the upload to a store, a real PostgreSQL, Mosquitto "
        f"and Prometheus, all on this one computer (`python -m benchmarks.plant`). Its load was "
        f"{found.load[0]:.0f} to {found.load[1]:.0f} on {os.cpu_count()} cores"
        + (", **others worked on it, too**: delays are longer than a plant's"
           if found.load[1] > 4.0 else "")
        + f". States by MQTT each 5 s, uploads each {PACE.upload:g} s (the defaults), history in "
        f"spans of a minute (ten times the default's rows), Prometheus each 15 s, cycles each "
        f"{PACE.cycle:g} s. In the mean {100.0 * found.full:.1f} % of the machines were corrected "
        "in full.",
        "",
        "| on its way | of | median, s | 99 %, s | most, s |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]  # fmt: skip
    for way, delays in [*found.delays.items(), ("HTTP: an answer to Prometheus", found.pages)]:
        if len(delays) > 1:
            lines.append(
                f"| {way} | {len(delays):,} | {statistics.median(delays):.2f} | "
                f"{_quantile(delays, 0.99):.2f} | {max(delays):.2f} |"
            )
    lines += [
        "",
        f"What goes to the store waits for the next upload, up to {PACE.upload:g} s, and a minute "
        "of history two seconds more; what a sphere says is worked out before by a process that "
        "steps back behind all others, and waits on a computer that is never idle. Into the store: "
        + ", ".join(f"{count:,} rows of {table}" for table, count in found.rows.items())
        + f", {rate:.1f} rows/s. `abbe fleet --report` over the {machines} machines took "
        f"{found.overview:.1f} s.",
        "",
        "| part | processes | memory of each, MB (most) | together, MB | processor, % of a core |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    for part, each in found.memory.items():
        if each:
            share = 100.0 * found.processor[part] / found.seconds
            lines.append(
                f"| {part} | {len(each)} | {statistics.median(each):.1f} ({max(each):.1f}) | "
                f"{sum(each):,.0f} | {share:.1f} |"
            )
    lines += [
        "",
        "Memory that several processes share is divided among them. **The store's own way**: "
        f"{SERIES} series × {MINUTES:,} spans of one machine, into the same tables with their keys "
        "and partitions, one after the other. Abbe's upload reads and thins the machine's own "
        "records first, and keeps how far it is: 24 spans a transaction, as a role that sees no "
        "other machine.",
        "",
        f"| way | rows/s | ÷ Abbe's | sender's processor, µs a row | × what {machines} machines "
        "say |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    for way in ways:
        pace = way.rows / way.wall
        lines.append(
            f"| {way.name} | {pace:,.0f} | {pace / (abbe.rows / abbe.wall):.2f} | "
            f"{1e6 * way.processor / way.rows:.0f} | {pace / rate:,.0f} |"
        )
    return "\n".join(lines)


def _quantile(values: Sequence[float], part: float) -> float:
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(part * len(ordered)))]


def main() -> None:
    """Measure, print, write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument(
        "--apart", type=float, default=1.0, help="s from one run's start to the next"
    )
    parser.add_argument("--print-only", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="abbe-plant-") as name:
        folder = Path(name)
        folder.chmod(0o755)
        with plant(folder, options.machines, options.apart) as running:
            print("all begun", flush=True)
            running.until_all_are_corrected(options.machines)
            print("all corrected", flush=True)
            found = watch(running, options.machines, options.seconds)
            for process in running.runs:
                os.kill(process, 15)
            port = int(running.store.rpartition(":")[2].partition("/")[0])
            ways = ways_in(folder, running.store, port)
        text = section(found, ways, options.machines)
    print(text)
    if not options.print_only:
        write_section("plant", text)


if __name__ == "__main__":
    main()
