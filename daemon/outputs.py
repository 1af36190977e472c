"""Inputs and outputs of a command, checked against each other before anything is computed.

No command writes onto a file that it reads, nor two outputs onto one, nor over a file that is not
of the kind that it writes (``--force`` for the last only). ``docs/files.md`` is its page.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import typer

from abbe.compcore.errors import InputError
from abbe.compcore.files import formats
from abbe.compcore.files.text.write_target import WriteTarget

Say = Callable[[str], None]
"""Tells the user a line."""

_NEW_NAME = "a new name; --force overwrites it"
_LOOKED_AT = 1 << 16
"""Bytes from which a file's kind is recognised."""
_SHOWN = 40
"""Characters of a foreign file that a message shows."""


@dataclass(frozen=True)
class OutputKind:
    """A kind of file that Abbe writes.

    Attributes
    ----------
    title
        For people.
    beginning
        Is found in the first 64 kB of every such file, and of no other.
    """

    title: str
    beginning: re.Pattern[bytes]

    def holds(self, start: bytes) -> bool:
        """Whether a file that begins so is of this kind; an empty one holds nothing to lose."""
        return not start.strip() or self.beginning.search(start) is not None


def _key(name: str, behind: str = "") -> re.Pattern[bytes]:
    """A line ``format = "name"`` of TOML."""
    text = rf"^{behind}\s*format\s*=\s*[\"']{re.escape(name)}[\"']"
    return re.compile(text.encode(), re.MULTILINE)


MODEL = OutputKind("a model of Abbe", _key(formats.MODEL))
CAMPAIGN = OutputKind("a campaign of Abbe", _key(formats.CAMPAIGN, '"?#'))
PLAN = OutputKind("a plan of Abbe", _key(formats.PLAN))
PROGRAM = OutputKind("a program of Abbe", re.compile(rb"made by abbe program", re.IGNORECASE))
TARGETS = OutputKind("a list of targets of Abbe", re.compile(rb"\Anumber,setup,[A-Z]"))
CORRECTED = OutputKind("points that Abbe corrected", re.compile(rb"^[^#\n]*\bX_corrected\b", re.M))
ERROR_MAP = OutputKind("an error map of Abbe", re.compile(rb"\A[^#\n]*\berror_X_um\b"))
REPORT = OutputKind("a report of Abbe", re.compile(rb'<meta name="generator" content="Abbe '))
JOURNAL = OutputKind(
    "a journal of abbe run",
    re.compile(rb"\A\0*\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} [A-Z]{4,8} "),
)
UPLOADS = OutputKind(
    "a journal of uploads",
    re.compile(rb'\A(?:\{"format": "abbe-uploads/1"|\{[^\n]{0,25}(?:\n\{"format"|\Z)|\0)'),
)
RECORDS_CSV = OutputKind(
    "records that Abbe exported", re.compile(rb"\Atime,series,unit,least,mean,greatest\n")
)
RECORDS_PARQUET = OutputKind("a Parquet file", re.compile(rb"\APAR1"))
RECORD = OutputKind(
    "a record of Abbe's tables", re.compile(rb'"format":\s*"' + formats.TABLES.encode() + b'"')
)


def check_outputs(
    reads: Iterable[Path | None],
    writes: Iterable[tuple[Path | None, OutputKind]],
    *,
    force: bool,
    as_json: bool = False,
    way_out: str = _NEW_NAME,
) -> Say:
    """Refuse outputs that would destroy something.

    Parameters
    ----------
    reads
        Every file that the command reads; None: not given.
    writes
        Every file that it will write, and of which kind; None: not given.
    force
        Also over a file of another kind, never over an input.
    as_json
        Whether the answer on standard output is JSON.
    way_out
        What the message says can be done about a file of another kind.

    Returns
    -------
    How to tell the user something: on standard output, or on standard error when an output goes to
    standard output.

    Raises
    ------
    InputError
        Naming the output, what is there, and what to do instead.
    """
    wanted = [(path, kind) for path, kind in writes if path is not None]
    taken = dict(_inputs(reads))
    streams: dict[int, Path] = {}
    to_stdout = False
    for path, kind in wanted:
        target = WriteTarget.of(path)
        target.require_writable(path)
        if target.descriptor is not None:
            _refuse_second(path, streams.get(target.descriptor))
            streams[target.descriptor] = path
            to_stdout |= target.descriptor == 1
            continue
        identity = target.identity
        if identity is None:
            continue
        before = taken.get(identity)
        if before is not None and before.read:
            raise InputError(
                "this command reads that file and must not write over it",
                file=path,
                found=before.name,
                expected="another name for the output",
            )
        _refuse_second(path, None if before is None else Path(before.name))
        taken[identity] = _Taken(str(path), read=False)
        require_kind(path, target, kind, force=force, way_out=way_out)
    if to_stdout and as_json:
        raise InputError(
            "standard output cannot take both that file and the JSON answer",
            file=next(p for d, p in streams.items() if d == 1),
            expected="the name of a file, or no --json",
        )
    return partial(typer.echo, err=True) if to_stdout else typer.echo


