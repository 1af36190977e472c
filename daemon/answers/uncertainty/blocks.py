"""Blocks of draws as tasks that can be spread, and their answers as bytes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from functools import lru_cache, partial

import numpy as np

from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.part_file import parse_part
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.virtual_cmm.simulation import BLOCK, MeasuredBlock, VirtualMeasurement
from abbe.daemon.spreading.spread_work import SpreadTask

_FUNCTION = "abbe.daemon.answers.uncertainty.blocks:measured_block"
MODEL, PART = "model", "part"
_ARRAYS = ("corrected", "uncorrected", "alone")


def block_tasks(model: bytes, part: bytes, seed: int, draws: int) -> list[Callable[[], SpreadTask]]:
    """The tasks of a run: a block of draws each."""
    contents = {MODEL: model, PART: part}
    made: list[Callable[[], SpreadTask]] = []
    for number in range(-(-draws // BLOCK)):
        count = min(BLOCK, draws - number * BLOCK)
        argument = json.dumps({"seed": seed, "block": number, "draws": count})
        made.append(partial(SpreadTask, _FUNCTION, argument, contents, f"block {number}"))
    return made


def measured_block(contents: Mapping[str, bytes], argument: str) -> bytes:
    """Measure a block virtually; what a worker does."""
    asked = json.loads(argument)
    digest = hashlib.sha256(contents[MODEL] + b"\0" + contents[PART]).hexdigest()
    measurement = _prepared(_Contents(digest, contents[MODEL], contents[PART]), asked["seed"])
    block = measurement.block(asked["block"], asked["draws"])
    return packed(block)


class _Contents:
    """Two files, known by their hash: workers keep what they have read."""

    def __init__(self, digest: str, model: bytes, part: bytes) -> None:
        self.digest, self.model, self.part = digest, model, part

    def __hash__(self) -> int:
        return hash(self.digest)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Contents) and self.digest == other.digest


@lru_cache(maxsize=2)
def _prepared(files: _Contents, seed: int) -> VirtualMeasurement:
    model = parse_model(TomlSource(files.model.decode("utf-8-sig").replace("\r\n", "\n")))
    program = parse_part(files.part.decode("utf-8-sig"), model.machine)
    return VirtualMeasurement(model, program, seed)


def packed(block: MeasuredBlock) -> bytes:
    """The arrays of a block: their shapes as a line of JSON, then their numbers, little-endian."""
    arrays = [np.ascontiguousarray(getattr(block, name), dtype="<f8") for name in _ARRAYS]
    head = json.dumps([a.shape for a in arrays]).encode() + b"\n"
    return head + b"".join(a.tobytes() for a in arrays)


def unpacked(body: bytes) -> MeasuredBlock:
    """The block that `packed` packed."""
    head, _, rest = body.partition(b"\n")
    found, at = {}, 0
    for name, shape in zip(_ARRAYS, json.loads(head), strict=True):
        size = int(np.prod(shape))
        found[name] = np.frombuffer(rest, "<f8", size, at).reshape(shape).astype(np.float64)
        at += 8 * size
    return MeasuredBlock(**found)
