"""The command that reads a file which was given to another one: whole, as it can be typed.

What it needs besides is taken from what was typed, and from a model that lies beside the file. What
nobody has said is filled in so that the command runs, and named, to be put right.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.files.recognised import CAMPAIGN, MAP, MODEL, FileKind, misplaced, recognised
from abbe.daemon.answers.typed import free_name, next_version

_LOOKED_AT = 100
"""Files beside the one that are looked at for a model or a map."""
_ENDINGS = (".toml", ".txt")
_TOP = 1 << 16
"""Bytes of the file that are looked at."""
_STRUCTURE = "w b Y X Z t"
_TRAVELS = ("--travel", "X=0,500", "--travel", "Y=0,500", "--travel", "Z=-300,0")


def in_words(error: InputError, words: Sequence[str]) -> str | None:
    """Which command reads a file that was refused; None where it was the right one.

    Parameters
    ----------
    error
        Why it was refused.
    words
        What was typed: the command that refused it, and its arguments.
    """
    kind = misplaced(error, words)
    if kind is None or error.file is None:
        return None
    said = _READERS[kind.reader](_Typed(Path(error.file), kind, words))
    # a name with a line end in it would make two lines of one
    return f"this is {kind.name}" + (f": {said}" if said.isprintable() else "")


@dataclass(frozen=True)
class _Typed:
    """The file, what it is, and what was typed."""

    file: Path
    kind: FileKind
    words: Sequence[str]

    def option(self, name: str) -> str | None:
        """What an option was given; None where it was not."""
        for word, following in zip(self.words, [*self.words[1:], ""], strict=True):
            if word == name and following:
                return following
            if word.startswith(f"{name}="):
                return word.removeprefix(f"{name}=")
        return None

    def other(self, *kinds: FileKind) -> Path | None:
        """Another file of some kind: typed, or the only one beside this one."""
        for word in self.words[1:]:
            if not _same(Path(word), self.file) and recognised(word) in kinds:
                return Path(word)
        beside = [p for p in _beside(self.file) if recognised(p) in kinds]
        return beside[0] if len(beside) == 1 else None

    @property
    def model(self) -> Path | None:
        """A model to go with it."""
        return self.other(MODEL)

    @property
    def structure(self) -> tuple[str, bool]:
        """The machine's structure, and whether anybody has said it."""
        if (typed := self.option("--structure")) is not None:
            return typed, True
        if (model := self.model) is not None:
            from abbe.compcore.files.model_file import load_model

            try:
                return str(load_model(model).machine.structure), True
            except InputError:
                pass
        return _STRUCTURE, False

    def states(self, key: str) -> bool:
        """Whether a line at the file's top states something, as ``# plane = XY``."""
        try:
            with self.file.open("rb") as stream:
                top = stream.read(_TOP)
        except OSError:
            return False
        return re.search(rb"^#\s*%s\s*=" % key.encode(), top, re.MULTILINE) is not None

    def out(self, ending: str) -> Path:
        """A free name beside the file."""
        return free_name(self.file.with_name(self.file.stem + ending))


def _same(one: Path, other: Path) -> bool:
    return one == other or one.absolute() == other.absolute()


def _beside(file: Path) -> Iterator[Path]:
    """Some files in the folder of one, itself left out."""
    try:
        entries = sorted(p for p in file.absolute().parent.iterdir() if p.suffix in _ENDINGS)
    except OSError:
        return
    for entry in entries[:_LOOKED_AT]:
        if not _same(entry, file):
            yield file.with_name(entry.name)


def _command(*words: str | Path, own: str = "") -> str:
    """A command, and what of it nobody has said."""
    typed = shlex.join(["abbe", *map(str, words)])
    return f"{typed} (with {own} as it is at your machine)" if own else typed


def _campaign(typed: _Typed) -> str:
    if (model := typed.model) is not None:
        return _command("compare", model, typed.file)
    return f"{_command('iso230', typed.file)}; fit, compare and diagnose take it beside a model"


def _model(typed: _Typed) -> str:
    if (campaign := typed.other(CAMPAIGN)) is not None:
        return _command("compare", typed.file, campaign)
    return _command("history", typed.file)


def _config(typed: _Typed) -> str:
    return _command("check", typed.file)


def _points(typed: _Typed) -> str:
    if (compensation := typed.other(MAP)) is None:
        return "abbe identify-convention reads it, beside a map or a fitted model"
    return _command("identify-convention", compensation, typed.file)


def _map(typed: _Typed) -> str:
    code, said = typed.structure
    words = ("import-map", typed.file, "--structure", code, "-o", typed.out(".toml"))
    return _command(*words, own="" if said else "--structure")


def _table(typed: _Typed) -> str:
    words: tuple[str | Path, ...] = (
        "import-grid", typed.file, "--controller", typed.kind.dialect
    )  # fmt: skip
    if (model := typed.model) is not None:
        return _command(*words, "--onto", model, "-o", next_version(model))
    code, said = typed.structure
    words = (*words, "--structure", code, *_TRAVELS, "-o", typed.out(".toml"))
    return _command(*words, own="--travel" if said else "--structure and --travel")


def _readings(**guesses: str) -> Callable[[_Typed], str]:
    """What ``import-campaign`` reads, with options that say what neither file nor person did."""

    def answered(typed: _Typed) -> str:
        words: list[str | Path] = ["import-campaign", typed.file, "--as", typed.kind.dialect]
        guessed = []
        for key, guess in guesses.items():
            if not typed.states(key):
                said = typed.option(f"--{key}")
                words += [f"--{key}", said or guess]
                guessed += [] if said else [f"--{key}"]
        own = " and ".join(guessed)
        return _command(*words, "-o", typed.out("-campaign.csv"), own=own)

    return answered


def _gauges(typed: _Typed) -> str:
    return _command("gauges", typed.file)


def _rtest(typed: _Typed) -> str:
    if (model := typed.model) is None:
        return "abbe iso10791 reads it, beside a model of the machine (abbe new makes one)"
    return _command("iso10791", model, typed.file)


def _part(typed: _Typed) -> str:
    return _command("uncertainty", typed.model or "MODEL.toml", typed.file)


_READERS: dict[str, Callable[[_Typed], str]] = {
    "part": _part,
    "campaign": _campaign,
    "model": _model,
    "config": _config,
    "points": _points,
    "map": _map,
    "grid": _table,
    "table": _table,
    "rtl": _readings(),
    "runs": _readings(axis="X"),
    "ballbar": _readings(plane="XY", centre="0,0", radius="100"),
    "lengths": _gauges,
    "plate": _gauges,
    "rtest": _rtest,
}
"""Reader (`FileKind.reader`) → its command."""
