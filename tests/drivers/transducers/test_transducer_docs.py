"""Every example of docs/transducers.md is a configuration that works, and every type has one."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from abbe.drivers.transducers import (
    TRANSDUCER_CONFIG,
    BetaConfig,
    CurrentLoopConfig,
    EncoderConfig,
    LinearConfig,
    NtcRatioConfig,
    PtConfig,
    RTTableConfig,
    SteinhartHartConfig,
    make_transducer,
)

DOC = (Path(__file__).parents[3] / "docs" / "transducers.md").read_text(encoding="utf-8")
EXAMPLES = [tomllib.loads(text) for text in re.findall(r"```toml\n(type.*?)```", DOC, re.S)]
CIRCUITS = [tomllib.loads(line) for line in re.findall(r"^circuit = .*$", DOC, re.M)]
CONFIGS = (
    BetaConfig,
    CurrentLoopConfig,
    EncoderConfig,
    LinearConfig,
    NtcRatioConfig,
    PtConfig,
    RTTableConfig,
    SteinhartHartConfig,
)


@pytest.mark.parametrize("example", EXAMPLES, ids=[str(e["type"]) for e in EXAMPLES])
def test_examples_work(example: dict[str, Any]) -> None:
    transducer = make_transducer(TRANSDUCER_CONFIG.validate_python(example))
    middle = 20.0
    assert transducer.value(transducer.inverse(middle)) == pytest.approx(middle, abs=1e-3)


def test_every_type_has_an_example() -> None:
    types = {config.model_fields["type"].default for config in CONFIGS}
    assert {example["type"] for example in EXAMPLES} == types


@pytest.mark.parametrize("circuit", CIRCUITS, ids=range(len(CIRCUITS)))
def test_circuits_work(circuit: dict[str, Any]) -> None:
    pt = make_transducer(TRANSDUCER_CONFIG.validate_python({"type": "pt"} | circuit))
    assert pt.value(pt.inverse(20.0)) == pytest.approx(20.0, abs=1e-6)
    assert len(CIRCUITS) == 4


def test_every_key_is_documented() -> None:
    for config in CONFIGS:
        for key in config.model_fields:
            if len(key) > 1:  # a, b, c, d stand in the formulas
                assert re.search(rf"\b{key}\b", DOC), f"{config.__name__}.{key}"
