"""Completing a model in a calibration: what is missing is named, and added where one agrees."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from abbe.compcore.campaign.noise import noise_floor
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.diagnosis.words import diagnosis_words
from abbe.compcore.files.text.atomic import write_atomically
from abbe.daemon.answers.inputs import load
from abbe.daemon.answers.model import expected_times as expected
from abbe.daemon.answers.typed import Adding
from abbe.daemon.commands.model.add import add
from abbe.daemon.progress import shown

_MOST = 4
"""Causes that are added, one after the other."""


def complete_model(
    fitted: Path,
    campaign: Path,
    out: Path,
    say: Callable[[str], None],
    ask: Callable[[str], bool],
) -> None:
    """Diagnose a fitted model, add the causes that are established and agreed to, write the last.

    Parameters
    ----------
    say
        Tells a line.
    ask
        Whether a cause may be added.
    """
    model = fitted
    for number in range(1, _MOST + 1):
        with shown("reading", expected.diagnosing([campaign], advised=False)) as tell:
            loaded, measured = load(model, [campaign])
            noise = noise_floor(measured, loaded.machine)
            found = diagnose(loaded, measured, progress=tell)
        adding = Adding(model, [campaign])
        for line in diagnosis_words(found, noise, (), adding.command, adding.fitting):
            say(line)
        best = found.established[0] if found.established else None
        if best is None:
            break
        spec = best.effect.spec
        if not ask(f"add {spec}?"):
            break
        following = out.with_name(f"{fitted.stem}-{number + 1}{fitted.suffix}")
        add(model, spec, [campaign], following)
        model = following
    write_atomically(out, model.read_bytes())
    say(f"written: {out}, which is {model.name}")
