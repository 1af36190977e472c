"""Prometheus and promtool, from Debian's package."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple, Self

import pytest

ROOT = Path(__file__).parents[3]
UNPACKED = ROOT / ".venv" / "unpacked" / "usr" / "bin"


class PrometheusTools(NamedTuple):
    """Paths of the two."""

    prometheus: str
    promtool: str

    @classmethod
    def found(cls) -> Self:
        """Where they are; `make test` unpacks them, and so does this."""
        both = shutil.which("prometheus"), shutil.which("promtool")
        if None in both and not (UNPACKED / "promtool").exists():
            made = UNPACKED.relative_to(ROOT) / "prometheus"
            subprocess.run(
                ["make", str(made)], cwd=ROOT, check=False, capture_output=True, timeout=90
            )
        prometheus, promtool = (
            there or str(UNPACKED / name)
            for there, name in zip(both, ("prometheus", "promtool"), strict=True)
        )
        if not Path(promtool).exists():
            pytest.skip("Debian's package prometheus cannot be had here")
        return cls(prometheus, promtool)
