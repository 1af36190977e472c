"""Arguments of the commands that make tables: conditions, options, present tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.files.table_set import RECORD_NAME, TableSet
from abbe.compcore.files.text.bounded_text import read_bounded
from abbe.compcore.machine.plausible import signal_range
from abbe.compcore.model.model import Model
from abbe.daemon.arguments.assignments import number, split_assignments

MOST_BYTES = 16_000_000
"""Of a controller's present tables, all files together; reading needs some twenty times this."""
_EXPECTED = f"a controller's tables, {MOST_BYTES / 1e6:g} MB at most in all"
REFERENCE = "reference"
"""``--at reference``: every temperature at the machine's reference temperature."""


def signals(arguments: Sequence[str], model: Model) -> dict[str, float]:
    """``["T_x=21.3,T_y=21.5", "reference"]`` → signals in their own units.

    Raises
    ------
    InputError
        For what cannot be read, or a signal given twice.
    """
    found: dict[str, float] = {}
    machine = model.machine
    words = [word.strip() for argument in arguments for word in argument.split(",")]
    if REFERENCE in words:
        for name in model.signals_needed():
            if name in machine.signals and machine.signals[name].temperature:
                found[name] = machine.reference_temperature
    given = split_assignments(word for word in words if word != REFERENCE)
    for name, text in given.items():
        signal = machine.signals.get(name)
        unit = signal.unit if signal else "its own unit"
        found[name] = number(name, text, unit, signal_range(signal))
    return found


def present_files(path: Path, controller: str) -> dict[str, str]:
    """The files of the tables that a controller holds already: name → text.

    Parameters
    ----------
    path
        A folder that `abbe table` wrote, a folder with the controller's files, or one file.
    controller
        The dialect that they must be in.

    Raises
    ------
    InputError
        When they cannot be read, or are another controller's.
    """
    if path.is_dir():
        if (path / RECORD_NAME).exists():
            made = TableSet.load(path)
            if made.controller != controller:
                raise InputError(
                    "these tables are for another controller",
                    file=path,
                    found=made.controller,
                    expected=controller,
                )
            return dict(made.files)
        return _whole_folder(path)
    return {path.name: read_bounded(path, MOST_BYTES, expected=_EXPECTED, foreign=True)}


def _whole_folder(path: Path) -> dict[str, str]:
    """All files of a folder, together no more than one may be."""
    try:
        names = sorted(p for p in path.iterdir() if p.is_file() and not p.name.startswith("."))
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from None
    if not names:
        raise InputError("no files in this folder", file=path)
    found: dict[str, str] = {}
    left = MOST_BYTES
    for name in names:
        found[name.name] = read_bounded(name, left, expected=_EXPECTED, foreign=True)
        left -= len(found[name.name])
    return found


def options(arguments: Sequence[str]) -> Mapping[str, str]:
    """``["type=1", "joints=X:0,Y:1"]`` → a controller's options as texts; may raise InputError."""
    return split_assignments(arguments)
