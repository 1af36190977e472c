"""What is known of one version beside the campaigns: the answers of *Compare* and *Learn*."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.screening.what_if import WhatIf
from abbe.compcore.diagnosis.verdict import Diagnosis, diagnose
from abbe.compcore.errors import InputError
from abbe.compcore.sentences import sentences_in
from abbe.daemon.answers.model import compare as compare_answer
from abbe.daemon.answers.typed import Adding
from abbe.daemon.workbench.campaigns.laid import LaidCampaigns
from abbe.daemon.workbench.residuals.brush import Brush, ManyResiduals
from abbe.daemon.workbench.session.compared import compared
from abbe.daemon.workbench.session.learned import learned, sliders, tried, what_if
from abbe.daemon.workbench.session.task import Tell
from abbe.daemon.workbench.versions.folder import ModelVersion

ADVICE = "what to measure next"
"""Last stage of a search for causes, which are known by then."""


class VersionFindings:
    """Worked out once each, in a task; asked from any thread.

    Parameters
    ----------
    version
        Is laid beside the campaigns.
    laid
        The campaigns.
    """

    def __init__(self, version: ModelVersion, laid: LaidCampaigns) -> None:
        self._version, self._laid = version, laid
        self.compared: bytes | None = None
        """The page *Compare* as JSON; None: not known yet."""
        self.learned: bytes | None = None
        """The page *Learn* as JSON; None: not known yet."""
        self._many: ManyResiduals | None = None
        self._diagnosis: Diagnosis | None = None
        self._trial: tuple[str, WhatIf] | None = None

    @property
    def strays(self) -> bool:
        """Whether the diagnosis left readings out that stand alone."""
        return self._diagnosis is not None and bool(self._diagnosis.strays)

    def compare(self, tell: Tell) -> None:
        """Lay the version beside the campaigns."""
        model, campaign = self._version.model, self._laid.rows
        tell("comparing")
        found = compare_answer.with_changes(model, campaign, compare(model, campaign))
        tell("drawing")
        page, self._many = compared(found)
        self.compared = _bytes(page)

    def learn(self, tell: Tell, changed: Callable[[], None]) -> None:
        """Diagnose it; `changed` is called when the causes are known, before what to measure."""
        diagnosis = diagnose(self._version.model, self._laid.rows, progress=tell)
        tell("noise floor")
        files = list(self._laid.fitted)
        adding = Adding(self._version.path, files, robust=bool(diagnosis.strays))
        self._diagnosis, self.learned = diagnosis, _bytes(learned(diagnosis, None, adding))
        changed()
        tell(ADVICE)
        self.learned = _bytes(learned(diagnosis, diagnosis.advice, adding))

    def brushed(self, brush: Brush) -> dict[str, Any]:
        """Which of many rows are chosen, where not all of them are drawn.

        Raises
        ------
        InputError
            Where all rows are drawn one by one, and for what is not there.
        """
        if self._many is None:
            raise InputError("no rows but those that are drawn", field="brush")
        return self._many.brushed(brush)

    def tried(self, spec: str, values: Mapping[str, float] | None) -> dict[str, Any] | None:
        """What a cause would leave at some values of its parameters; None: as it would be fitted.

        None while the causes are not known, as when one was added a moment ago.

        Raises
        ------
        InputError
            For a cause that cannot be tried, and for bad values.
        """
        diagnosis = self._diagnosis
        if diagnosis is None:
            return None
        trial = self._trial
        if trial is None or trial[0] != spec:
            self._trial = trial = (spec, what_if(diagnosis, spec))
        answer = tried(trial[1], diagnosis, values)
        if values is None:
            answer |= {
                "sliders": sliders(trial[1]),
                "where": {k: str(v) for k, v in trial[1].effect.where().items()},
            }
        return answer


def _bytes(answer: Mapping[str, Any]) -> bytes:
    answer = {**answer, "sentences": sentences_in(answer)}
    return json.dumps(answer, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
