"""A simulated machine with fifty channels, and a full hour of records of it."""

from __future__ import annotations

import sqlite3
import time
from contextlib import closing
from pathlib import Path

from tests.support.daemon.live_run import MODEL

CHANNELS = 50
"""Three axes' positions and thermometers."""
HOUR = 3600.0
EVERY = 0.1
"""s between two records."""


def with_more(config: Path) -> None:
    """The same machine with as many signals as make `CHANNELS`, of its thermistors in turn."""
    text = config.read_text()
    sensors = [line for line in text.splitlines() if line.startswith("[signals.")]
    more = CHANNELS - 3 - len(sensors)
    parts = text.split("[signals.")[1:]
    bodies = [part.partition("]")[2].partition("[")[0].strip() for part in parts]
    model = Path(MODEL).read_text()
    signals, known = [], []
    for k in range(more):
        body = bodies[k % len(bodies)]
        signals.append(f"[signals.T_more_{k + 1}]\n{body}\n")
        known.append(
            f'[machine.signals.T_more_{k + 1}]\nunit = "degC"\nrole = "structure"\n'
            f'location = "place {k + 1}"\n'
        )
    at = model.index("[machine.signals.")
    changed = config.with_name("model.toml")
    changed.write_text(model[:at] + "\n".join(known) + "\n" + model[at:])
    text = text.replace(f'model = "{MODEL}"', 'model = "model.toml"', 1)
    at = text.index("[signals.")
    text = text[:at] + "\n".join(signals) + "\n" + text[at:]
    config.write_text(f"{text}\n[records]\nevery = 0.1\n\n[http]\n")


def filled(path: Path) -> int:
    """Fill the hour before now for each series that a run has begun; how many they are."""
    first, rows = time.time() - HOUR - 60.0, round(HOUR / EVERY)
    with closing(sqlite3.connect(path)) as connection, connection:
        numbers = [row[0] for row in connection.execute("SELECT series FROM series")]
        for number in numbers:
            connection.execute(
                "WITH RECURSIVE t(n) AS (SELECT 0 UNION ALL SELECT n + 1 FROM t WHERE n + 1 < ?) "
                "INSERT OR IGNORE INTO full SELECT ?, ? + n * ?, 20.0 + 1e-3 * (n % 997) FROM t",
                (rows, number, first, EVERY),
            )
    return len(numbers)
