"""Fifty machines on one computer: simulated, each with a run of Abbe, a store, a broker."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psycopg

from abbe.daemon.application import application
from abbe.daemon.fleet.store.migrating import migrate
from abbe.daemon.fleet.store.roles import add_machine
from abbe.drivers.simulated.process import end
from tools.demo_fleet.engines import Engines, free_port
from tools.demo_fleet.machines import KIND, SITE, Pace, Ports, configuration, named

START = Path(__file__).resolve().parents[2] / "daemon" / "demo" / "bridge.toml"
PACE = Pace(cycle=0.5, signals=1.0, upload=30.0)
"""How a plant's machines say something: uploads at the default; a slower cycle, which says no more
to anybody, so that fifty have one computer."""
_COMMIT_TIMES = {"track_commit_timestamp": "on"}
_PATIENCE = 1800.0


@dataclass
class SimulatedPlant:
    """What runs.

    Attributes
    ----------
    folder
        Of all of it.
    store
        URL of an administrator.
    broker, prometheus
        Ports.
    simulator
        The process of the machines.
    runs
        Processes of Abbe, one a machine.
    engines
        The processes of PostgreSQL, Mosquitto and Prometheus, by name.
    """

    folder: Path
    store: str
    broker: int
    simulator: subprocess.Popen[str]
    prometheus: int = 0
    runs: list[int] = field(default_factory=list)
    engines: dict[str, int] = field(default_factory=dict)

    def probe(self, machine: int) -> None:
        """Have a machine probe its spheres."""
        assert self.simulator.stdin is not None
        self.simulator.stdin.write(json.dumps({"do": "probe", "machine": machine}) + "\n")
        self.simulator.stdin.flush()

    def until_all_are_corrected(self, machines: int) -> None:
        """Return when the store knows of every machine that it is corrected in full."""
        asked = (
            "SELECT count(*) FROM abbe.machines WHERE status->>'in_full' = 'true' "
            "AND seen > now() - interval '5 minutes'"
        )
        deadline = time.monotonic() + _PATIENCE
        with psycopg.connect(self.store, autocommit=True) as connection:
            while (row := connection.execute(asked).fetchone()) != (machines,):
                if time.monotonic() > deadline:
                    raise SystemExit(f"{row} of {machines} machines are corrected in full")
                time.sleep(5.0)


@contextmanager
def plant(folder: Path, machines: int, apart: float) -> Iterator[SimulatedPlant]:
    """Begin all of it; gone when the context is.

    Parameters
    ----------
    folder
        Empty.
    machines
        How many.
    apart
        s from one run's beginning to the next.
    """
    engines = Engines(folder)
    simulator: subprocess.Popen[str] | None = None
    try:
        port, broker = engines.postgresql(_COMMIT_TIMES), engines.mosquitto()
        base, store = (f"postgresql://admin@127.0.0.1:{port}/{d}" for d in ("postgres", "abbe"))
        with psycopg.connect(base, autocommit=True) as connection:
            connection.execute("CREATE DATABASE abbe")
        with psycopg.connect(store, autocommit=True) as connection:
            migrate(connection)
        simulator, ready = _simulated(folder, machines)
        found = SimulatedPlant(folder, store, broker, simulator)
        found.engines = dict(zip(("PostgreSQL", "Mosquitto"), engines.processes(), strict=True))
        model = _fitted(folder)
        targets = {}
        for fact in ready["machines"]:
            name = f"CMM {fact['machine']:02d}"
            ports = Ports(fact["port"], free_port(), broker, port)
            targets[name] = ports.http, _machine(folder, name, model, fact["past"], ports, store)
        found.prometheus = engines.prometheus(targets, "15s")
        found.engines["Prometheus"] = engines.processes()[-1]
        for name in targets:
            own = folder / _short(name)
            engines.begin(
                [sys.executable, "-m", "abbe.daemon", "run", str(own / "config.toml")], own, own
            )
            time.sleep(apart)
        found.runs = engines.processes()[3:]
        yield found
    finally:
        if simulator is not None:
            end(simulator)
        engines.close()


def _simulated(folder: Path, machines: int) -> tuple[subprocess.Popen[str], dict[str, Any]]:
    command = [sys.executable, "-m", "abbe.drivers.simulated", "fleet", "--die-with-stdin"]
    command += ["--machines", str(machines), "--past", str(folder / "past")]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8",
        start_new_session=True,
    )  # fmt: skip
    line = process.stdout.readline() if process.stdout is not None else ""
    if not line:
        raise SystemExit("the simulated machines did not start")
    return process, json.loads(line)


def _fitted(folder: Path) -> str:
    measured, model = folder / "campaign.csv", folder / "model.toml"
    simulated = [sys.executable, "-m", "abbe.drivers.simulated", "measure"]
    subprocess.run([*simulated, "--seed", "1", "--output", str(measured)], check=True)
    _abbe("fit", str(START), str(measured), "-o", str(model))
    return model.read_text("utf-8")


def _machine(
    folder: Path, name: str, model: str, past: str, ports: Ports, store: str
) -> Path:  # fmt: skip
    """One machine's folder and role, its record of checks; the file with its HTTP token."""
    own = folder / _short(name)
    own.mkdir()
    (own / "model.toml").write_text(named(model, name, "2026-09-01T08:00:00+00:00"), "utf-8")
    role = f"abbe_{_short(name).replace('-', '_')}"
    (own / "config.toml").write_text(configuration(role, ports, PACE), "utf-8")
    secret = own / "store.secret"
    secret.touch(0o600)
    secret.write_text("of no use elsewhere\n", "utf-8")
    with psycopg.connect(store, autocommit=True) as connection:
        add_machine(connection, name, SITE, KIND, role, "of no use elsewhere")
    kept = ["--checks", str(own / "checks.csv"), "--lasting"]
    _abbe("check-point", str(own / "model.toml"), "--campaign", past, *kept)
    token = own / "prometheus.token"
    token.touch(0o600)
    said = _abbe("token", "add", str(own / "config.toml"), "prometheus")
    token.write_text(said.split()[-1], "utf-8")
    return token


def _abbe(*words: str) -> str:
    """A command, in this process: a hundred of them would begin for minutes."""
    from contextlib import redirect_stdout
    from io import StringIO

    said = StringIO()
    with redirect_stdout(said):
        application(words[0])(list(words), standalone_mode=False)
    return said.getvalue()


def _short(name: str) -> str:
    return name.replace(" ", "-").lower()
