"""What ``abbe add`` and ``abbe remove`` share: a model's next version, refitted and written."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from abbe.compcore.effects.base import Effect
    from abbe.compcore.model.model import Model
    from abbe.daemon.answers.model.revise import Revision
    from abbe.daemon.outputs import Say


@dataclass(frozen=True)
class NextVersion:
    """The files from which a model's next version is made, and those that are written.

    Attributes
    ----------
    model
        The model as it is.
    campaigns, holdout
        What it is fitted to, and what only tests it.
    out, report
        The next version; a page with the error, version by version, None: none is asked for.
    robust
        Whether readings that stand alone are set aside in the fits.
    renew
        Whether what the model knew from other campaigns counts beside these.
    """

    model: Path
    campaigns: Sequence[Path]
    holdout: Sequence[Path]
    out: Path
    report: Path | None
    robust: bool = False
    renew: bool = False

    def checked(self, *, force: bool, as_json: bool) -> Say:
        """Refuse outputs that would destroy something; parameters and errors of `check_outputs`."""
        from abbe.daemon.outputs import MODEL, REPORT, check_outputs

        return check_outputs(
            [self.model, *self.campaigns, *self.holdout],
            [(self.out, MODEL), (self.report, REPORT)],
            force=force,
            as_json=as_json,
        )

    def refitted(
        self, change: Callable[[Model], tuple[Model, Effect]], *, adds: bool
    ) -> tuple[Revision, Effect]:
        """Change the model by one effect, fit it before and after, write it and its page.

        Parameters
        ----------
        change
            From the model as it is to the next version, and the effect that makes the difference.
        adds
            Whether that effect is added; else it is removed.

        Raises
        ------
        InputError
            For bad files, and as `change` raises; nothing is written then.
        """
        from abbe.daemon.answers.inputs import load
        from abbe.daemon.answers.model import expected_times as expected
        from abbe.daemon.answers.model.revise import revise
        from abbe.daemon.progress import shown

        with shown("reading", expected.adding(self.campaigns)) as tell:
            loaded, measured = load(self.model, self.campaigns)
            changed, effect = change(loaded)
            revision = revise(
                loaded,
                changed,
                measured,
                self.holdout,
                self.out,
                added=effect.spec if adds else None,
                removed=None if adds else effect.spec,
                robust=self.robust,
                renew="always" if self.renew else "never",
                progress=tell,
            )
        self.write_page(revision.model)
        return revision, effect

    def write_page(self, model: Model) -> None:
        """Write the page with the error, version by version, where one is asked for."""
        if self.report is not None:
            from abbe.daemon.report.model.history import page_of

            page_of(model, self.out).write(self.report)

    def answer(self, say: Say, revision: Revision, added: Effect | None, *, as_json: bool) -> None:
        """Say the error before and after, and the parameters of an effect that was added."""
        from abbe.daemon.answers.model import revise as answer

        if as_json:
            say(json.dumps(answer.as_json(revision, added), ensure_ascii=False))
            return
        for line in answer.as_text(revision, added):
            say(line)
        say(self.written)

    @property
    def written(self) -> str:
        """The line that names the files that were written."""
        return f"written: {self.out}" + (f", {self.report}" if self.report else "")
