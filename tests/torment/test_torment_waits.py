"""How long a process waited for a processor: counted on, also when it has ended."""

from __future__ import annotations

import os
import subprocess
import sys
import time

from abbe.drivers.simulated.torment.loop import Loop
from abbe.drivers.simulated.torment.waits import ProcessorWaits


def test_of_a_process_that_has_ended_no_time_is_taken_back() -> None:
    loop = Loop()
    waits = ProcessorWaits(loop)
    process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    busy = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
        for _ in range(os.cpu_count() or 1)
    ]
    try:
        waits.begin(process.pid)
        began = time.monotonic()
        while waits.between(began, time.monotonic()) <= 0.0 and time.monotonic() < began + 5.0:
            waits.note(time.monotonic())
            time.sleep(0.02)
    finally:
        for each in (process, *busy):
            each.kill()
            each.wait()
        loop.close()
    assert waits.between(began, time.monotonic()) >= 0.0
    assert waits.between(time.monotonic(), time.monotonic()) >= 0.0