def check_folder(
    folder: Path,
    reads: Iterable[Path | None],
    beside: Iterable[tuple[Path | None, OutputKind]],
    files: Mapping[str, str],
    *,
    force: bool,
    as_json: bool = False,
) -> Say:
    """Refuse to write a set of tables over anything but an earlier set of its own.

    Parameters
    ----------
    folder
        Where they go.
    reads, beside, force, as_json
        As `check_outputs` takes them; `beside` is what is written besides the folder.
    files
        Name → text of what will be written beside the record, as far as it is known.

    Returns
    -------
    As `check_outputs`.

    Raises
    ------
    InputError
        For a file that Abbe's record in the folder does not list, or that was changed since, unless
        `force`; for an input always.
    """
    if not folder.exists():
        return check_outputs(reads, beside, force=force, as_json=as_json)
    if not folder.is_dir():
        raise InputError("is not a folder", file=folder, expected="a folder, or a new name")
    from abbe.compcore.files.table_set import RECORD_NAME, TableSet

    record = folder / RECORD_NAME
    tables = [(folder / name, _ANYTHING) for name in files]
    say = check_outputs(reads, [*beside, *tables, (record, RECORD)], force=force, as_json=as_json)
    if not force:
        mine = TableSet.checksums_in(folder) if record.exists() else {}
        for name, text in files.items():
            _require_own(folder / name, text, mine.get(name))
    return say


def _require_own(path: Path, text: str, made: str | None) -> None:
    """Whether what is there is a table of the record, as it was made or as it will be."""
    from abbe.compcore.files.table_set import sha256

    status = WriteTarget.of(path).status
    if status is None or not status.st_size:
        return
    if made is None:
        raise InputError(
            "is there already, and no record of Abbe's tables in its folder lists it",
            file=path,
            found=_shown(path),
            expected="another folder; --force overwrites it",
        )
    present = sha256(path.read_bytes())
    if present not in (made, sha256(text)):
        raise InputError(
            "was changed since Abbe made it",
            file=path,
            found=f"SHA-256 {present[:12]}",
            expected=f"{made[:12]}, or another folder; --force overwrites it",
        )


_ANYTHING = OutputKind("a table", re.compile(b""))


@dataclass(frozen=True)
class _Taken:
    """A file that is spoken for."""

    name: str
    read: bool


def _inputs(reads: Iterable[Path | None]) -> Iterator[tuple[tuple[object, ...], _Taken]]:
    """What must not be written, by identity: inputs, and where our own output goes already."""
    for descriptor, name in ((1, "standard output"), (2, "standard error")):
        identity = WriteTarget.of(f"/dev/fd/{descriptor}").identity
        if identity is not None:
            yield identity, _Taken(name, read=False)
    for path in reads:
        for file in () if path is None else _files_of(path):
            identity = WriteTarget.of(file).identity
            if identity is not None:
                yield identity, _Taken(str(file), read=True)


def _files_of(path: Path) -> list[Path]:
    return [p for p in sorted(path.iterdir()) if p.is_file()] if path.is_dir() else [path]


def _refuse_second(path: Path, before: Path | None) -> None:
    if before is not None:
        raise InputError(
            "two outputs would go to one place",
            file=path,
            found=str(before),
            expected="a name of its own for each",
        )


def require_kind(
    path: Path,
    target: WriteTarget,
    kind: OutputKind,
    *,
    force: bool,
    way_out: str = _NEW_NAME,
) -> None:
    """Refuse a file that is there and of another kind.

    Parameters
    ----------
    path, target
        The file as the user named it, and where that leads to.
    kind
        What will be written.
    force
        Refuse nothing.
    way_out
        What the message says can be done.

    Raises
    ------
    InputError
        Says how the file begins.
    """
    if force or not target.regular:
        return
    try:
        with target.path.open("rb") as stream:
            start = stream.read(_LOOKED_AT)
    except OSError as error:
        raise InputError(f"cannot be looked at: {error.strerror}", file=path) from None
    if not kind.holds(start):
        raise InputError(
            "is there already and is something else than what would be written",
            file=path,
            found=_words(start),
            expected=f"{kind.title}, or {way_out}",
        )


def _shown(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            return _words(stream.read(_LOOKED_AT))
    except OSError as error:
        return str(error.strerror)


def _words(start: bytes) -> str:
    """The beginning of a file for people."""
    line = start.lstrip().split(b"\n", 1)[0][:_SHOWN].decode("utf-8", "replace").strip()
    return line if line.isprintable() else f"{len(start)} bytes or more that are no text"
