"""``abbe fleet compare`` and ``common`` as they are typed, on machines in folders."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis import Diagnosis, diagnose
from abbe.compcore.files.model_file import load_model
from abbe.compcore.model.model import Model
from abbe.daemon.answers.fleet import common as answer_of_common
from abbe.daemon.answers.inputs import load
from abbe.daemon.application import application
from tests.support.daemon.plant_store import MODEL

PLAY = 0.75
"""µm; a hundredth of a line's rows tells so much of it as its own noise."""


def machine(folder: Path, number: int, play: float, date: str = "2026-09-01") -> Path:
    """A machine measured along X, back and forth, with some play."""
    rng = np.random.default_rng(100 + number)
    made = folder / f"mill-{number}"
    made.mkdir(parents=True, exist_ok=True)
    (made / "machine.toml").write_text(MODEL, "utf-8")
    lines = [
        '# format = "abbe-campaign/1"', '# machine = "Mill 7"', f'# date = "{date}"',
        "time,setup,kind,X,Y,Z,X_dir,ux,uy,uz,value,sd",
    ]  # fmt: skip
    time = 0
    for setup in range(3):
        for run in range(2):
            for at in range(0, 801, 80) if run == 0 else range(800, -1, -80):
                way = 1 if run == 0 else -1
                value = 0.5 * play * way + rng.normal()
                lines.append(f"{time},s{setup},displacement,{at},100,0,{way},1,0,0,{value:.3f},1.0")
                time += 5
    (made / f"x-{date}.csv").write_text("\n".join(lines) + "\n", "utf-8")
    return made


@pytest.fixture(scope="module", autouse=True)
def told() -> Iterator[Callable[[Model, Campaign], Diagnosis]]:
    """Diagnoses a campaign, also for the commands, and only once each: they are the same."""
    known: dict[bytes, Diagnosis] = {}

    def once(model: Model, campaign: Campaign) -> Diagnosis:
        rows = campaign.value.tobytes()
        if rows not in known:
            known[rows] = diagnose(model, campaign)
        return known[rows]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(answer_of_common, "diagnose", once)
        yield once


def typed(*words: str) -> str:
    done = CliRunner().invoke(application("fleet"), ["fleet", *words])
    assert done.exit_code == 0, (done.output, done.exception)
    return done.output


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Eight machines, the first five with play."""
    folder = tmp_path_factory.mktemp("fleet")
    return [str(machine(folder, n, PLAY if n < 5 else 0.0)) for n in range(8)]


def test_a_cause_that_none_shows_alone_is_named_together(
    fleet: list[str], told: Callable[[Model, Campaign], Diagnosis]
) -> None:
    for one in fleet:
        found = told(*load(Path(one) / "machine.toml", sorted(Path(one).glob("*.csv"))))
        assert found.verdict == "complete", one
    answer = json.loads(typed("common", *fleet, "--json"))
    assert [c["spec"] for c in answer["common"]] == ["backlash axis=X"]
    (cause,) = answer["common"]
    on = set(cause["on"])
    assert len(on & {"mill-0", "mill-1", "mill-2", "mill-3", "mill-4"}) >= 4
    assert len(on & {"mill-5", "mill-6", "mill-7"}) <= 1
    (play,) = cause["parameters"].values()
    assert play["mean"] == pytest.approx(1e-3 * PLAY, rel=0.4)
    said = typed("common", *fleet)
    assert "backlash axis=X: the same on" in said
    assert typed("common", *fleet[5:]).endswith("no cause is common to several machines\n")


def test_since_when_all_have_it(tmp_path: Path) -> None:
    """Two campaigns each, before and after something happened to four of six."""
    folders = []
    for n in range(6):
        machine(tmp_path, n, 0.0, "2026-06-01")
        folders.append(str(machine(tmp_path, n, 1.6 if n < 4 else 0.0, "2026-10-01")))
    for words in ((), ("--since", "2026-09-14")):
        (cause,) = json.loads(typed("common", *folders, *words, "--json"))["common"]
        assert cause["spec"] == "backlash axis=X"
        assert cause["since"][:10] == ("2026-10-01" if not words else "2026-09-14")
        assert set(cause["on"]) >= {"mill-0", "mill-1", "mill-2", "mill-3"}
        assert len(cause["on"]) < 6


def test_what_machines_have_in_common_and_the_next_one(tmp_path: Path) -> None:
    paths = []
    for n, play in enumerate((2.0, 2.4, 1.6, 2.2)):
        text = (
            f'{MODEL}[[effects]]\nkind = "backlash"\naxis = "X"\n'
            f'[effects.parameters.b]\nvalue = {play}\nsd = 0.1\nunit = "um"\n'
        )
        (tmp_path / f"mill-{n}.toml").write_text(text, "utf-8")
        paths.append(str(tmp_path / f"mill-{n}.toml"))
    out = tmp_path / "next.toml"
    said = typed("compare", *paths, "--effect", "backlash", "-o", str(out))
    assert "2.05 ± 0.17 µm, machines scatter by 0.33" in said
    assert "mill-1: 2.4 ± 0.1" in said
    answer = json.loads(typed("compare", *paths, "--json"))
    assert answer["parameters"][0]["next_sd"] == pytest.approx(0.37, abs=0.01)
    like_others = machine(tmp_path / "a", 20, 2.0)
    unlike = machine(tmp_path / "b", 21, 9.0)
    for folder, verdict in ((like_others, "complete"), (unlike, "changed")):
        model, campaign = load(out, sorted(folder.glob("*.csv")))
        assert diagnose(model, campaign).verdict == verdict
    assert load_model(out).covariance is not None
