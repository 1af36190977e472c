"""A whole ``abbe run`` in its own process against a simulated machine in another, and mbpoll."""

from __future__ import annotations

import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from abbe.daemon.demo.configuration import demo_configuration
from abbe.daemon.demo.simulator import Simulator, simulated_bridge
from abbe.drivers.simulated.bridge.registers import MATCHED, REGISTERS, WRITE_BACK

MODEL = Path(__file__).parents[3] / "examples" / "bridge-cmm" / "model.toml"
"""Fitted to a campaign of the simulated machine with seed 1."""

PATIENCE = 60.0
"""s that anything may take on a busy machine."""

Cycle = dict[str, Any]


def mbpoll(*arguments: str, port: int, values: Sequence[int] = ()) -> str:
    """Run Debian's mbpoll, a Modbus client that shares nothing with Abbe."""
    program = shutil.which("mbpoll")
    assert program, "mbpoll is missing: apt install mbpoll (make test does)"
    command = [program, "-m", "tcp", "-a", "1", "-0", "-q", "-p", str(port), *arguments]
    command += ["127.0.0.1", *map(str, values)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def read_holding(port: int, address: int, count: int) -> bytes:
    """Holding registers as they were in one answer, big-endian, read by mbpoll."""
    text = mbpoll("-r", str(address), "-c", str(count), "-t", "4:hex", "-1", port=port)
    words = [int(line.split()[-1], 16) for line in text.splitlines() if line.startswith("[")]
    assert len(words) == count, text
    return struct.pack(f">{count}H", *words)


def set_fault(port: int, name: str, value: int) -> None:
    """Write one of the simulated machine's fault registers."""
    mbpoll("-r", str(REGISTERS[name].address), "-t", "4", port=port, values=[value])


def matched(port: int) -> dict[str, float]:
    """Corrected position, the sample it is for, and the truth for that sample, from one answer."""
    first, last = REGISTERS["corrected_X"], REGISTERS["matched_state"]
    count = last.address + last.size - first.address
    data = read_holding(port, first.address, count)
    found: dict[str, float] = {}
    for register in (*WRITE_BACK.registers, *MATCHED.registers):
        at = 2 * (register.address - first.address)
        if 0 <= at < len(data):
            code = {"uint16": ">H", "int32": ">i", "uint32": ">I"}[register.type]
            (raw,) = struct.unpack_from(code, data, at)
            found[register.name] = raw * register.scale
    return found


class LiveRun:
    """``abbe run --json`` in its own process; its lines are read as they come."""

    def __init__(self, config: Path, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "abbe.daemon", "run", str(config), "--json", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            cwd=config.parent,
        )
        self.cycles: list[Cycle] = []
        self._errors: list[str] = []
        self._readers = [
            threading.Thread(target=self._read_cycles),
            threading.Thread(target=self._read_errors),
        ]
        for reader in self._readers:
            reader.start()

    def _read_cycles(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.cycles.append(json.loads(line))

    def _read_errors(self) -> None:
        assert self.process.stderr is not None
        self._errors.extend(self.process.stderr)

    @property
    def journal(self) -> str:
        """What was said on standard error."""
        return "".join(self._errors)

    def until(self, what: Callable[[Cycle], bool], since: int | None = None) -> Cycle:
        """The first cycle from now (or from index `since`) on of which `what` holds."""
        at = len(self.cycles) if since is None else since
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            while at < len(self.cycles):
                if what(self.cycles[at]):
                    return self.cycles[at]
                at += 1
            assert self.process.poll() is None, f"ended: {self.journal}"
            time.sleep(0.02)
        raise AssertionError(
            f"not seen in {PATIENCE:g} s; last: {self.cycles[-1:]}; {self.journal}"
        )

    def end(self, number: int = signal.SIGTERM) -> int:
        """Ask it to end; its exit status."""
        self.process.send_signal(number)
        status = self.process.wait(PATIENCE)
        for reader in self._readers:
            reader.join(PATIENCE)
        return status

    def close(self) -> None:
        """End whatever is left."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        for reader in self._readers:
            reader.join(PATIENCE)
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()


@contextmanager
def live_run(config: Path, *arguments: str) -> Iterator[LiveRun]:
    """A run that is over when the context is."""
    run = LiveRun(config, *arguments)
    try:
        yield run
    finally:
        run.close()


@contextmanager
def machine(folder: Path, *arguments: str) -> Iterator[tuple[Simulator, Path]]:
    """A simulated machine (seed 1, no scatter) and a configuration for it."""
    with simulated_bridge(1, 1.0, ["--noise", "0", *arguments]) as simulator:
        config = folder / "config.toml"
        text = demo_configuration(simulator.ready, os.fspath(MODEL))
        config.write_text(text, encoding="utf-8")
        yield simulator, config


def compensating(cycle: Cycle) -> bool:
    """Whether every direction is corrected in full."""
    return bool(cycle["guard"]["compensating"])


def error_um(cycle: Cycle, axis: str, key: str = "corrected") -> float:
    """True position minus the corrected (or indicated) one, µm."""
    return 1e3 * (float(cycle["reference"][axis]) - float(cycle[key][axis]))
