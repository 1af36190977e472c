"""Where the Debian package's files lie on the computer that it is installed on."""

from __future__ import annotations

import os
from pathlib import Path

ENVIRONMENT = Path("/usr/lib/abbe")
"""The package's own Python environment; nothing else writes there."""
COMMAND = Path("/usr/bin/abbe")
DOCUMENTATION = Path("/usr/share/doc/abbe")
UNITS = Path("/usr/lib/systemd/system")
SYSUSERS = Path("/usr/lib/sysusers.d/abbe.conf")
CATALOGUE = Path("/usr/lib/systemd/catalog/abbe.catalog")
MAN = Path("/usr/share/man/man1/abbe.1.gz")
OVERRIDES = Path("/usr/share/lintian/overrides/abbe")


def under(root: Path, path: Path) -> Path:
    """A path of the installed system, below a folder that it is gathered in."""
    return root / path.relative_to("/")


def write(root: Path, path: Path, content: str | bytes, *, executable: bool = False) -> None:
    """One file of the installed system, gathered below `root`."""
    target = under(root, path)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(content.encode() if isinstance(content, str) else content)
    target.chmod(0o755 if executable else 0o644)


def link(root: Path, path: Path, to: Path) -> None:
    """A symbolic link of the installed system, as Debian wants it: relative."""
    target = under(root, path)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    target.symlink_to(os.path.relpath(to, path.parent))
