"""``python -m tools.deb``: build ``dist/abbe_VERSION_amd64.deb``."""

from __future__ import annotations

import argparse
import gzip
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path

from abbe.daemon.config.folders import CONFIGURATIONS, STATE
from abbe.daemon.systemd.messages import catalogue
from abbe.daemon.systemd.unit import TEMPLATE_NAME, sysusers, template
from tools.deb import layout
from tools.deb.about import changelog, control, copyright_of, shared_libraries
from tools.deb.environment import BuildError, Interpreter, make_environment, run

ROOT = Path(__file__).parents[2]
_FILES = Path(__file__).parent / "files"
_SCRIPTS = ("postinst", "prerm", "postrm")
_LEVEL = 9
"""Of compression: zstd's greatest take ten minutes for a few MB less."""
_NEEDED = ("dpkg-deb", "dpkg-shlibdeps", "dpkg-query")


def main(arguments: Sequence[str] | None = None) -> int:
    """Build the package; what is missing is said in a line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "dist", metavar="DIR")
    parser.add_argument("--python", type=Path, default=Path("/usr/bin/python3"), metavar="FILE")
    parser.add_argument("--version", default="", help="default: that of pyproject.toml")
    parser.add_argument(
        "--extras",
        default="can,fleet,http,mqtt,opcua,sparkplug",
        help="optional parts, with commas between",
    )
    parser.add_argument("--compression", default="zstd", help="as dpkg-deb -Z takes it")
    given = parser.parse_args(arguments)
    try:
        made = build(
            given.out,
            given.python,
            given.version,
            [part for part in given.extras.split(",") if part],
            given.compression,
        )
    except BuildError as error:
        sys.stderr.write(f"make deb: {error}\n")
        return 1
    sys.stdout.write(f"{made}: {made.stat().st_size / 1e6:.0f} MB\n")
    return 0


def build(out: Path, python: Path, version: str, extras: Sequence[str], compression: str) -> Path:
    """Build the package into a folder; returns its path.

    Parameters
    ----------
    out
        Folder.
    python
        Debian's own interpreter.
    version
        Empty: that of ``pyproject.toml``.
    extras
        Optional parts of Abbe.
    compression
        As ``dpkg-deb -Z`` takes it.

    Raises
    ------
    BuildError
        When something is missing, with what to do.
    """
    missing = [name for name in _NEEDED if shutil.which(name) is None]
    if missing:
        raise BuildError(f"{', '.join(missing)} not found: apt install dpkg-dev")
    interpreter = Interpreter.of(python)
    version = version or _own_version()
    architecture = run("dpkg", "--print-architecture").strip()
    os.umask(0o022)
    with tempfile.TemporaryDirectory(prefix="abbe-deb-") as folder:
        work = Path(folder)
        root = work / "root"
        root.mkdir()
        packages = make_environment(root, ROOT, interpreter, extras, work)
        _add_files(root, packages, version)
        _plain_modes(root)
        size = sum(path.lstat().st_size for path in root.rglob("*") if path.is_file()) // 1024
        libraries = shared_libraries(packages, work)
        sums = _sums(root)
        about = Path("/DEBIAN")
        said = control(version, architecture, size, interpreter, libraries)
        layout.write(root, about / "control", said)
        layout.write(root, about / "md5sums", sums)
        for name in _SCRIPTS:
            layout.write(root, about / name, (_FILES / name).read_bytes(), executable=True)
        out.mkdir(parents=True, exist_ok=True)
        target = out / f"abbe_{version}_{architecture}.deb"
        done = subprocess.run(
            ["dpkg-deb", f"-Z{compression}", f"-z{_LEVEL}", "--root-owner-group",
             "--build", root, target],
            env={**os.environ, "SOURCE_DATE_EPOCH": str(_moment())},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode:
            raise BuildError(f"dpkg-deb failed:\n{done.stderr}")
    return target


def _add_files(root: Path, packages: Path, version: str) -> None:
    """Everything but the environment and what dpkg itself reads."""
    layout.write(root, layout.UNITS / TEMPLATE_NAME, template(layout.COMMAND))
    layout.write(root, layout.SYSUSERS, sysusers())
    layout.write(root, layout.CATALOGUE, catalogue())
    layout.write(root, layout.OVERRIDES, (_FILES / "lintian-overrides").read_bytes())
    manual = (_FILES / "abbe.1").read_bytes()
    layout.write(root, layout.MAN, gzip.compress(manual, mtime=0))
    documents = layout.DOCUMENTATION
    layout.write(root, documents / "changelog.gz", changelog(version, _moment()))
    layout.write(root, documents / "copyright", copyright_of(packages))
    for name in ("README.md", "CHANGELOG.md"):
        layout.write(root, documents / name, (ROOT / name).read_bytes())
    for name in ("docs", "examples"):
        waste = shutil.ignore_patterns("__pycache__", "*.egg-info", "journal.log*", "build")
        shutil.copytree(ROOT / name, layout.under(root, documents / name), ignore=waste)
    for folder in (CONFIGURATIONS, STATE):
        layout.under(root, folder).mkdir(parents=True)


def _plain_modes(root: Path) -> None:
    """Readable for everybody, writable for root only."""
    for path in root.rglob("*"):
        if path.is_symlink():
            continue
        runs = path.is_dir() or (path.parent.name == "bin" and path.stat().st_mode & 0o111)
        path.chmod(0o755 if runs else 0o644)
    root.chmod(0o755)


def _sums(root: Path) -> str:
    files = sorted(path for path in root.rglob("*") if path.is_file() and not path.is_symlink())
    return "".join(
        f"{hashlib.md5(path.read_bytes(), usedforsecurity=False).hexdigest()}  "
        f"{path.relative_to(root)}\n"
        for path in files
    )


def _own_version() -> str:
    return str(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"])


def _moment() -> int:
    """When the sources were last changed, s since 1970: the same package from the same sources."""
    if given := os.environ.get("SOURCE_DATE_EPOCH"):
        return int(given)
    try:
        return int(run("git", "log", "-1", "--format=%ct", cwd=ROOT))
    except (BuildError, FileNotFoundError, ValueError):
        return int(time.time())


if __name__ == "__main__":
    sys.exit(main())
