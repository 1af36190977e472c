"""A disk that another program keeps busy: ``… busy_disk FOLDER RECORDS``.

Writes and syncs without end beside Abbe's files, and keeps the database locked, until it is killed.
"""

from __future__ import annotations

import contextlib
import os
import sqlite3
import sys
from pathlib import Path

_BLOCK = 1 << 22


def main(folder: Path, records: Path) -> None:
    """Go on until killed."""
    filler = folder / "filler"
    with contextlib.closing(sqlite3.connect(records, timeout=0.5)) as database:
        with contextlib.suppress(sqlite3.Error):
            database.execute("BEGIN IMMEDIATE")
        data = os.urandom(_BLOCK)
        while True:
            with filler.open("wb") as file:
                file.write(data)
                os.fsync(file.fileno())


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
