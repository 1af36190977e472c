"""What must be the same where work is done and where it is asked for: Abbe and what computes."""

from __future__ import annotations

import hashlib
import platform
from functools import cache
from importlib.metadata import version
from pathlib import Path

_ROOMS = Path(__file__).resolve().parents[2]


@cache
def fingerprint() -> dict[str, str]:
    """Name → version: Abbe with a hash of its sources, Python, NumPy, SciPy, kind of processor.

    Results are the same to the bit where all of them are.
    """
    digest = hashlib.sha256()
    for folder in ("compcore", "drivers", "daemon"):
        root = (_ROOMS / folder).resolve()
        for file in sorted(root.rglob("*.py")):
            digest.update(file.relative_to(root).as_posix().encode() + b"\0")
            digest.update(file.read_bytes() + b"\0")
    return {
        "Abbe": f"{version('abbe')} ({digest.hexdigest()[:8]})",
        "Python": ".".join(platform.python_version_tuple()[:2]),
        "NumPy": version("numpy"),
        "SciPy": version("scipy"),
        "processor": platform.machine(),
    }


def differing(here: dict[str, str], there: dict[str, str]) -> str:
    """What differs, in words; empty: nothing."""
    return ", ".join(
        f"{name} {there.get(name, 'missing')} there, {value} here"
        for name, value in here.items()
        if there.get(name) != value
    )
