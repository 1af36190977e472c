"""The example package, installed by pip as a stranger would install it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples" / "abbe-effect-air-bearing"
MODEL = """
format = "abbe-model/1"
[machine]
name = "CMM on air"
structure = "w b Y X Z t"
[machine.axes.X]
travel = [0.0, 700.0]
[machine.axes.Y]
travel = [0.0, 900.0]
[machine.axes.Z]
travel = [-360.0, 0.0]
[machine.signals.p_supply]
unit = "bar"
role = "air"
[[effects]]
kind = "air_bearing_lift"
axis = "Y"
direction = "Z"
signal = "p_supply"
[effects.parameters.c]
value = 2.0
unit = "um/bar"
"""
PROPOSED = """
from abbe.compcore.effects import effect_kinds
from abbe.compcore.files.model_file import load_model
from abbe.compcore.campaign.coverage import Coverage
import sys
machine = load_model(sys.argv[1]).machine
coverage = Coverage(signals={"p_supply": (4.5, 5.5)})
found = effect_kinds()["air_bearing_lift"].candidates(machine, coverage)
print(next(iter(found)).spec)
"""


@pytest.fixture(scope="module")
def with_plugin(tmp_path_factory):
    """Run Python with the example installed beside Abbe; standard output, status, errors."""
    target = tmp_path_factory.mktemp("site")
    # a copy: building leaves files behind
    source = tmp_path_factory.mktemp("source")
    for path in EXAMPLE.iterdir():
        if path.is_file():
            (source / path.name).write_bytes(path.read_bytes())
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
         "--no-index", "--no-deps", "--no-build-isolation", "--target", target, source],
        check=True,
        capture_output=True,
        timeout=100,
    )  # fmt: skip
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(target), str(ROOT)])}

    def run(*arguments: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, *map(str, arguments)],
            env=environment,
            capture_output=True,
            text=True,
            timeout=100,
        )

    return run


def abbe(run, *arguments):
    return run("-c", "from abbe.daemon.cli import main; main()", *arguments)


pytestmark = pytest.mark.integration


def test_the_catalogue_has_one_more_page(with_plugin):
    done = abbe(with_plugin, "effects", "air_bearing_lift")
    assert done.returncode == 0, done.stderr
    assert "An air-bearing carriage floats higher" in done.stdout
    assert "Powell" in done.stdout
    listed = json.loads(abbe(with_plugin, "effects", "--json").stdout)["effects"]
    assert listed[-1]["kind"] == "air_bearing_lift"
    assert listed[-1]["chapter"] == "From plugin packages"


def test_it_corrects(with_plugin, tmp_path):
    model = tmp_path / "model.toml"
    model.write_text(MODEL)
    done = abbe(with_plugin, "correct", model, "X=100", "Y=200", "Z=-50", "p_supply=5.5", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["correction"] == pytest.approx({"X": 0.0, "Y": 0.0, "Z": 0.001})


def test_it_proposes_itself(with_plugin, tmp_path):
    model = tmp_path / "model.toml"
    model.write_text(MODEL)
    done = with_plugin("-c", PROPOSED, model)
    assert done.stdout.strip() == "air_bearing_lift axis=Y direction=Z signal=p_supply", done.stderr


def test_its_own_errors_are_reported_like_abbe_s(with_plugin, tmp_path):
    model = tmp_path / "model.toml"
    model.write_text(MODEL.replace('unit = "bar"', 'unit = "K"'))
    done = abbe(with_plugin, "correct", model, "X=1", "Y=2", "Z=3", "p_supply=5.5")
    assert done.returncode == 1
    assert "not a pressure: found 'K', expected bar" in done.stderr
    assert "Traceback" not in done.stderr
