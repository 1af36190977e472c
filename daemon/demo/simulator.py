"""The simulated machine as a process of its own, spoken to over Modbus only."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from abbe.compcore.errors import AbbeError
from abbe.drivers.simulated.process import GRACE, end


@dataclass(frozen=True)
class Simulator:
    """A running simulated machine.

    Attributes
    ----------
    host, port
        Where it listens.
    ready
        What it said of itself: unit id, register map, transducers of its sensors.
    process
        The process, for tests that pull its plug.
    """

    host: str
    port: int
    ready: dict[str, Any]
    process: subprocess.Popen[str]


@contextmanager
def simulated_bridge(
    seed: int, time_factor: float, more: Sequence[str] = ()
) -> Iterator[Simulator]:
    """Run the simulated bridge CMM; it ends with the context, and with this process in any case.

    Parameters
    ----------
    seed
        Which machine.
    time_factor
        Shop seconds per second: how fast its temperatures drift.
    more
        Further arguments of ``python -m abbe.drivers.simulated bridge``.

    Raises
    ------
    AbbeError
        When it does not start.
    """
    command = [sys.executable, "-m", "abbe.drivers.simulated", "bridge", "--die-with-stdin"]
    command += ["--seed", str(seed), "--time-factor", f"{time_factor:g}", *more]
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        start_new_session=True,  # Ctrl-C is for Abbe, which still has its last word to write
    )
    try:
        line = process.stdout.readline() if process.stdout is not None else ""
        if not line:
            raise AbbeError(
                f"the simulated machine did not start (exit status {process.wait(GRACE)}); "
                f"try by hand: {' '.join(command)}"
            )
        ready = json.loads(line)
        yield Simulator(str(ready["host"]), int(ready["port"]), ready, process)
    finally:
        end(process)


def measure_bridge(seed: int, output: str) -> None:
    """Have the simulated machine measured by its instruments; writes a campaign file.

    Raises
    ------
    AbbeError
        When it could not be written.
    """
    command = [sys.executable, "-m", "abbe.drivers.simulated", "measure"]
    command += ["--seed", str(seed), "--output", output]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)
    if done.returncode:
        raise AbbeError(f"the measurement failed: {done.stderr.strip()}")
