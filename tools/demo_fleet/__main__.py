"""``python -m tools.demo_fleet``: three machines in one plant, one of which has begun to drift.

Everything lies in one folder and ends with this command, also by Ctrl-C: PostgreSQL, Mosquitto,
Prometheus, the simulated machines, and a run of Abbe for each.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from abbe.compcore.errors import AbbeError
from abbe.drivers.simulated.process import end
from tools.demo_fleet.engines import ROOT, Engines, free_port
from tools.demo_fleet.machines import KIND, SITE, Ports, configuration, measured, named

MACHINES = ("CMM 1", "CMM 2", "CMM 3")
DRIFTING = 2
MARK = ".abbe-demo-fleet"
_PATIENCE = 900.0
_START = ROOT / "daemon" / "demo" / "bridge.toml"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demo; its exit status."""
    parser = argparse.ArgumentParser(prog="make demo-fleet", description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path("demo-out/fleet"))
    parser.add_argument(
        "--seconds", type=float, help="s that it stays when all is shown; default: until Ctrl-C"
    )
    options = parser.parse_args(arguments)
    folder: Path = options.folder.absolute()
    # a terminal that is closed, and whoever ends it, end all of it, too
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)
    try:
        _clear(folder)
        return _Demo(folder, options.seconds).run()
    except KeyboardInterrupt:
        _say("Ended.")
        return 0
    except (AbbeError, OSError) as error:
        sys.stderr.write(f"demo-fleet: {error}\n")
        return 1


class _Demo:
    """One demo in its folder."""

    def __init__(self, folder: Path, seconds: float | None) -> None:
        self._folder, self._seconds = folder, seconds
        self._engines = Engines(folder)
        self._store = ""

    def run(self) -> int:
        """From nothing to the page, and on until it is ended."""
        simulator: subprocess.Popen[str] | None = None
        try:
            _say("Starting PostgreSQL and Mosquitto …")
            port, broker = self._engines.postgresql(), self._engines.mosquitto()
            self._store = f"postgresql://admin@127.0.0.1:{port}/abbe"
            _make_database(f"postgresql://admin@127.0.0.1:{port}/postgres")
            self._abbe("fleet", "init", "--store", self._store)
            _say("Measuring the type of machine, fitting its model …")
            model = self._fitted()
            simulator, ready = self._simulated()
            _say("Three machines, forty-two days of check points each; one run of Abbe a machine …")
            targets = {}
            for name, fact in zip(MACHINES, ready["machines"], strict=True):
                ports = Ports(fact["port"], free_port(), broker, port)
                targets[name] = ports.http, self._machine(name, model, fact["past"], ports)
            prometheus = self._engines.prometheus(targets)
            self._until("every machine is corrected in full", self._all_corrected)
            _say("\nThis is the plant as its store knows it:\n")
            print(self._abbe("fleet", "--store", self._store))  # noqa: T201
            _say("It is morning: every machine probes its four spheres …")
            _order(simulator, {"do": "probe"})
            self._until("the store knows which machine has changed", self._changed)
            self._show(prometheus)
            self._stay()
        finally:
            if simulator is not None:
                end(simulator)
            self._engines.close()
        _say("Ended: nothing of it runs any more.")
        return 0

    def _fitted(self) -> str:
        """The text of the type's model, fitted to what its instruments measured."""
        measured, model = self._folder / "campaign.csv", self._folder / "model.toml"
        simulated = [sys.executable, "-m", "abbe.drivers.simulated", "measure"]
        _run([*simulated, "--seed", "1", "--output", str(measured)])
        self._abbe("fit", str(_START), str(measured), "-o", str(model))
        return model.read_text("utf-8")

    def _simulated(self) -> tuple[subprocess.Popen[str], dict[str, Any]]:
        command = [sys.executable, "-m", "abbe.drivers.simulated", "fleet", "--die-with-stdin"]
        command += ["--machines", str(len(MACHINES)), "--drifting", str(DRIFTING)]
        command += ["--past", str(self._folder / "past")]
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            start_new_session=True,
        )
        line = process.stdout.readline() if process.stdout is not None else ""
        if not line:
            raise AbbeError("the simulated machines did not start")
        return process, json.loads(line)

    def _machine(self, name: str, model: str, past: str, ports: Ports) -> Path:
        """One machine's folder, its record of checks, its run; the file with its HTTP token."""
        folder = self._folder / name.replace(" ", "-").lower()
        folder.mkdir(parents=True)
        fitted = datetime.now(UTC) - timedelta(days=70)
        date = fitted.isoformat(timespec="seconds")
        (folder / "model.toml").write_text(named(model, name, date), "utf-8")
        campaign = folder / "campaigns" / "installed.csv"
        campaign.parent.mkdir()
        text = (self._folder / "campaign.csv").read_text("utf-8")
        campaign.write_text(measured(text, name), "utf-8")
        # it was measured on the day before, and a file says so by its time only
        os.utime(campaign, times=(fitted.timestamp() - 86400.0,) * 2)
        role = f"abbe_{folder.name.replace('-', '_')}"
        config = folder / "config.toml"
        config.write_text(configuration(role, ports), "utf-8")
        secret = folder / "store.secret"
        known = ["--site", SITE, "--type", KIND, "--role", role, "--password-file", str(secret)]
        self._abbe("fleet", "add", name, *known, "--store", self._store)
        kept = ["--checks", str(folder / "checks.csv"), "--lasting"]
        self._abbe("check-point", str(folder / "model.toml"), "--campaign", past, *kept)
        token = folder / "prometheus.token"
        said = self._abbe("token", "add", str(config), "prometheus")
        token.write_text(said.split()[-1], "utf-8")
        token.chmod(0o600)
        self._engines.begin([*_ABBE, "run", str(config)], folder, folder)
        return token

    def _abbe(self, *arguments: str) -> str:
        """A command as a user types it; what it says."""
        return _run([*_ABBE, *arguments])

    def _machines(self) -> list[dict[str, Any]]:
        """What the store says of all machines."""
        said = self._abbe("fleet", "--store", self._store, "--json")
        machines: list[dict[str, Any]] = json.loads(said)["machines"]
        return machines

    def _all_corrected(self) -> bool:
        found = self._machines()
        return len(found) == len(MACHINES) and all(m["health"] == "good" for m in found)

    def _changed(self) -> bool:
        return any(_has_changed(machine) for machine in self._machines())

    def _until(self, what: str, holds: Any) -> None:
        deadline = time.monotonic() + _PATIENCE
        while not holds():
            if not self._engines.alive():
                raise AbbeError(f"something has ended; see the files 'log' in {self._folder}")
            if time.monotonic() > deadline:
                raise AbbeError(f"not within {_PATIENCE:g} s: {what}")
            time.sleep(1.0)

    def _show(self, prometheus: int) -> None:
        page = self._folder / "fleet.html"
        report = ["--report", str(page), "--force"]
        print(self._abbe("fleet", "--store", self._store, *report))  # noqa: T201
        changed = next(m["machine"] for m in self._machines() if _has_changed(m))
        folder = self._folder / changed.replace(" ", "-").lower()
        rows = folder / "changed.csv"
        said = self._abbe("check-point", str(folder / "config.toml"), "--changed", str(rows))
        _say(f"\nWhich: {changed}. What its check points say:\n")
        print("\n".join(said.splitlines()[:4]))  # noqa: T201
        _say("\nWhy (abbe diagnose):\n")
        found = self._abbe("diagnose", str(folder / "model.toml"), str(rows))
        print("\n".join(found.splitlines()[:12]))  # noqa: T201
        _say(f"\nThe page:              {page}")
        _say(f"Prometheus, alerts:    http://127.0.0.1:{prometheus}/alerts")
        _say(f"The store:             ABBE_STORE={self._store} abbe fleet show '{changed}'")
        alerts = _alerts(prometheus)
        if alerts:
            _say(f"Prometheus alarms at present: {', '.join(alerts)}")

    def _stay(self) -> None:
        if self._seconds is not None:
            time.sleep(self._seconds)
            return
        _say("\nCtrl-C ends it all.")
        while self._engines.alive():
            time.sleep(0.5)


