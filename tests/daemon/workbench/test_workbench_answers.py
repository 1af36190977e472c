"""The workbench answers as the commands do, and what is tried is what a refit then finds."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from abbe.compcore.campaign.campaign import LENGTHS
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.revise import add_effect
from abbe.daemon.application import app
from abbe.daemon.workbench.opened import WhatToOpen, what_to_open
from abbe.daemon.workbench.session.workbench import Workbench

pytestmark = pytest.mark.timeout(300)

BRIDGE = Path(__file__).parents[2] / "data" / "p03-bridge"
MODEL = BRIDGE / "model.toml"
PLAY = "backlash axis=Z"


@pytest.fixture(scope="module")
def campaign() -> Path:
    return BRIDGE / "fit.csv"


def idle(bench: Workbench) -> Workbench:
    """Wait for what is under way; it has gone well."""
    pause = threading.Event()
    while bench.state()["task"] is not None:
        pause.wait(0.02)
    assert bench.state()["error"] == ""
    return bench


def answer(found: bytes | None) -> dict[str, Any]:
    assert found is not None
    read: dict[str, Any] = json.loads(found)
    return read


def command(*arguments: object) -> dict[str, Any]:
    done = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert done.exit_code == 0, done.output
    said: dict[str, Any] = json.loads(done.stdout)
    return said


@pytest.fixture(scope="module")
def learned(campaign: Path) -> Workbench:
    bench = idle(Workbench(MODEL, [campaign]))
    bench.learn()
    return idle(bench)


def test_compare_says_what_the_command_says(learned: Workbench, campaign: Path) -> None:
    page, said = answer(learned.findings.compared), command("compare", MODEL, campaign)
    lengths = np.array(
        [v for v, p in zip(page["values"], page["rows"]["part"], strict=True) if not p]
    )
    assert len(lengths) == said["n"]
    assert np.sqrt(np.mean(lengths**2)) == pytest.approx(said["rms"], rel=1e-4)
    printed = CliRunner().invoke(app, ["compare", str(MODEL), str(campaign)]).stdout.splitlines()
    for sentence in (*page["verdict"], *(f"SUSPICIOUS: {s}" for s in page["suspicions"])):
        assert sentence in printed
    assert "Z stands" in page["title"]
    # what is wrong is the first picture
    first = page["panels"][0]
    assert (first["axis"], first["measured"]) == ("Z", "Z")


def test_learn_says_what_the_command_says(learned: Workbench, campaign: Path) -> None:
    page, said = answer(learned.findings.learned), command("diagnose", MODEL, campaign)
    assert page["verdict"] == said["verdict"]
    found = [(c["spec"], " ".join(c["explanation"])) for c in page["causes"]]
    assert found == [(c["spec"], c["explanation"]) for c in said["candidates"]]
    assert found[0][0] == PLAY
    assert page["rms"] == pytest.approx(said["rms"])
    assert page["floor"] == pytest.approx(said["noise_floor"])
    assert len(page["advice"]) == len(said["measure_next"])
    assert {c["spec"] for c in page["candidates"]} >= {PLAY}


def test_what_is_tried_is_what_a_refit_leaves(learned: Workbench, campaign: Path) -> None:
    page, tried = answer(learned.findings.learned), learned.findings.tried(PLAY, None)
    model = load_model(MODEL)
    rows = read_campaign(campaign, model.machine)
    refitted = fit(add_effect(model, PLAY), rows)
    assert tried["rms"] == pytest.approx(refitted.rms(*LENGTHS) * 1e3, rel=2e-3)
    factor = np.where(np.array(page["rows"]["part"]) == 0, 1e3, 1e6)
    left = refitted.residual[page["rows"]["row"]] * factor
    # the refit weighs nothing anew here: row by row the same
    assert np.abs(np.array(tried["values"]) - left).max() < 0.05


def test_no_amount_changes_nothing_and_the_best_is_best(learned: Workbench) -> None:
    page, best = answer(learned.findings.learned), learned.findings.tried(PLAY, None)
    (slider,) = best["sliders"]
    assert slider["unit"] == "µm"
    value = slider["value"]
    assert learned.findings.tried(PLAY, {"b": 0.0})["values"] == pytest.approx(
        page["values"], abs=2e-4
    )
    for other in (0.7 * value, 1.3 * value):
        assert learned.findings.tried(PLAY, {"b": other})["rms"] > best["rms"] + 0.02
    # beyond the slider's ends nothing is tried
    assert learned.findings.tried(PLAY, {"b": 1e9}) == learned.findings.tried(
        PLAY, {"b": slider["high"]}
    )


def test_a_time_constant_moves_the_columns(learned: Workbench) -> None:
    spec = next(
        c["spec"] for c in answer(learned.findings.learned)["candidates"] if "warm_up" in c["spec"]
    )
    best = learned.findings.tried(spec, None)
    values = {s["name"]: s["value"] for s in best["sliders"]}
    tau = next(s for s in best["sliders"] if s["name"] == "tau")
    assert tau["by_ratio"]
    assert not tau["amount"]
    assert learned.findings.tried(spec, values)["rms"] == best["rms"]
    assert learned.findings.tried(spec, {**values, "tau": tau["low"]})["values"] != best["values"]


def test_every_cause_that_the_campaign_shows_can_be_tried(learned: Workbench) -> None:
    candidates = answer(learned.findings.learned)["candidates"]
    for candidate in candidates[:: max(1, len(candidates) // 40)]:
        tried = learned.findings.tried(candidate["spec"], None)
        assert np.isfinite(tried["rms"]), candidate
        assert all(s["low"] < s["high"] for s in tried["sliders"]), candidate


@pytest.mark.parametrize("values", [{}, {"c": 1.0}, {"b": 1.0, "c": 1.0}])
def test_values_of_other_parameters_are_refused(
    learned: Workbench, values: dict[str, float]
) -> None:
    with pytest.raises(InputError, match="a number for each parameter"):
        learned.findings.tried(PLAY, values)


def test_causes_that_are_none_are_refused(learned: Workbench) -> None:
    with pytest.raises(InputError, match="none of the causes"):
        learned.findings.tried("backlash axis=W", None)


def test_versions_are_new_files_beside_what_is_there(campaign: Path, tmp_path: Path) -> None:
    folder = tmp_path / "kept" / "versions"
    folder.mkdir(parents=True)
    (folder / "model-2.toml").write_text("mine")
    (folder / "model-3.toml").write_text("")
    given = MODEL.read_bytes()
    held = BRIDGE / "check.csv"
    bench = idle(Workbench(MODEL, [campaign], [held], folder))
    assert bench.watched()["go_back"] == [0]
    bench.add(PLAY)
    idle(bench)
    assert (folder / "model-2.toml").read_text() == "mine"
    assert (folder / "model-3.toml").read_text() == ""
    assert MODEL.read_bytes() == given
    made = folder / "model-4.toml"
    out = tmp_path / "by-command.toml"
    keys = ("--campaign", campaign, "--holdout", held, "-o", out)
    said = command("add", MODEL, *PLAY.split(), *keys)
    one, other = load_model(made), load_model(out)
    assert {t.effect.spec: t.values for t in one.terms} == {
        t.effect.spec: t.values for t in other.terms
    }
    page = bench.watched()
    assert page["current"] == 1
    assert [c["figure"]["data"][0]["y"] for c in page["courses"]] == [
        pytest.approx([said["rms_before"], said["rms_after"]]),
        pytest.approx([said["holdout_before"], said["holdout_after"]]),
    ]
    # each against its own noise floor
    floors = [c["figure"]["data"][1]["y"][0] for c in page["courses"]]
    assert floors[0] == pytest.approx(said["noise_floor"])
    assert floors[1] != floors[0]

    bench.go_back(0)
    idle(bench)
    assert bench.state()["version"] == "model.toml"
    assert "Z stands" in answer(bench.findings.compared)["title"]
    bench.fit()
    idle(bench)
    assert sorted(p.name for p in folder.glob("*.toml")) == [
        f"model-{k}.toml" for k in (2, 3, 4, 5)
    ]
    # another session finds what this one left
    bench.close()
    again = idle(Workbench(MODEL, [campaign], [], folder))
    assert again.watched()["go_back"] == [0, 1, 2]


def test_a_failed_fit_leaves_no_file(campaign: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty.toml"
    text = MODEL.read_text().partition("[[effects]]")[0]
    empty.write_text(text)
    bench = idle(Workbench(empty, [campaign], [], tmp_path / "versions"))
    bench.fit()
    pause = threading.Event()
    while bench.state()["task"] is not None:
        pause.wait(0.02)
    assert "nothing to fit" in bench.state()["error"]
    assert list((tmp_path / "versions").glob("*.toml")) == []


def test_one_thing_at_a_time(campaign: Path, tmp_path: Path) -> None:
    bench = idle(Workbench(MODEL, [campaign], [], tmp_path / "versions"))
    bench.add(PLAY)
    for ask in (bench.compare, bench.fit, bench.learn, lambda: bench.go_back(0)):
        with pytest.raises(InputError, match="under way"):
            ask()
    idle(bench)


def test_without_a_folder_nothing_is_written(campaign: Path) -> None:
    bench = idle(Workbench(MODEL, [campaign]))
    for ask in (bench.fit, lambda: bench.add(PLAY)):
        with pytest.raises(InputError, match="no folder for versions"):
            ask()


def test_a_folder_that_is_a_file(campaign: Path, tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(InputError, match="no folder for versions"):
        Workbench(MODEL, [campaign], [], tmp_path / "taken")


def test_the_head_names_machine_and_files(learned: Workbench, campaign: Path) -> None:
    head = learned.head()
    assert head["machine"] == "held-out"
    assert {name for name, _ in head["facts"]} >= {"Date", "Machine", "Serial number"}
    assert {file for _, file, _ in head["files"]} == {"model.toml", campaign.name}
    assert all(len(sha) == 64 for _, _, sha in head["files"])


def test_what_is_opened_is_told_from_the_files(campaign: Path, tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text('format = "abbe-config/1"\nmodel = "m/model.toml"\n')
    model, near = tmp_path / "m" / "model.toml", (tmp_path,)
    assert what_to_open(None, []) == WhatToOpen(None, None)
    # campaigns may come later: dropped, or measured meanwhile
    assert what_to_open(config, []) == WhatToOpen(config, model, near=near)
    assert what_to_open(config, [campaign]) == WhatToOpen(config, model, near=near)
    assert what_to_open(MODEL, [campaign]) == WhatToOpen(None, MODEL, near=(MODEL.parent,))
    assert what_to_open(MODEL, []) == WhatToOpen(None, MODEL, near=(MODEL.parent,))
    config.write_text('format = "abbe-config/1"\n')
    assert what_to_open(config, []) == WhatToOpen(config, None, near=near)
    with pytest.raises(InputError, match="names no model"):
        what_to_open(config, [campaign])
    with pytest.raises(InputError, match="needs campaigns"):
        what_to_open(config, [], [campaign])
    with pytest.raises(InputError, match="needs a model"):
        what_to_open(None, [], [], tmp_path)
    with pytest.raises(InputError):
        what_to_open(tmp_path / "missing.toml", [])


def test_compare_waits_until_somebody_looks(campaign: Path) -> None:
    bench = Workbench(MODEL, [campaign], at_once=False)
    assert bench.state()["task"] is None
    assert bench.findings.compared is None
    bench.look()
    bench.look()
    assert answer(idle(bench).findings.compared)["title"]


def test_learn_shows_a_curve_by_its_largest_deviation(tmp_path: Path) -> None:
    """Coefficients of a spline trade with each other: alone each was ± 71 µm."""
    lines = ['# format = "abbe-campaign/1"', "time,setup,kind,X,X_dir,ux,uy,uz,value,sd"]
    noise = np.random.default_rng(3)
    for i, x in enumerate(np.tile(np.linspace(0.0, 300.0, 16), 4)):
        value = 9.0 * np.sin(x / 30.0) * np.exp(-x / 200.0) + noise.normal(0.0, 0.3)
        lines.append(f"{20 * i},x,displacement,{x},1,1,0,0,{value:.3f},0.3")
    (tmp_path / "c.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "m.toml").write_text(
        'format = "abbe-model/1"\n[machine]\nname = "slit"\nstructure = "w b X t"\n'
        "[machine.axes.X]\ntravel = [0, 300]\n"
    )
    bench = idle(Workbench(tmp_path / "m.toml", [tmp_path / "c.csv"]))
    bench.learn()
    found = answer(idle(bench).findings.learned)
    curves = [c for c in found["causes"] if c["spec"].startswith("positioning axis=X")]
    assert curves, [c["spec"] for c in found["causes"]]
    for cause in curves:
        name, largest, _, what = cause["parameters"][0]
        assert name.startswith("c1 … c")
        assert 4.0 < float(largest.removesuffix(" µm")) < 12.0
        assert what == "the curve's largest deviation where it was measured"
