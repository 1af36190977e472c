"""The configuration for a live correction with a calibrated model: the one there is, renamed.

Each names a model file of its own, called by its content and never written again: a later round of
the calibration does not change what an earlier configuration starts.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Sequence
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.files.text.bounded_text import read_bounded
from abbe.daemon.config import load_config

_MODEL = re.compile(r"""^(\s*model\s*=\s*)("[^"\n]*"|'[^'\n]*')""", re.MULTILINE)
_MOST_BYTES = 10_000_000
_DIGITS = 12
"""Of a model's SHA-256 in its name."""


def write_live_configuration(
    config: Path, model: Path, out: Path, about: Sequence[str] = ()
) -> Path:
    """Write a configuration with a copy of another model; everything else is as it was.

    Parameters
    ----------
    about
        Lines for people, at the top.

    Returns
    -------
    The model's file.

    Raises
    ------
    InputError
        When it cannot be written, or what was written is not in order.
    """
    text = read_bounded(config, _MOST_BYTES)
    found = _MODEL.search(text)
    if found is None:
        raise InputError("the line with the model is not found", file=config, field="model")
    kept = _keep(model, out.parent)
    named = os.path.relpath(kept.resolve(), out.resolve().parent)
    start, end = found.span(2)
    top = "".join(f"# {line}\n" for line in "\n".join(about).splitlines())
    write_atomically(out, top + text[:start] + '"' + named.replace("\\", "/") + '"' + text[end:])
    load_config(out)
    return kept


def kept_model(model: Path, folder: Path) -> tuple[Path, ...]:
    """Where a copy of a model is kept, called by its content; nothing where there is no model."""
    try:
        digest = hashlib.sha256(model.read_bytes()).hexdigest()
    except OSError:
        return ()
    return (folder / f"model-{digest[:_DIGITS]}.toml",)


def _keep(model: Path, folder: Path) -> Path:
    """The copy, made where it is not there yet."""
    for kept in kept_model(model, folder):
        content = model.read_bytes()
        if not kept.exists():
            write_atomically(kept, content)
        elif kept.read_bytes() != content:
            raise InputError(
                "was changed since it was written", file=kept, expected="another name for it"
            )
        return kept
    raise InputError("is not there", file=model)
