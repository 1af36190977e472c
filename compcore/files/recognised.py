"""Recognition of a file by how it begins, and the commands that read it.

For the message about a file that was given to another command: it names the right one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.encodings import decoded

_BEGINNING = 1 << 16
"""Bytes that are looked at."""


@dataclass(frozen=True)
class FileKind:
    """A kind of file.

    Attributes
    ----------
    name
        With its article: ``a campaign``.
    reader
        Which of Abbe's readers it is for.
    commands
        The commands that take it.
    dialect
        Of a controller's table: whose; of what ``import-campaign`` reads: the value of `--as`.
    """

    name: str
    reader: str
    commands: frozenset[str]
    dialect: str = ""


def _kind(name: str, reader: str, commands: str, dialect: str = "") -> FileKind:
    return FileKind(name, reader, frozenset(commands.split()), dialect)


CAMPAIGN = _kind("a campaign", "campaign", "fit compare diagnose add iso230 new verify")
MODEL = _kind(
    "a model",
    "model",
    "fit compare diagnose add remove correct table history import-grid plan program verify",
)
CONFIG = _kind("a configuration", "config", "run check upload demo verify")
POINTS = _kind("a list of points with the correction on and off", "points", "identify-convention")
MAP = _kind("a compensation map", "map", "import-map identify-convention import-campaign")
PART = _kind("a part program", "part", "uncertainty")
GRID = _kind("a spatial grid of errors", "grid", "import-grid table upload", "grid-csv")
TABLE = _kind("a compensation table", "table", "import-grid table upload", "csv")
RTL = _kind("a Renishaw laser measurement", "rtl", "import-campaign", "rtl")
RUNS = _kind("a table of runs and directions (ISO 230-2)", "runs", "import-campaign", "iso230-2")
BALLBAR = _kind("a circular test", "ballbar", "import-campaign", "ballbar")
LENGTHS = _kind("a table of measured lengths", "lengths", "iso10360 gauges import-campaign")
PLATE = _kind("a measured plate", "plate", "gauges import-campaign")
RTEST = _kind("a test of rotary axes", "rtest", "iso10791 import-campaign")

_FORMATS = {
    "abbe-campaign/": CAMPAIGN,
    "abbe-model/": MODEL,
    "abbe-config/": CONFIG,
    "abbe-points/": POINTS,
    "abbe-grid/": GRID,
    "abbe-part/": PART,
    "abbe-table/": TABLE,
}
_FORMAT = re.compile(r"^(?:\"?#\s*)?format\s*=\s*\"{1,2}([a-z-]+/)", re.MULTILINE)


def _controllers(name: str) -> FileKind:
    """A controller's own table, by the name of its dialect."""
    return _kind(f"a compensation table ({name})", "table", "import-grid table upload", name)


_LOOKS = (
    (re.compile(r"\ABEGIN \w+\.com\b", re.IGNORECASE), _controllers("heidenhain-tnc")),
    (re.compile(r"^\$A[AN]_(?:ENC_COMP|CEC)\b", re.MULTILINE), _controllers("siemens-840d")),
    (re.compile(r"^DEFINE COMP ", re.MULTILINE), _controllers("pmac")),
    (re.compile(r"\A%\s*\nN0?3620", re.MULTILINE), _controllers("fanuc")),
    (re.compile(r"^:START2D ", re.MULTILINE), _controllers("aerotech-2d")),
    (re.compile(r"^TARGET DATA::\s*$", re.MULTILINE), RTL),
    (re.compile(r"\A\s*\S+ Axis\s*\n\s*Position\s+Lx", re.IGNORECASE), MAP),
    (re.compile(r"^X_off\s*,", re.MULTILINE), POINTS),
    (re.compile(r"^(?=[^\n]*[,;\t]\s*cx\b)(?=[^\n]*[,;\t]\s*cy\b)", re.M | re.I), PLATE),
    (re.compile(r"^(?=[^\n]*\b(?:calibrated|nominal|reference|length)\b[^\n,;\t]*[,;\t])"
                r"(?=[^\n]*[,;\t]\s*(?:measured|indicated|error|x1|run ?1|1)\b)",
                re.M | re.IGNORECASE), LENGTHS),
    (re.compile(r"^(?=[^\n]*\b[ABC][0-9]?\b)"
                r"[^\n]*[,;\t]\s*(?:d[XYZ]|radial|tangential|axial)\b", re.M | re.I), RTEST),
    (re.compile(r"^angle[^\n]*?[,;\t]\s*(?:ccw|cw|deviation|dir)", re.M | re.IGNORECASE), BALLBAR),
    (re.compile(r"^(?:position|target)[^\n]*?[,;\t](?:[^\n]*\b(?:run|dir|deviation)|\s*1\s*[+↑])",
                re.M | re.IGNORECASE), RUNS),
    (re.compile(r"^run\s*[,;\t]\s*dir", re.M | re.IGNORECASE), RUNS),
)  # fmt: skip


