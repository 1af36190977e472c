"""Runs one bad input in a process of its own: forked, bounded, measured, and judged.

Abbe is imported once, before the fork, so that a case costs what its own work costs. Processor
time is counted, not the clock: a busy computer makes no case slow.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

CPU = 5.0
"""s of processor time that a bad input may cost, on a slow computer too; on a usual one under 1."""
MEMORY = 500_000_000
"""Bytes that the process may hold, Abbe itself included."""
_ABBE = 200_000_000
"""Bytes that Abbe itself is taken to hold: what the forked process shares with all other tests, as
many as pytest has collected, is no case's doing."""
_ADDRESSES = 700_000_000
"""Bytes of addresses beyond what the process had at the fork: a runaway ends in MemoryError."""
_CLOCK = 60.0
"""s after which a process that only waits is ended."""

Content = str | bytes | Callable[[Path], None]
"""Of a file; or what makes it, given its path."""


@dataclass(frozen=True)
class Case:
    """One bad input.

    Attributes
    ----------
    name
        Unique, for people.
    files
        Name → content; made in an empty folder, in which the case runs.
    run
        Arguments of ``abbe``, or a function that reads the files in the folder.
    says
        What the one line has to contain: the file, the line, the field, what was found, expected.
    may_succeed
        A mutation that may have hit a comment, or a digit that does not matter. It may then be
        read; if it is refused, all else holds.
    kept
        Names of outputs: made with `OLD` as content, and unchanged unless the case succeeds.
    cpu
        s of processor time that it may cost; more only where a good input costs more.
    """

    name: str
    files: Mapping[str, Content]
    run: tuple[str, ...] | Callable[[], object]
    says: tuple[str, ...] = ()
    may_succeed: bool = False
    kept: tuple[str, ...] = field(default=())
    cpu: float = CPU

    def __str__(self) -> str:
        return self.name


OLD = b"old content, not to be lost\n"


@dataclass(frozen=True)
class Outcome:
    """How a case ended; `cpu` in s, `memory` in bytes."""

    status: int
    out: str
    err: str
    cpu: float
    memory: int


def run(case: Case, folder: Path) -> Outcome:
    """Run a case in a folder, in a process of its own."""
    work = folder / "work"
    work.mkdir()
    for name, content in case.files.items():
        path = work / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if callable(content):
            content(path)
        else:
            path.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
    for name in case.kept:
        (work / name).write_bytes(OLD)
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if not child:
        _child(case, folder, work)
    status, usage = _waited(child)
    code = os.waitstatus_to_exitcode(status)
    return Outcome(
        code,
        (folder / "out").read_text(encoding="utf-8", errors="replace"),
        (folder / "err").read_text(encoding="utf-8", errors="replace"),
        usage.ru_utime + usage.ru_stime,
        max(0, usage.ru_maxrss * 1024 - _at_fork(folder)) + _ABBE,
    )


def _waited(child: int) -> tuple[int, resource.struct_rusage]:
    end = time.monotonic() + _CLOCK
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            return status, usage
        if time.monotonic() > end:
            os.kill(child, signal.SIGKILL)
            _, status, usage = os.wait4(child, 0)
            return status, usage
        time.sleep(0.002)


def _child(case: Case, folder: Path, work: Path) -> None:
    """The forked process; never returns."""
    code = 70
    try:
        for stream, name in ((1, "out"), (2, "err")):
            target = os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
            os.dup2(target, stream)
        sys.stdin = os.fdopen(os.open(os.devnull, os.O_RDONLY), encoding="utf-8")
        sys.stdout = os.fdopen(1, "w", encoding="utf-8", closefd=False)
        sys.stderr = os.fdopen(2, "w", encoding="utf-8", closefd=False)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.setitimer(signal.ITIMER_REAL, 0.0)  # what pytest-timeout set is not for this process
        resource.setrlimit(resource.RLIMIT_CPU, (int(5 * CPU), int(5 * CPU) + 1))
        (folder / "at_fork").write_text(str(_pages(1)), encoding="utf-8")
        limit = _pages(0) + _ADDRESSES
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.chdir(work)
        code = _status(case)
    except BaseException:  # noqa: BLE001 - told by its traceback, which no case may show
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _at_fork(folder: Path) -> int:
    """Bytes that the forked process had in memory before the case; fewer than its parent has."""
    return int((folder / "at_fork").read_text(encoding="utf-8"))


def _pages(column: int) -> int:
    """Bytes that this process has: of addresses (0), in memory (1)."""
    return int(Path("/proc/self/statm").read_text().split()[column]) * resource.getpagesize()


def _status(case: Case) -> int:
    from abbe.compcore.errors import AbbeError
    from abbe.daemon.cli import main
    from abbe.drivers.link import LinkError

    if callable(case.run):
        try:
            case.run()
        except (AbbeError, LinkError) as error:  # as `main` tells them
            sys.stderr.write(f"abbe: {error}\n")
            return 1
        except SystemExit as done:
            return done.code if isinstance(done.code, int) else int(done.code is not None)
        return 0
    sys.argv = ["abbe", *case.run]
    try:
        main()
    except SystemExit as done:
        if done.code is None:
            return 0
        return done.code if isinstance(done.code, int) else 1
    return 0


def faults(case: Case, outcome: Outcome, folder: Path) -> list[str]:
    """What is wrong with how a case ended; nothing, where it ended well."""
    found = []
    work = folder / "work"
    lines = outcome.err.splitlines()
    if "Traceback" in outcome.err or outcome.status not in (0, 1, 2):
        found.append(f"status {outcome.status}: {outcome.err[-1500:] or 'nothing said'}")
    elif outcome.status == 0:
        if not case.may_succeed:
            found.append(f"was taken: {outcome.out[:300]!r}")
    else:
        if outcome.status == 1 and (len(lines) != 1 or not lines[0].startswith("abbe: ")):
            found.append(f"not one line: {outcome.err[:600]!r}")
        if len(outcome.err) > 1500:
            found.append(f"a line of {len(outcome.err)} characters: {outcome.err[:300]!r}")
        found += [
            f"{word!r} is not in {outcome.err!r}" for word in case.says if word not in outcome.err
        ]
        for name in case.kept:
            if (work / name).read_bytes() != OLD:
                found.append(f"{name} was changed")
        made = {str(p.relative_to(work)) for p in work.rglob("*") if p.is_file()}
        if more := made - set(case.files) - set(case.kept):
            found.append(f"left behind: {sorted(more)}")
    if outcome.cpu > case.cpu:
        found.append(f"took {outcome.cpu:.1f} s")
    if outcome.memory > MEMORY:
        found.append(f"took {outcome.memory / 1e6:.0f} MB")
    return found
