"""The nudge before a set-up's first target, planned, driven, judged; rows that are taken back."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.files.campaign_csv.head import BEGUN
from abbe.compcore.files.growing_campaign import GrowingCampaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.plan_file import read_plan
from abbe.compcore.planning.motion import TURN, steps_of
from abbe.compcore.planning.nudge import nudge_of
from abbe.daemon.config.sections.measure import InstrumentSection, MeasureSection
from abbe.daemon.measure.following.afterwards import Afterwards
from abbe.daemon.measure.following.average import SteadyReading
from abbe.daemon.measure.following.doubtful import RepeatedTargets
from abbe.daemon.measure.following.instrument import Instrument
from abbe.daemon.measure.following.nudge import NudgeCheck
from abbe.drivers.programs.dialects import dialect_called
from tests.support.daemon.live_run import MODEL
from tests.support.daemon.measuring import line_plan, write_plan

BRIDGE = load_model(MODEL).machine
LASER = line_plan("x", "X", [50, 250])
ACROSS = line_plan("s", "X", [50, 250], instrument="straightness", u=(0.0, 0.0, 1.0),
                   free='["zero", "slope"]', sd=0.8)  # fmt: skip
BOTH = ACROSS.replace("[[[0.0, 0.0, 1.0]]]", "[[[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]]")


def work(folder: Path, *setups: str):
    path = write_plan(folder / "plan.toml", *setups)
    text = path.read_text("utf-8").replace("beyond = 2\n", "beyond = 2\nnudge = 0.05\n")
    path.write_text(text, "utf-8")
    return read_plan(path, BRIDGE)


def test_only_what_shows_a_move_across_its_line_is_nudged(tmp_path: Path) -> None:
    laser, across = work(tmp_path, LASER, ACROSS).setups
    assert nudge_of(BRIDGE, laser, 0.05) == {}
    assert nudge_of(BRIDGE, across, 0.05) == pytest.approx({"Z": 0.05})
    assert nudge_of(BRIDGE, across, 0.0) == {}
    (both,) = work(tmp_path, BOTH).setups
    # not the same along both: exchanged channels show
    assert nudge_of(BRIDGE, both, 0.05) == pytest.approx({"Z": 0.05, "Y": 0.03})


def test_the_program_comes_to_both_ends_from_one_side_and_stands_at_the_far_one(
    tmp_path: Path,
) -> None:
    found = work(tmp_path, ACROSS)
    steps = steps_of(BRIDGE, found.setups, found.space)
    first = next(k for k, s in enumerate(steps) if s.kind == "target")
    ways = [(dict(s.at), s.seconds) for s in steps[first - 4 : first]]
    stands = found.setups[0].instrument.reading
    assert ways == [
        ({"Z": pytest.approx(-180.05)}, TURN),
        ({"Z": pytest.approx(-179.95)}, stands),
        ({"Z": pytest.approx(-180.05)}, TURN),
        ({"Z": pytest.approx(-180.0)}, 0.0),
    ]
    # the line's own axis does not move: it still comes from the side that the plan says
    assert steps[first].at["X"] == pytest.approx(50.0)
    assert steps[first].directions == {"X": 1}


@pytest.mark.parametrize(
    ("shown", "words"),
    [
        (lambda moved, _: moved / 25.4, "inches"),
        (lambda moved, _: -moved, "sign is turned"),
        (lambda moved, _: 25.4 * moved, "another unit"),
        (lambda moved, _: 0.0 * moved, "late by seconds"),
        (lambda moved, _: 0.5 * moved, "late by seconds"),
        (lambda moved, _: moved[::-1], "late by seconds"),
    ],
)
def test_what_does_not_follow_is_named(tmp_path: Path, shown, words: str) -> None:
    check, setup, instrument = checked(tmp_path)
    judge(check, setup, instrument, shown, np.random.default_rng(1), 1e-4)
    assert words in check.problem
    assert not check.follows


@pytest.mark.thorough
def test_honest_instruments_are_never_accused(tmp_path: Path) -> None:
    """A servo that stands up to 3 µm off, 1 µm of scatter, a scale that is up to 5 % off."""
    rng = np.random.default_rng(2)
    check, setup, instrument = checked(tmp_path)
    for _ in range(5000):
        check.forget()
        scale = rng.uniform(0.95, 1.05)
        judge(check, setup, instrument, lambda m, by: by * m, rng, 1e-3, off=3e-3, by=scale)
        assert check.follows, check.problem


def checked(folder: Path):
    (setup,) = work(folder, BOTH).setups
    section = InstrumentSection(source=("a.b", "a.c"), reads="error")
    return NudgeCheck(BRIDGE, 0.05), setup, Instrument("dial", section, "mm")


def judge(check, setup, instrument, shown, rng, noise: float, off: float = 0.0, by: float = 1.0):
    """Stand at the far end and at the first target, as a machine and a read-out do."""
    line = {a: float(q[0]) for a, q in setup.targets.items()}

    def stand(z: float, y: float):
        z, y = z + rng.uniform(-off, off), y + rng.uniform(-off, off)
        place = line | {"Z": line["Z"] + z, "Y": line["Y"] + y}
        return place, tuple(shown(np.array([z, y]), by) + rng.normal(0.0, noise, 2))

    near, values = stand(-0.05, -0.03)
    assert check.turning(setup, near)
    assert not check.take_end(setup, 0, near, values)
    far, values = stand(0.05, 0.03)
    assert check.take_end(setup, 0, far, values)
    place, values = stand(0.0, 0.0)
    assert not check.turning(setup, place)
    check.judge(setup, 0, instrument, place, values)


def test_a_reading_that_changes_after_it_was_taken_is_noticed_and_scatter_is_not(
    tmp_path: Path,
) -> None:
    (setup,) = work(tmp_path, ACROSS).setups
    limits = MeasureSection()
    instrument = Instrument("dial", InstrumentSection(source="a.b", reads="error"), "mm")
    rng = np.random.default_rng(3)

    def after(change: float, noise: float) -> float:
        spread, count = noise, 40
        read = SteadyReading((rng.normal(0.0, noise / 40**0.5),), (spread,), (0.0,), count, (0.0,))
        one = Afterwards(limits)
        one.begin(read, 0.0)
        worst = 0.0
        for k in range(1, 160):
            instrument.time = 0.025 * k
            value = rng.normal(change if instrument.time > 2.0 else 0.0, noise)
            worst = max(worst, one.step(instrument.time, instrument, setup, 0, (value,), [0.0]))
        return worst

    assert max(after(0.0, noise) for noise in rng.uniform(0.0, 3e-3, 300)) == 0.0
    # a drift of less than twice the stated 0.8 µm is none
    assert after(1.2e-3, 1e-4) == 0.0
    assert after(4e-3, 1e-4) == pytest.approx(4e-3, rel=0.1)


def test_what_is_withdrawn_is_gone_from_the_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "campaign.csv"
    file = GrowingCampaign.begin(path, {BEGUN: {}}, ("time", "value"))
    file.append([{"time": 1.0, "value": 2.0}])
    kept = path.read_text("utf-8")
    file.append([{"time": 2.0, "value": 3.0}, {"time": 2.0, "value": 4.0}])
    file.withdraw()
    assert path.read_text("utf-8") == kept
    file.withdraw()
    assert path.read_text("utf-8") == kept
    file.append([{"time": 5.0, "value": 6.0}])
    file.close()
    assert path.read_text("utf-8") == kept + "5,6\n"


def test_a_repetition_that_is_withdrawn_leaves_no_trace() -> None:
    seen = RepeatedTargets()
    for target, value in enumerate((1.0, 2.0, 3.0)):
        seen.add(target, 1, (value,), float(target))
    seen.add(2, -1, (3.5,), 3.0)
    seen.add(1, -1, (9.0,), 4.0)
    seen.withdraw()
    seen.withdraw()
    assert seen.change(1, -1, (2.5,)) == pytest.approx(0.0)


@pytest.mark.skipif(shutil.which("rs274") is None, reason="needs LinuxCNC's interpreter")
def test_linuxcncs_own_interpreter_goes_there_and_back(tmp_path: Path) -> None:
    found = work(tmp_path, ACROSS)
    steps = steps_of(BRIDGE, found.setups, found.space)
    text = dialect_called("linuxcnc").text(steps, BRIDGE, "test", 3000.0)
    (tmp_path / "tool.tbl").touch()
    (tmp_path / "p.ngc").write_text(text, "ascii")
    done = subprocess.run(
        ["rs274", "-t", "tool.tbl", "-g", "p.ngc"],
        cwd=tmp_path, capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    ways = [m[1].split(",") for m in re.finditer(r"STRAIGHT_FEED\((.*)\)", done.stdout)]
    heights = [round(float(w[2]), 3) for w in ways if abs(float(w[0]) - 50.0) < 1e-6]
    assert heights[:5] == [-180.0, -180.05, -179.95, -180.05, -180.0]
