"""A small machine, its campaign and what the commands read and write, for the tests of files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

MODEL = """\
format = "abbe-model/1"
[machine]
structure = "w b Y X Z t"
[machine.axes]
X.travel = [0.0, 500.0]
Y.travel = [0.0, 500.0]
Z.travel = [-300.0, 0.0]
[[effects]]
kind = "positioning"
axis = "X"
shape = "polynomial:2"
"""
FITTED = (
    MODEL
    + """\
[effects.parameters]
c0 = { value = 0.0 }
c1 = { value = 1e-3 }
c2 = { value = 1e-4 }
"""
)
HEAD = '# format = "abbe-campaign/1"\n'
COLUMNS = "time,setup,kind,X,Y,Z,X_dir,ux,uy,uz,value\n"
ROWS = "".join(
    f"{60 * run + i},x{run},displacement,{50 * i},250,-100,{1 - 2 * (run % 2)},1,0,0,"
    f"{0.4 * i + 0.01 * i * i + 0.07 * run + 0.03 * (i * (run + 3) % 5)}\n"
    for run in range(4)
    for i in (range(11) if run % 2 == 0 else reversed(range(11)))
)
OTHER_ROWS = "".join(
    f"{60 * run + i},other{run},displacement,{50 * i + 20},250,-100,{1 - 2 * (run % 2)},1,0,0,"
    f"{0.4 * i + 0.01 * i * i + 0.05 * run}\n"
    for run in range(2)
    for i in range(11)
)
"""Lines that nothing is fitted to."""
POINTS = "X,Y,Z\n1,2,-3\n"
MAP = "".join(
    f"{a} Axis\nPosition Lx Ly Lz Rx Ry Rz\n0 0 0 0 0 0 0\n100 0.001 0 0 0 0 0\n" for a in "XYZ"
)
GRID = (
    '# sign = "error"\n'
    + ",".join(
        ["X [mm]", "Y [mm]", "Z [mm]"]
        + [f"d{c} [{'mm' if c in 'XYZ' else 'deg'}]" for c in "XYZABC"]
    )
    + "".join(f"\n{x},{y},{z},0,0,0,0,0,0" for x in (0, 9) for y in (0, 9) for z in (-9, 0))
    + "\n"
)
ISO = "target,1,1\n0,0.0,0.5\n100,1.0,1.5\n200,2.0,2.5\n"


@dataclass(frozen=True)
class Task:
    """A command line with one output, and what it reads.

    Attributes
    ----------
    line
        Words; `OUT` stands for the output.
    reads
        Names of files that it reads.
    kind
        Content that it may overwrite.
    """

    line: str
    reads: tuple[str, ...]
    kind: str

    def words(self, folder: Path, out: str | Path) -> list[str]:
        """The command line with its paths."""
        names = set(self.reads) | {"model.toml", "fitted.toml"}
        return [
            str(out) if word == "OUT" else str(folder / word) if word in names else word
            for word in self.line.split()
        ]


_REPORT = '<meta name="generator" content="Abbe 0.1.0">'
TASKS = {
    "fit": Task("fit model.toml day.csv -o OUT", ("model.toml", "day.csv"), MODEL),
    "fit report": Task(
        "fit model.toml day.csv -o next.toml --report OUT", ("model.toml", "day.csv"), _REPORT
    ),
    "fit active": Task(
        "fit model.toml day.csv --active fitted.toml -o OUT", ("fitted.toml", "day.csv"), MODEL
    ),
    "add": Task(
        "add model.toml straightness axis=X direction=Y shape=polynomial:2 --campaign day.csv "
        "--holdout other.csv -o OUT",
        ("model.toml", "day.csv", "other.csv"),
        MODEL,
    ),
    "remove": Task(
        "remove fitted.toml positioning axis=X shape=polynomial:2 -o OUT", ("fitted.toml",), MODEL
    ),
    "remove refit": Task(
        "remove two.toml straightness axis=X direction=Y shape=polynomial:2 --campaign day.csv "
        "-o OUT",
        ("two.toml", "day.csv"),
        MODEL,
    ),
    "compare": Task(
        "compare fitted.toml day.csv --report OUT", ("fitted.toml", "day.csv"), _REPORT
    ),
    "diagnose": Task(
        "diagnose fitted.toml day.csv --report OUT", ("fitted.toml", "day.csv"), _REPORT
    ),
    "history": Task("history fitted.toml --report OUT", ("fitted.toml",), _REPORT),
    "iso230": Task("iso230 day.csv --report OUT", ("day.csv",), _REPORT),
    "correct": Task(
        "correct fitted.toml --points points.csv -o OUT",
        ("fitted.toml", "points.csv"),
        "X,Y,Z,X_corrected,Y_corrected,Z_corrected\n",
    ),
    "correct report": Task(
        "correct fitted.toml X=1 Y=2 Z=-3 --report OUT", ("fitted.toml",), _REPORT
    ),
    "import-campaign": Task(
        "import-campaign map.txt --as map --structure w_b_Y_X_Z_t -o OUT", ("map.txt",), HEAD
    ),
    "import-grid": Task(
        "import-grid grid.csv --controller grid-csv --structure w_b_Y_X_Z_t -o OUT",
        ("grid.csv",),
        MODEL,
    ),
    "import-map": Task("import-map map.txt --structure w_b_Y_X_Z_t -o OUT", ("map.txt",), MODEL),
}
"""Every command with an output file; the structure's blanks are put back by `line_of`."""


def line_of(name: str) -> Callable[[Path, str | Path], list[str]]:
    """The command line of a task, given the folder and the output."""

    def made(folder: Path, out: str | Path) -> list[str]:
        words = TASKS[name].words(folder, out)
        names = ("next.toml",)
        words = [str(folder / w) if w in names else w for w in words]
        return [w.replace("w_b_Y_X_Z_t", "w b Y X Z t") for w in words]

    return made


def furnish(folder: Path) -> None:
    """Write everything that the tasks read."""
    two = (
        FITTED
        + '[[effects]]\nkind = "straightness"\naxis = "X"\ndirection = "Y"\n'
        + 'shape = "polynomial:2"\n'
    )
    for name, text in {
        "model.toml": MODEL,
        "fitted.toml": FITTED,
        "two.toml": two,
        "day.csv": HEAD + COLUMNS + ROWS,
        "other.csv": HEAD + COLUMNS + OTHER_ROWS,
        "points.csv": POINTS,
        "map.txt": MAP,
        "grid.csv": GRID,
        "notes.txt": "my notes\n",
    }.items():
        (folder / name).write_text(text, encoding="utf-8")
