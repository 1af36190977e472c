"""One campaign of one machine diagnosed, as a task that can be spread."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from abbe.compcore.errors import AbbeError
from abbe.daemon.answers.fleet_diagnosis.fleet_files import FleetCampaign
from abbe.daemon.spreading.spread_work import SpreadTask

_FUNCTION = "abbe.daemon.answers.fleet_diagnosis.diagnosed:diagnosed_campaign"
MODEL, CAMPAIGN = "model.toml", "campaign.csv"


def diagnosis_tasks(campaigns: Sequence[FleetCampaign]) -> list[Callable[[], SpreadTask]]:
    """A task a campaign; its files are read when its turn has come."""
    return [partial(_task, one) for one in campaigns]


def _task(one: FleetCampaign) -> SpreadTask:
    title = f"{one.machine}, {one.campaign.name}"
    argument = json.dumps(
        {"machine": one.machine, "model": one.model.name, "campaign": one.campaign.name}
    )
    contents = {MODEL: one.model.read_bytes(), CAMPAIGN: one.campaign.read_bytes()}
    return SpreadTask(_FUNCTION, argument, contents, title)


def diagnosed_campaign(contents: Mapping[str, bytes], argument: str) -> bytes:
    """Diagnose; what a worker does. A bad file is an answer too: the others go on."""
    asked: dict[str, Any] = json.loads(argument)
    with tempfile.TemporaryDirectory(prefix="abbe-") as folder:
        paths = {MODEL: Path(folder) / asked["model"], CAMPAIGN: Path(folder) / asked["campaign"]}
        for name, path in paths.items():
            path.write_bytes(contents[name])
        try:
            found = _diagnosed(paths[MODEL], paths[CAMPAIGN])
        except AbbeError as error:
            found = {"problem": str(error).replace(f"{folder}/", "")}
    return json.dumps(asked | found, ensure_ascii=False, sort_keys=True).encode()


def _diagnosed(model: Path, campaign: Path) -> dict[str, Any]:
    from abbe.compcore.campaign.noise import noise_floor
    from abbe.compcore.comparison.compare import compare
    from abbe.compcore.diagnosis import diagnose
    from abbe.daemon.answers.inputs import load
    from abbe.daemon.answers.model.diagnose import as_json

    loaded, rows = load(model, [campaign])
    diagnosis = diagnose(loaded, rows)
    return as_json(diagnosis, noise_floor(rows, loaded.machine), (), compare(loaded, rows))
