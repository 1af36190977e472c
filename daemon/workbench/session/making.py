"""How a new version is made of the present one: fitted as it is, or with a cause added."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect
from abbe.compcore.sentences import said
from abbe.daemon.answers.model import revise
from abbe.daemon.answers.model.first_fit import fitted_version
from abbe.daemon.arguments.assignments import split_assignments
from abbe.daemon.workbench.campaigns.laid import LaidCampaigns
from abbe.daemon.workbench.session.task import Tell

Making = Callable[[Model, Path, Tell], tuple[Model, list[str]]]
"""Takes a model, the file of the new one and a task's teller; gives it, and what to say."""


def fitting(laid: LaidCampaigns, *, robust: bool) -> Making:
    """The model is fitted as it is; `robust`: without readings that stand alone."""
    campaign, held = laid.rows, laid.held

    def made(current: Model, out: Path, tell: Tell) -> tuple[Model, list[str]]:
        model, found = fitted_version(
            current, campaign, held, out, robust=robust, renew=True, progress=tell
        )
        return model, [found]

    return made


def adding(model: Model, spec: str, laid: LaidCampaigns, *, robust: bool) -> Making:
    """A cause is added, and the model refitted; `model` is asked at once whether it can be.

    Raises
    ------
    InputError
        For a cause that cannot be.
    """
    kind, *keys = spec.split() or [spec]
    with_effect(model, kind, split_assignments(keys))
    campaign, held = laid.rows, laid.held

    def made(current: Model, out: Path, tell: Tell) -> tuple[Model, list[str]]:
        changed, effect = with_effect(current, kind, split_assignments(keys))
        revision = revise.revise(
            current, changed, campaign, held, out,
            added=effect.spec, robust=robust, renew="where it can", progress=tell,
        )  # fmt: skip
        what = said("added: {cause}", cause=effect.spec)
        return revision.model, [what, *revise.as_text(revision, effect)]

    return made
