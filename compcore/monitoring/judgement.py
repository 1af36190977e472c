"""The judgement of a machine by its checks: is it still the one that its model describes?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Setup
from abbe.compcore.errors import InputError
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model
from abbe.compcore.monitoring.change import MachineChange, machine_change
from abbe.compcore.monitoring.charts import ChartDesign, Charts, charted
from abbe.compcore.monitoring.expected import WILD, ExpectedChecks, expect
from abbe.compcore.monitoring.readings import CheckReadings, check_readings

F64 = NDArray[np.float64]

_GROWN = 0.5
"""Of what has grown ever more: rows from here on show the machine as it is now."""
_NOTES = "checks since a change, laid on those before it"
_LEARNT = 20
"""Checks from which on it is known how the machine scatters."""


@dataclass(frozen=True, eq=False)
class Judgement:
    """What a machine's checks say.

    Attributes
    ----------
    readings
        The checks that count, beside the model.
    expected
        What was expected of each after all before it.
    charts
        Their control charts.
    design
        What these were made for.
    change
        What has changed, None: nothing has.
    """

    readings: CheckReadings
    expected: ExpectedChecks
    charts: Charts
    design: ChartDesign
    change: MachineChange | None

    @property
    def usual(self) -> F64:
        """How far each series scatters by itself, (m,), µm or µrad: median of the later half."""
        sd = self.expected.sd
        found = []
        for k in range(sd.shape[1]):
            known = sd[np.isfinite(sd[:, k]), k]
            found.append(float(np.median(known[len(known) // 2 :])))
        return np.array(found)

    @property
    def wild(self) -> tuple[int, ...]:
        """Series of the last check that read far beyond what was expected."""
        last = self.expected.standardised[-1]
        return tuple(np.flatnonzero(np.abs(np.nan_to_num(last)) > WILD).tolist())

    @property
    def learning(self) -> int:
        """Checks that are still missing until it is known how the machine scatters."""
        return max(0, _LEARNT - len(self.readings.times))

    def detects_within(self, size: float, series: int) -> float:
        """Mean number of checks until a change of a series by `size`, µm or µrad, is signalled."""
        return self.design.detects_within(
            len(self.readings.series), size / float(self.usual[series])
        )

    def changed_rows(self) -> Campaign:
        """What the checks read since the change, laid on what they read before, for a diagnosis.

        Every reading is put to where the artefact would have been read by the machine that the
        model describes: the mean of its series before the change stands for what was unknown of it,
        and nothing is free any more. Readings of an instrument that was placed anew for them stay
        as they are. The uncertainty holds what scatters from check to check. The order of rows is
        no clock: the machine is asked for as it is now, not how it came there.

        Raises
        ------
        InputError
            When nothing has changed.
        """
        if self.change is None:
            raise InputError("no chart is beyond its limit: nothing has changed", field="--changed")
        r, first = self.readings, self.change.first_changed
        campaign = r.campaign
        since = first
        if self.change.course == "ever more":
            times = r.times
            grown = (times - times[first - 1]) / (times[-1] - times[first - 1])
            since = int(np.flatnonzero(grown >= _GROWN)[0])
        per = [1e3 if s.unit == "µm" else 1e6 for s in r.series]
        value, sd, kept = campaign.value.copy(), campaign.sd.copy(), []
        usual, stays = self.usual, r.stays
        for k in range(len(r.series)):
            own = r.of == k
            before, after = own & (r.check < first), own & (r.check >= since)
            if not before.any() or not after.any():
                continue
            value[after & stays] -= float(r.residual[before].mean()) / per[k]
            sd[after] = usual[k] * np.sqrt(1.0 + 1.0 / before.sum()) / per[k]
            kept.append(np.flatnonzero(after))
        rows = np.sort(np.concatenate(kept)) if kept else np.zeros(0, dtype=np.int64)
        if not rows.size:
            raise InputError(
                "no series was read both before the change and since", field="--changed"
            )
        found = replace(campaign, value=value, sd=sd).rows(rows)
        free = {
            str(name): () if stay else campaign.setups[str(name)].free
            for name, stay in zip(_setups(campaign)[rows].tolist(), stays[rows], strict=True)
        }
        return replace(
            found,
            conditions=replace(found.conditions, time=np.zeros(found.n)),
            setups={name: Setup(name, words) for name, words in free.items()},
            metadata=(self._head(rows),),
        )

    def _head(self, rows: NDArray[np.int64]) -> Mapping[str, object]:
        """What stands at the top of the rows that the machine is diagnosed by, with their day."""
        campaign = self.readings.campaign
        head = {**(campaign.metadata[0] if campaign.metadata else {}), "notes": _NOTES}
        first = datetime.fromtimestamp(float(campaign.conditions.time[rows].min()), UTC)
        return {**head, "date": first.date().isoformat()}


def _setups(campaign: Campaign) -> NDArray[np.str_]:
    setup = campaign.conditions.setup
    return np.full(campaign.n, "") if setup is None else setup


def judge(model: Model, campaign: Campaign, design: ChartDesign | None = None) -> Judgement:
    """Judge a machine by check measurements.

    Parameters
    ----------
    model
        What the machine was when it was measured.
    campaign
        The checks since then.
    design
        What the charts are made for; default `ChartDesign()`.

    Raises
    ------
    InputError
        As `check_readings`.
    """
    design = design or ChartDesign()
    with threads_for(0):
        readings = check_readings(model, campaign)
    expected = expect(readings)
    charts = charted(expected.charted, design)
    change = None
    if charts.alarm is not None and len(readings.times) > 1:
        change = machine_change(readings, expected, charts.alarm)
    return Judgement(readings, expected, charts, design, change)