def _has_changed(machine: dict[str, Any]) -> bool:
    return any("changed" in why for why in machine["model"]["stale"])


_ABBE = [sys.executable, "-m", "abbe.daemon"]


def _run(command: Sequence[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)
    if done.returncode:
        raise AbbeError(f"{' '.join(command[2:])}: {done.stderr.strip()[-1000:]}")
    return done.stdout


def _order(simulator: subprocess.Popen[str], order: dict[str, Any]) -> None:
    if simulator.stdin is not None:
        simulator.stdin.write(json.dumps(order) + "\n")
        simulator.stdin.flush()


def _make_database(url: str) -> None:
    import psycopg

    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute("CREATE DATABASE abbe")


def _alerts(port: int) -> list[str]:
    url = f"http://127.0.0.1:{port}/api/v1/alerts"
    try:
        with urllib.request.urlopen(url, timeout=5.0) as answer:
            found = json.load(answer)["data"]["alerts"]
    except (OSError, ValueError, KeyError):
        return []
    return sorted({f"{a['labels']['alertname']} ({a['labels'].get('instance')})" for a in found})


def _clear(folder: Path) -> None:
    """An empty folder; one of somebody else's is left alone.

    Raises
    ------
    AbbeError
        When it is not empty, and was not made by this demo.
    """
    mark = folder / MARK
    if folder.exists() and not mark.exists() and any(folder.iterdir()):
        raise AbbeError(f"{folder} is not empty, and not of this demo; choose another --folder")
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    mark.touch()
    os.chmod(folder, 0o755)  # noqa: PTH101


def _say(text: str) -> None:
    print(text, flush=True)  # noqa: T201


if __name__ == "__main__":
    sys.exit(main())