def recognised(path: str | Path) -> FileKind | None:
    """The kind of a file; None for one that is not known, or cannot be read."""
    try:
        # a pipe or a terminal would be waited for, and what is read from it be lost
        if not Path(path).is_file():
            return None
        with Path(path).open("rb") as stream:
            beginning = decoded(stream.read(_BEGINNING))
    except (OSError, ValueError):
        return None
    if (found := _FORMAT.search(beginning)) is not None:
        return _FORMATS.get(found[1])
    return next((kind for look, kind in _LOOKS if look.search(beginning)), None)


_LAYOUTS = {"rtl": "rtl", "iso230-2": "runs", "ballbar": "ballbar", "map": "map",
            "lengths": "lengths", "plate": "plate", "rtest": "rtest"}  # fmt: skip
"""What ``import-campaign --as`` is given → reader."""


def misplaced(error: InputError, words: Sequence[str]) -> FileKind | None:
    """The kind of a file that was refused because another command reads it; else None.

    Parameters
    ----------
    error
        Why it was refused.
    words
        What was typed: the command that refused it, and its arguments.
    """
    command = words[0] if words else ""
    if error.file is None or (kind := recognised(error.file)) is None:
        return None
    stated = [_LAYOUTS.get(word.removeprefix("--as=")) for word in words]
    layout = next((name for name in stated if name), None) if command == "import-campaign" else None
    reader = layout or _reader_of(error, kind)
    if kind.reader == reader or (reader is None and command in kind.commands):
        return None
    return kind


def _reader_of(error: InputError, kind: FileKind) -> str | None:
    """Which reader refused a file, as far as its message tells."""
    if error.field == "format":
        expected = error.expected or ""
        return next((k.reader for f, k in _FORMATS.items() if f in expected), None)
    problem = error.problem
    if problem.startswith("not valid TOML"):
        return None if _commented(error) or kind.reader == "part" else "model"
    for beginning, reader in (
        ("no axis yet", "map"),
        ("no targets", "rtl"),
        ("no deviations", "rtl"),
        ("not a circular test", "ballbar"),
        ("not a table of measured lengths", "lengths"),
        ("not a measured plate", "plate"),
        ("not a test of rotary axes", "rtest"),
        ("not a table of runs", "runs"),
        ("not a campaign file", "campaign"),
    ):
        if problem.startswith(beginning):
            return reader
    return None


def _commented(error: InputError) -> bool:
    """Whether a line of TOML is one of those that stand behind ``#`` in other files."""
    try:
        with Path(error.file or "").open("rb") as stream:
            lines = stream.read(_BEGINNING * 64).splitlines()
    except OSError:
        return False
    at = (error.line or 0) - 1
    return 0 <= at < len(lines) and lines[at].lstrip(b'"').startswith(b"#")
