"""The package that is proved, built once; and a later version of it, to upgrade to."""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
from pathlib import Path

from tests.support.systemd.image import ROOT

_SOURCES = ("abbe", "compcore", "drivers", "daemon", "tools/deb", "pyproject.toml")
LATER = "99.1"
"""Version of the later package."""


def built() -> Path:
    """``abbe_VERSION_amd64.deb`` of the sources as they are, as ``make deb`` makes it.

    Built below ``build/`` unless the one there is of these sources.
    """
    folder = ROOT / "build" / "package" / _fingerprint()
    if not (folder / "complete").exists():
        subprocess.run([sys.executable, "-m", "tools.deb", "--out", folder], cwd=ROOT, check=True)
        (folder / "complete").touch()
    (found,) = folder.glob("abbe_*.deb")
    return found


def later(package: Path) -> Path:
    """The same package as another version, in its name and in what ``abbe --version`` says."""
    folder = package.parent / "later"
    made = folder / f"abbe_{LATER}_amd64.deb"
    if made.exists():
        return made
    tree = folder / "tree"
    folder.mkdir(exist_ok=True)
    subprocess.run(["rm", "-rf", tree], check=True)
    subprocess.run(["dpkg-deb", "-R", package, tree], check=True)
    (metadata,) = tree.glob("usr/lib/abbe/lib/python3.*/site-packages/abbe-*.dist-info/METADATA")
    for file in (metadata, tree / "DEBIAN" / "control"):
        text = file.read_text()
        file.write_text(re.sub(r"(?m)^Version: .*$", f"Version: {LATER}", text, count=1))
    subprocess.run(
        ["dpkg-deb", "-Zzstd", "-z1", "--root-owner-group", "--build", tree, made],
        check=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    subprocess.run(["rm", "-rf", tree], check=True)
    return made


def _fingerprint() -> str:
    found = hashlib.sha256()
    for name in _SOURCES:
        for path in sorted([ROOT / name, *(ROOT / name).rglob("*")]):
            if path.is_file() and "__pycache__" not in path.parts:
                found.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    return found.hexdigest()[:12]
