"""The package's own environment: Abbe and all that it needs, on Debian's own Python."""

from __future__ import annotations

import csv
import io
import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tools.deb.layout import COMMAND, ENVIRONMENT, link, under, write

_FOLDERS = ("abbe", "compcore", "drivers", "daemon")
_FILES = ("pyproject.toml", "README.md", "LICENSE")
_COMMAND = """\
#!{environment}/bin/python3
import sys

from abbe.daemon.cli import main

sys.exit(main())
"""
_ABOUT = "import json, sys; print(json.dumps([sys.version_info[:3], sys.executable]))"


class BuildError(Exception):
    """The package cannot be built here; says what is missing."""


@dataclass(frozen=True)
class Interpreter:
    """The Python that the package will run on.

    Attributes
    ----------
    path
        As the package manager installed it, without links.
    version
        Three numbers.
    """

    path: Path
    version: tuple[int, int, int]

    @property
    def short(self) -> str:
        """``3.11``"""
        return f"{self.version[0]}.{self.version[1]}"

    @classmethod
    def of(cls, path: Path) -> Interpreter:
        """The interpreter behind a path.

        Raises
        ------
        BuildError
            When there is none, or it is not the one of a Debian package: that is what the
            package will depend on.
        """
        real = path.resolve()
        if not real.is_file():
            raise BuildError(f"{path} is not there: apt install python3")
        version, _ = json.loads(run(real, "-I", "-c", _ABOUT))
        package = f"python{version[0]}.{version[1]}"
        found = subprocess.run(
            ["dpkg-query", "-S", str(real)], capture_output=True, text=True, check=False
        )
        if package not in found.stdout:
            raise BuildError(
                f"{real} does not belong to a Debian package: the .deb would depend on a Python "
                "that apt cannot install; give Debian's with --python /usr/bin/python3"
            )
        return cls(real, (version[0], version[1], version[2]))


def run(*command: str | Path, cwd: Path | None = None) -> str:
    """A command's output.

    Raises
    ------
    BuildError
        When it fails: with what it said.
    """
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise BuildError(f"{' '.join(map(str, command[:6]))} … failed:\n{done.stderr}{done.stdout}")
    return done.stdout


def make_environment(
    root: Path, source: Path, interpreter: Interpreter, extras: Sequence[str], work: Path
) -> Path:
    """Install Abbe and what it needs below `root`; returns the folder of its packages.

    Parameters
    ----------
    root
        Where the package's files are gathered.
    source
        The checkout.
    interpreter
        That it will run on.
    extras
        Optional parts, as in ``pip install 'abbe[can]'``.
    work
        For what is only needed meanwhile.
    """
    place = under(root, ENVIRONMENT)
    run(interpreter.path, "-m", "venv", "--without-pip", "--symlinks", place)
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check")
    tested = work / "tested.txt"
    tested.write_text(_tested(run(*pip, "freeze", "--exclude-editable")))
    wanted = f"{_clean_copy(source, work)}[{','.join(extras)}]"
    run(
        *pip, "--python", place / "bin" / "python3", "install", "--quiet", "--no-compile",
        "--no-warn-script-location", "--constraint", tested, wanted,
    )  # fmt: skip
    _leave_only_python(root, interpreter)
    write(
        root,
        ENVIRONMENT / "bin" / "abbe",
        _COMMAND.format(environment=ENVIRONMENT),
        executable=True,
    )
    link(root, COMMAND, ENVIRONMENT / "bin" / "abbe")
    for waste in ("include", "share"):  # headers; extensions of notebooks
        shutil.rmtree(place / waste, ignore_errors=True)
    packages = place / "lib" / f"python{interpreter.short}" / "site-packages"
    for info in packages.glob("*.dist-info"):
        _forget_the_build(info)
    # before it is installed, as root does not write there when it runs
    run(
        interpreter.path, "-I", "-m", "compileall", "-q", "-j", "0", "--invalidation-mode",
        "unchecked-hash", "-s", place, "-p", ENVIRONMENT, packages / "abbe",
    )  # fmt: skip
    subprocess.run(  # some packages hold files for other versions of Python
        [interpreter.path, "-I", "-m", "compileall", "-q", "-j", "0", "--invalidation-mode",
         "unchecked-hash", "-s", place, "-p", ENVIRONMENT, packages],
        check=False, capture_output=True,
    )  # fmt: skip
    return packages


def _clean_copy(source: Path, work: Path) -> Path:
    """What a fresh checkout has of the package: no leftovers of earlier builds get in."""
    copy = work / "source"
    copy.mkdir()
    for name in _FOLDERS:
        waste = shutil.ignore_patterns("__pycache__")
        shutil.copytree(source / name, copy / name, symlinks=True, ignore=waste)
    for name in _FILES:
        shutil.copy(source / name, copy)
    return copy


def _tested(frozen: str) -> str:
    """The versions that the tests ran with, as constraints."""
    lines = [line for line in frozen.splitlines() if "==" in line and " @ " not in line]
    return "\n".join(lines) + "\n"


def _leave_only_python(root: Path, interpreter: Interpreter) -> None:
    """Take away what names the folder of the build: activation, other packages' commands."""
    binaries = under(root, ENVIRONMENT) / "bin"
    for file in binaries.iterdir():
        file.unlink()
    name = f"python{interpreter.short}"
    link(root, ENVIRONMENT / "bin" / name, interpreter.path)
    for alias in ("python3", "python"):
        link(root, ENVIRONMENT / "bin" / alias, ENVIRONMENT / "bin" / name)
    settings = {
        "home": str(interpreter.path.parent),
        "include-system-site-packages": "false",
        "version": ".".join(map(str, interpreter.version)),
    }
    text = "".join(f"{key} = {value}\n" for key, value in settings.items())
    write(root, ENVIRONMENT / "pyvenv.cfg", text)


def _forget_the_build(info: Path) -> None:
    """Take out of a package's list of files what is not there, and where it was built."""
    (info / "direct_url.json").unlink(missing_ok=True)
    record = info / "RECORD"
    if not record.exists():
        return
    rows = list(csv.reader(io.StringIO(record.read_text(encoding="utf-8"))))
    kept = [row for row in rows if row and (info.parent / row[0]).exists()]
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(kept)
    record.write_text(out.getvalue(), encoding="utf-8")
