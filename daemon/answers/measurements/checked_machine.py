"""A machine whose checks are judged: which model, which file of checks, since when."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.recognised import CONFIG, recognised
from abbe.compcore.model.model import Model
from abbe.compcore.monitoring.charts import ChartDesign
from abbe.daemon.answers.measurements import check_point
from abbe.daemon.arguments.moments import moment
from abbe.daemon.config import Configuration, load_config

_FILE = "checks.csv"
_FRESH = 300.0
"""s for which a recorded temperature stands for the present one."""


@dataclass(frozen=True)
class CheckedMachine:
    """What the command line says of it.

    Attributes
    ----------
    named
        The file that the user named: model or configuration.
    model, model_path
        The model, and its file.
    checks
        The file of checks.
    other_checks
        That file as the user named it, None: the default.
    since
        As typed; empty: since the machine was fitted.
    design
        What the charts are made for.
    configuration
        None where a model was named.
    """

    named: Path
    model: Model
    model_path: Path
    checks: Path
    other_checks: Path | None
    since: str
    design: ChartDesign
    configuration: Configuration | None

    @classmethod
    def of(
        cls, named: Path, checks: Path | None, since: str, every: float | None
    ) -> CheckedMachine:
        """Read a model, or a configuration and its model."""
        kind = recognised(named)
        if kind is not CONFIG:
            model = load_model(named)
            design = ChartDesign() if every is None else ChartDesign(every)
            kept = checks or named.parent / _FILE
            return cls(named, model, named, kept, checks, since, design, None)
        configuration = load_config(named)
        section = configuration.file.checks
        design = ChartDesign(section.false_alarm_every if every is None else every)
        return cls(
            named,
            configuration.model,
            configuration.model_path,
            checks or configuration.checks_path,
            checks,
            since,
            design,
            configuration,
        )

    def recorded(self) -> Campaign | None:
        """The checks so far; None: none."""
        there = self.checks.exists()
        return read_campaign(self.checks, self.model.machine) if there else None

    def judged(self, campaign: Campaign) -> check_point.CheckAnswer:
        """The judgement of these checks."""
        if self.since:
            start: float | None = moment(self.since, "--since")
        else:
            start = check_point.calibrated(self.model)
        changed = self.checks.with_name("changed.csv")
        command = check_point.diagnosing(
            self.named, self.model_path, self.other_checks, self.since, changed
        )
        return check_point.judged(self.model, campaign, self.design, start, command)

    def signals(self, now: float) -> dict[str, float]:
        """Signals that a running correction has recorded just now, so that nobody types them."""
        path = None if self.configuration is None else self.configuration.records_path
        if path is None or not path.is_file():
            return {}
        from abbe.daemon.records.reading import opened

        with opened(path) as records:
            there = records.series()
            wanted = [name for name in self.model.machine.signals if name in there]
            if not wanted:
                return {}
            rows = records.values(now - _FRESH, now, wanted)
            return {name: mean for _, name, _, mean, _ in rows}
