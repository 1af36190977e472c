"""PostgreSQL, Mosquitto and Prometheus as ordinary processes in a folder of their own."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from abbe.compcore.errors import AbbeError

ROOT = Path(__file__).parents[2]
UNPACKED = ROOT / ".venv" / "unpacked"
_PATIENCE = 60.0
_NOBODY = 65534
_GRACE = 10.0


class Engines:
    """Processes that end with the demo, in the order opposite to that of their beginning.

    Parameters
    ----------
    folder
        Where each has a folder of its own.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._running: list[tuple[subprocess.Popen[bytes], signal.Signals]] = []

    def close(self) -> None:
        """End all of them; whoever does not end in ten seconds is killed."""
        while self._running:
            process, number = self._running.pop()
            if process.poll() is None:
                process.send_signal(number)
                try:
                    process.wait(_GRACE)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()

    def processes(self) -> list[int]:
        """Numbers of the processes, in the order in which they were begun."""
        return [process.pid for process, _ in self._running]

    def postgresql(self, settings: Mapping[str, str] = MappingProxyType({})) -> int:
        """Begin a PostgreSQL with no database but its own; its port.

        Parameters
        ----------
        settings
            More lines of its configuration.

        Raises
        ------
        AbbeError
            When it does not start.
        """
        folder, port = self._folder / "postgresql", free_port()
        folder.mkdir(parents=True)
        programs = UNPACKED / "postgresql" / "bin"
        before: list[str] = []
        if os.geteuid() == 0:
            # it does not run as root; who is nobody may go where it lies, and read what it is
            os.chown(folder, _NOBODY, _NOBODY)
            may = "+dac_read_search"
            before = ["setpriv", f"--reuid={_NOBODY}", f"--regid={_NOBODY}", "--clear-groups"]
            before += [f"--inh-caps={may}", f"--ambient-caps={may}"]
        data = folder / "data"
        options = ["-U", "admin", "-A", "trust", "-E", "UTF8", "--locale=C.UTF-8"]
        options += ["--no-instructions"]
        command = [*before, str(programs / "initdb"), "-D", str(data), *options]
        done = subprocess.run(command, env=_environment(), capture_output=True, check=False)
        if done.returncode:
            raise AbbeError(f"PostgreSQL: {done.stderr.decode(errors='replace')[-500:]}")
        with (data / "postgresql.conf").open("a", encoding="utf-8") as file:
            file.write(
                f"listen_addresses = '127.0.0.1'\nport = {port}\nunix_socket_directories = ''\n"
                "shared_buffers = '64MB'\njit = off\nmax_connections = 300\n"
            )
            file.writelines(f"{name} = {value}\n" for name, value in settings.items())
        # 'fast', so that it does not wait for those who look at it
        self._begin([*before, str(programs / "postgres"), "-D", str(data)], folder, signal.SIGINT)
        self._until_it_answers(port, folder)
        return port

    def mosquitto(self) -> int:
        """Begin a Mosquitto on this computer only; its port."""
        folder, port = self._folder / "mosquitto", free_port()
        folder.mkdir(parents=True)
        lines = [f"listener {port} 127.0.0.1", "allow_anonymous true", "persistence false"]
        if os.geteuid() == 0:
            lines.append("user root")
        (folder / "mosquitto.conf").write_text("\n".join(lines) + "\n", "utf-8")
        command = [str(UNPACKED / "usr/sbin/mosquitto"), "-c", str(folder / "mosquitto.conf")]
        self._begin(command, folder, signal.SIGTERM)
        self._until_it_listens("Mosquitto", port, folder)
        return port

    def prometheus(self, targets: Mapping[str, tuple[int, Path]], every: str = "2s") -> int:
        """Begin a Prometheus that watches runs, with Abbe's alert rules; its port.

        Parameters
        ----------
        targets
            Machine → port of its run's HTTP, and the file with its token.
        every
            From one look at each to the next.
        """
        folder, port = self._folder / "prometheus", free_port()
        folder.mkdir(parents=True)
        rules = ROOT / "examples" / "plant" / "abbe-alerts.yml"
        shutil.copy(rules, folder / rules.name)
        text = [f"global: {{ scrape_interval: {every}, evaluation_interval: {every} }}"]
        text += [f"rule_files: [{rules.name}]", "scrape_configs:"]
        for name, (its_port, token) in targets.items():
            # the rules ask for a job that is called abbe
            text += [
                f"  - job_name: abbe-{its_port}",
                f"    authorization: {{ credentials_file: {token} }}",
                "    relabel_configs: [{ target_label: job, replacement: abbe }]",
                "    static_configs:",
                f'      - targets: ["127.0.0.1:{its_port}"]',
                f'        labels: {{ instance: "{name}" }}',
            ]
        (folder / "prometheus.yml").write_text("\n".join(text) + "\n", "utf-8")
        command = [
            str(UNPACKED / "usr/bin/prometheus"),
            f"--config.file={folder / 'prometheus.yml'}",
            f"--storage.tsdb.path={folder / 'data'}",
            f"--web.listen-address=127.0.0.1:{port}",
        ]
        self._begin(command, folder, signal.SIGTERM)
        self._until_it_listens("Prometheus", port, folder)
        return port

    def begin(self, command: Sequence[str], folder: Path, cwd: Path | None = None) -> None:
        """Begin another process; what it says goes into ``log`` in its folder."""
        self._begin(command, folder, signal.SIGINT, cwd)

    def alive(self) -> bool:
        """Whether none has ended."""
        return all(process.poll() is None for process, _ in self._running)

    def _begin(
        self, command: Sequence[str], folder: Path, number: signal.Signals, cwd: Path | None = None
    ) -> None:
        with (folder / "log").open("ab") as log:
            process = subprocess.Popen(
                command,
                env=_environment(),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                cwd=cwd,
                # Ctrl-C is for the demo, which ends them in order
                start_new_session=True,
            )
        self._running.append((process, number))

    def _until_it_answers(self, port: int, folder: Path) -> None:
        """Return when PostgreSQL takes clients: it listens a while before."""
        import psycopg

        self._until_it_listens("PostgreSQL", port, folder)
        deadline = time.monotonic() + _PATIENCE
        while True:
            try:
                psycopg.connect(f"postgresql://admin@127.0.0.1:{port}/postgres").close()
            except psycopg.OperationalError as error:
                if self._running[-1][0].poll() is not None or time.monotonic() > deadline:
                    raise AbbeError(f"PostgreSQL does not answer: {error}") from None
                time.sleep(0.1)
            else:
                return

    def _until_it_listens(self, name: str, port: int, folder: Path) -> None:
        process = self._running[-1][0]
        deadline = time.monotonic() + _PATIENCE
        while process.poll() is None and time.monotonic() < deadline:
            try:
                socket.create_connection(("127.0.0.1", port), 1.0).close()
            except OSError:
                time.sleep(0.1)
            else:
                return
        said = (folder / "log").read_text("utf-8", "replace")[-500:]
        raise AbbeError(f"{name} does not answer at 127.0.0.1:{port}: {said}")


def free_port() -> int:
    """A TCP port that nobody has at this moment."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port: int = taken.getsockname()[1]
        return port


def _environment() -> dict[str, str]:
    libraries = ":".join(
        str(folder)
        for root in ("lib", "usr/lib")
        for folder in (UNPACKED / root).glob("*-linux-gnu*")
    )
    return os.environ | {"LD_LIBRARY_PATH": libraries, "LC_ALL": "C.UTF-8"}
