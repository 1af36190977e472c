"""The past of a run out of a hundred million records: how long a picture of it takes."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from statistics import median

from abbe.daemon.records.schema import open_to_write
from abbe.daemon.workbench.live.history import one_picture, overview

_SERIES = 16
_TURNS = 3
_WHILE = {"an hour": 3600.0, "a day": 86_400.0, "a week": 7 * 86_400.0}


def far_past(rows: int) -> str:
    """Measure; the figures as a page has them."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "records.sqlite"
        each = rows // _SERIES
        began = time.monotonic()
        _write(path, each)
        built = time.monotonic() - began
        size = path.stat().st_size / 1e6
        last = float(each)
        began = time.process_time()
        known = overview(path, None)
        looked = 1e3 * (time.process_time() - began)
        lines = []
        for words, seconds in _WHILE.items():
            for picture in known["pictures"]:
                took = []
                for _ in range(_TURNS):
                    began = time.process_time()
                    one_picture(path, None, picture["name"], max(0.0, last - seconds), last)
                    took.append(1e3 * (time.process_time() - began))
                within = min(seconds, last) * len(picture["series"])
                lines.append(
                    f"| {picture['title']} over {words}: {len(picture['series'])} curves | "
                    f"{within:,.0f} | {median(took):.0f} ms |"
                )
    table = "\n".join(lines)
    return f"""### The past out of {rows:,} records

{_SERIES} series, one value a second each, all kept in full ({size:,.0f} MB, written
in {built:.0f} s): what the live view asks for when somebody drags across a
picture: processor time, median of {_TURNS} turns. From when to when there are records, and of
what, asked every ten seconds: {looked:.1f} ms.

| picture | values in it | processor time |
| --- | ---: | ---: |
{table}

Values older than `full_days` (7 as delivered) are kept as minutes, then as hours: a picture of a
month reads no more than one of a week."""


def _write(path: Path, each: int) -> None:
    names = [f"correction_{axis}" for axis in "XYZ"] + [f"plus_minus_{axis}" for axis in "XYZ"]
    units = ["mm"] * len(names)
    more = _SERIES - len(names)
    names, units = [*names, *(f"T_{k}" for k in range(more))], [*units, *["degC"] * more]
    connection = open_to_write(path)
    for number, (name, unit) in enumerate(zip(names, units, strict=True), start=1):
        connection.execute("INSERT INTO series VALUES (?, ?, ?)", (number, name, unit))
        connection.execute(
            "WITH RECURSIVE t(n) AS (SELECT 0 UNION ALL SELECT n + 1 FROM t WHERE n + 1 < ?) "
            "INSERT INTO full SELECT ?, n, 20.0 + 1e-3 * (n % 997) FROM t",
            (each, number),
        )
        connection.commit()
    connection.close()
