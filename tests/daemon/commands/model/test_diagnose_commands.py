"""abbe diagnose, add, remove, history: the loop that users came for, as they type it."""

from __future__ import annotations

import json
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from abbe.compcore.diagnosis import advice
from abbe.daemon.application import app
from abbe.daemon.arguments.lists import spread
from benchmarks.hidden.scenario import Scenario, hide
from benchmarks.hidden.scenes.scene import scene
from tests.support.daemon.some_setups import some_setups

DATA = Path(__file__).parents[3] / "data" / "p01-mill"
SPEC = ["thermal_tilt", "axis=Y", "about=X", "signals=T_col_front,T_col_rear"]


def test_the_loop(tmp_path: Path) -> None:
    runner = CliRunner()
    model, fitted, check = DATA / "model.toml", DATA / "fit.csv", DATA / "check.csv"
    done = runner.invoke(app, ["diagnose", str(model), str(fitted), "--json"])
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert answer["verdict"] == "missing"
    best = answer["candidates"][0]
    assert best["spec"].split(" ") == SPEC
    assert best["scope"] == "machine"
    assert best["parameters"]["k"]["plausible"] is True
    assert {
        "rms_after",
        "p_value",
        "cross_validated_gain",
        "confusable_with",
        "explanation",
    } <= set(best)
    assert answer["rms"] > best["rms_after"]
    assert {"what", "separates", "separation"} <= set(answer["measure_next"][0])

    version = tmp_path / "v1.toml"
    campaigns = ["--campaign", str(fitted), "--holdout", str(check), "-o", str(version)]
    done = runner.invoke(app, ["add", str(model), *best["spec"].split(" "), *campaigns, "--json"])
    assert done.exit_code == 0, done.output
    added = json.loads(done.stdout)
    assert added["rms_after"] < added["rms_before"]
    assert added["holdout_after"] < 0.95 * added["holdout_before"]
    assert added["parameters"]["k"]["sd"] > 0.0
    assert tomllib.loads(version.read_text())["fit"]["added"] == " ".join(SPEC)

    again = tmp_path / "v2.toml"
    done = runner.invoke(app, ["remove", str(version), "thermal_tilt", "-o", str(again)])
    assert done.exit_code == 0, done.output
    assert "thermal_tilt" not in [e["kind"] for e in tomllib.loads(again.read_text())["effects"]]
    done = runner.invoke(app, ["history", str(again), "--json"])
    versions = json.loads(done.stdout)["versions"]
    first, second, third = versions
    assert first["rms"] == pytest.approx(added["rms_before"])
    assert first["holdout_rms"] == pytest.approx(added["holdout_before"])
    assert second["rms"] == pytest.approx(added["rms_after"])
    assert second["holdout_rms"] == pytest.approx(added["holdout_after"])
    assert [Path(entry["file"]).name for entry in second["holdout"]] == ["check.csv"]
    assert second["added"] == " ".join(SPEC)
    assert third["removed"] == " ".join(SPEC)


def test_what_to_measure_next_is_worked_out_once_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []
    worked_out = advice._advise

    def counted(*arguments: Any, **more: Any) -> list[advice.Advice]:
        calls.append("advised")
        return worked_out(*arguments, **more)

    monkeypatch.setattr(advice, "_advise", counted)
    campaign, page = some_setups(DATA / "fit.csv", tmp_path / "some.csv", every=4), tmp_path / "p"
    command = ["diagnose", str(DATA / "model.toml"), str(campaign), "--json", "--report", str(page)]
    runner = CliRunner()
    whole = json.loads(runner.invoke(app, [*command, "--force"]).stdout)
    assert calls == ["advised"]
    assert whole["measure_next"]
    less = json.loads(runner.invoke(app, [*command, "--force", "--no-measure-next"]).stdout)
    assert calls == ["advised"]
    assert less == {**whole, "measure_next": []}


def test_an_offered_formula_is_added_as_it_is_printed(tmp_path: Path) -> None:
    """Typed in a shell, or as one word in quotes as in the JSON."""
    scenario = Scenario("mill", 120, ("saddle of two positions",), 6)
    stage = scene(scenario.seed, scenario.kind)
    model, fitted = tmp_path / "model.toml", tmp_path / "fit.csv"
    model.write_text(stage.model_text(), encoding="utf-8")
    simulated = stage.simulate(hide(scenario, stage))
    fitted.write_text(simulated.text, encoding="utf-8")
    runner = CliRunner()
    said = runner.invoke(app, ["diagnose", str(model), str(fitted)])
    assert said.exit_code == 0, said.output
    assert "unexplained" in said.stdout
    printed = next(part for part in said.stdout.splitlines() if "abbe add " in part)
    command = shlex.split(printed.partition("abbe ")[2])
    assert command[:2] == ["add", str(model)]
    words = command[2 : command.index("--campaign")]
    assert words[0] == "formula"
    assert "(" in words[2]
    whole = runner.invoke(app, command)
    assert whole.exit_code == 0, whole.output
    assert (tmp_path / "model-2.toml").exists()
    for i, spec in enumerate((words, [" ".join(words)])):
        out = tmp_path / f"{i}.toml"
        more = ["--campaign", str(fitted), "-o", str(out), "--json"]
        done = runner.invoke(app, ["add", str(model), *spec, *more])
        assert done.exit_code == 0, done.output
        added = json.loads(done.stdout)
        assert added["rms_after"] < 0.75 * added["rms_before"]


def test_an_effect_that_is_there_already_is_refused(tmp_path: Path) -> None:
    done = CliRunner().invoke(
        app,
        [
            "add",
            str(DATA / "model.toml"),
            "squareness",
            "axes=X,Y",
            "--campaign",
            str(DATA / "fit.csv"),
            "-o",
            str(tmp_path / "out.toml"),
        ],
    )
    assert done.exit_code != 0
    assert "already" in str(done.exception)
    assert not (tmp_path / "out.toml").exists()


def test_an_option_may_take_several_files() -> None:
    assert spread(["M", "k", "--campaign", "a", "b", "--holdout", "c", "-o", "O"]) == [
        "M",
        "k",
        "--campaign",
        "a",
        "--campaign",
        "b",
        "--holdout",
        "c",
        "-o",
        "O",
    ]
    assert spread(["M", "--campaign", "a", "axis=X", "-o", "O"]) == [
        "M",
        "--campaign",
        "a",
        "axis=X",
        "-o",
        "O",
    ]
