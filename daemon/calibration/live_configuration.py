"""The configuration for a live correction with the calibrated model: the one there is, renamed."""

from __future__ import annotations

import os
import re
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.files.text.bounded_text import read_bounded
from abbe.daemon.config import load_config

_MODEL = re.compile(r"""^(\s*model\s*=\s*)("[^"\n]*"|'[^'\n]*')""", re.MULTILINE)
_MOST_BYTES = 10_000_000


def write_live_configuration(config: Path, model: Path, out: Path) -> None:
    """Write a configuration with another model; everything else is as it was.

    Raises
    ------
    InputError
        When it cannot be written, or what was written is not in order.
    """
    text = read_bounded(config, _MOST_BYTES)
    found = _MODEL.search(text)
    if found is None:
        raise InputError("the line with the model is not found", file=config, field="model")
    named = os.path.relpath(model.resolve(), out.resolve().parent)
    start, end = found.span(2)
    write_atomically(out, text[:start] + '"' + named.replace("\\", "/") + '"' + text[end:])
    load_config(out)
