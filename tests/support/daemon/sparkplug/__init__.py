"""Sparkplug payloads read and written by an implementation that is not Abbe's."""

from __future__ import annotations

import base64
import json
import os
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest

ROOT = Path(__file__).parents[4]
_MODULES = ROOT / ".venv" / "sparkplug" / "node_modules"


class Said(NamedTuple):
    """One message: its kind (``NBIRTH`` …), its topic, its payload, whether it was retained."""

    kind: str
    topic: str
    payload: dict[str, Any]
    retained: bool

    @property
    def metrics(self) -> list[dict[str, Any]]:
        return self.payload["metrics"]

    @property
    def values(self) -> dict[str, Any]:
        """Of a birth: name → value."""
        return {m["name"]: m["value"] for m in self.metrics}


def decoded(heard: Sequence[tuple[str, bytes, bool]]) -> list[Said]:
    """What a subscriber heard, states of hosts left out."""
    messages = [m for m in heard if "/STATE/" not in m[0]]
    lines = _node("decode", [base64.b64encode(body).decode() for _, body, _ in messages])
    return [
        Said(topic.split("/")[2], topic, json.loads(line), retained)
        for (topic, _, retained), line in zip(messages, lines, strict=True)
    ]


def encoded(payload: dict[str, Any]) -> bytes:
    """A payload's bytes."""
    return base64.b64decode(_node("encode", [json.dumps(payload)])[0])


def _node(way: str, lines: Sequence[str]) -> list[str]:
    if not _MODULES.exists():
        target = ".venv/sparkplug/node_modules/.package-lock.json"
        subprocess.run(["make", target], cwd=ROOT, check=False, capture_output=True, timeout=90)
    if not _MODULES.exists():
        pytest.skip("npm's package sparkplug-payload cannot be had here")
    done = subprocess.run(
        ["node", Path(__file__).with_name("decode.js"), way],
        env=os.environ | {"NODE_PATH": str(_MODULES)},
        input="\n".join(lines), capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.split() if way == "encode" else done.stdout.splitlines()
