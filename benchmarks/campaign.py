"""Reading and writing a campaign file of a million rows: time and peak memory.

Beside Abbe's reader, in processes of their own and in turns: `numpy.loadtxt` of the number columns
alone, Python's `csv` with `float`, and `pandas.read_csv` where pandas is installed. None of the
others checks anything or knows a unit.

    python benchmarks/campaign.py [ROWS]
"""

from __future__ import annotations

import csv
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from statistics import median

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from abbe.compcore.files.campaign_file import bare_machine, read_campaign, write_campaign
from benchmarks.measuring.report import machine, write_section

ROWS = 1_000_000
TURNS = 3
HEADER = (
    "time,setup,kind,X,Y,Z,X_dir,Y_dir,Z_dir,tool_x,tool_y,tool_z,ux,uy,uz,value,sd,"
    "T_amb,T_x,T_y,T_z,T_col_front,T_col_rear,T_spindle"
)
NUMBERS = [i for i, name in enumerate(HEADER.split(",")) if name not in ("setup", "kind")]


def make(path: Path, rows: int) -> None:
    """Write a campaign file with as many digits as real ones have."""
    rng = np.random.default_rng(1)
    with path.open("w", encoding="utf-8") as out:
        out.write(f'# format = "abbe-campaign/1"\n{HEADER}\n')
        for first in range(0, rows, 10_000):
            n = min(10_000, rows - first)
            where = rng.uniform(0, 900, (n, 3))
            value, sd = rng.normal(0, 20, n), rng.uniform(0.5, 0.6, n)
            heat = rng.normal(20, 1, (n, 7))
            for i in range(n):
                k = first + i
                x, y, z = where[i]
                temperatures = ",".join(f"{t:.3f}" for t in heat[i])
                out.write(
                    f"{11.3 * k:.1f},c{k // 26 % 500}_x_pos,displacement,{x:.4f},{y:.4f},-{z:.4f},"
                    f"{1 - k % 2 * 2},0,0,0,0,-120,1.0,0.0,0.0,{value[i]:.4f},{sd[i]:.4f},"
                    f"{temperatures}\n"
                )


def abbe(path: Path) -> int:
    """Read with Abbe: checked, in units, ready to fit."""
    return read_campaign(path, bare_machine(path)).n


def loadtxt(path: Path) -> int:
    """Read the number columns alone with numpy."""
    return len(np.loadtxt(path, delimiter=",", skiprows=2, usecols=NUMBERS))


def csv_float(path: Path) -> int:
    """Read with Python's csv module, floats into numpy columns."""
    with path.open(newline="") as stream:
        rows = csv.reader(stream)
        next(rows), next(rows)
        columns = list(zip(*rows, strict=True))
    numbers = [np.array(list(map(float, columns[i]))) for i in NUMBERS]
    return len(numbers[0])


def pandas_read_csv(path: Path) -> int:
    """Read everything with pandas's C reader."""
    import pandas

    return len(pandas.read_csv(path, comment="#"))


READERS: dict[str, Callable[[Path], int]] = {
    "Abbe: read_campaign": abbe,
    "numpy.loadtxt (numbers only)": loadtxt,
    "csv + float (numbers only)": csv_float,
    "pandas.read_csv": pandas_read_csv,
}


def measure(name: str, path: Path) -> dict[str, float]:
    """Run one reader in this process."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.process_time()
    rows = READERS[name](path)
    seconds = time.process_time() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"seconds": seconds, "rows": rows, "megabytes": (peak - before) / 1024}


def apart(name: str, path: Path) -> dict[str, float]:
    """Run one reader in a process of its own."""
    command = [sys.executable, __file__, "--reader", name, str(path)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    answer: dict[str, float] = json.loads(done.stdout)
    return answer


def main(rows: int) -> None:
    """Measure everything and write the section."""
    names = [n for n in READERS if n != "pandas.read_csv" or find_spec("pandas")]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "campaign.csv"
        make(path, rows)
        size = path.stat().st_size / 1e6
        found: dict[str, list[dict[str, float]]] = {name: [] for name in names}
        for _ in range(TURNS):
            for name in names:
                found[name].append(apart(name, path))
        campaign = read_campaign(path, bare_machine(path))
        start = time.process_time()
        write_campaign(campaign, Path(folder) / "back.csv")
        writing = time.process_time() - start
    seconds = {name: min(run["seconds"] for run in runs) for name, runs in found.items()}
    memory = {name: median(run["megabytes"] for run in runs) for name, runs in found.items()}
    table = "\n".join(
        f"| {name} | {seconds[name]:.1f} | {seconds[name] / seconds[names[0]]:.1f} | "
        f"{memory[name]:.0f} |"
        for name in names
    )
    text = f"""## Campaign files

`benchmarks/campaign.py`: a campaign file of {rows:,} rows and 24 columns ({size:.0f} MB), each
reader in a process of its own, {TURNS} times in turns; least processor time, since other programs
share the machine. Abbe's reader also checks every cell, names the place of every fault, converts
units and hashes the file; the others do none of that. Memory is the growth of the process's peak
(median); the numbers alone are {rows * 22 * 8 / 2**20:.0f} MB.

| | CPU s | times Abbe's | MB |
| --- | --- | --- | --- |
{table}

Writing the campaign back (streamed, atomic): {writing:.1f} CPU s.

Pandas is faster still. It is not used: a reader that must name the cell, what stands there and what
should, would need a second one beside it, and two seconds a million rows are little beside the
days that it takes to measure them.

{machine()}."""
    write_section("campaign", text)
    print(text)


if __name__ == "__main__":
    if "--reader" in sys.argv:
        print(json.dumps(measure(sys.argv[2], Path(sys.argv[3]))))
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else ROWS)
