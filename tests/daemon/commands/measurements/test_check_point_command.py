"""``abbe check-point``: a year of checks on the simulated bridge, typed readings, bad input."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from datetime import datetime
from pathlib import Path

import pytest

from abbe.drivers.simulated.bridge.checks import DAY, FIRST_DAY
from tests.support.daemon.checked_bridge import fitted_bridge, year
from tests.support.daemon.command_line import Done, abbe

pytestmark = pytest.mark.timeout(300)

WITHIN = {"crash": 3, "levelling": 3, "sensor": 30, "quill": 130}
"""What happens → checks within which it must be told."""
AT = 120
"""Checks before it happens."""
SIGNALS = [f"{name}=20.1" for name in ("T_x1", "T_x2", "T_y1", "T_y2", "T_z1", "T_z2")]


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> Path:
    return fitted_bridge(tmp_path_factory.mktemp("bridge"))


@pytest.fixture
def shop(model: Path, tmp_path: Path, monkeypatch) -> Path:
    """A folder with a name that needs quotes, and the model in it."""
    folder = tmp_path / "hall 3"
    folder.mkdir()
    shutil.copy(model, folder / "model.toml")
    monkeypatch.chdir(folder)
    return folder


def judged(*arguments: object) -> dict:
    done = abbe("check-point", *arguments, "--json")
    assert done.status == 0, done.err
    return json.loads(done.out)


def index(found: dict, key: str) -> int:
    """Which check of the year a moment is."""
    days = round((datetime.fromisoformat(found[key]).timestamp() - FIRST_DAY) / DAY)
    return days // 7 * 5 + days % 7


def test_a_sound_machine_is_not_accused_in_a_year(shop: Path) -> None:
    found = judged("model.toml", "--campaign", year(shop, "nothing"), "--lasting")
    assert (found["verdict"], found["checks"], found["alarm"]) == ("sound", 250, None)
    assert all(max(abs(s["ewma"]), s["cusum"]) < 1.0 for s in found["series"])
    # probing 0.4, the probe 0.5, the machine 0.3 µm
    assert all(0.5 < s["usual"] < 1.0 for s in found["series"])


@pytest.mark.one_in(2)
@pytest.mark.parametrize("what", ["crash", "levelling", "sensor", "quill"])
def test_what_happens_to_a_machine_is_told_within_so_many_checks(shop: Path, what) -> None:
    campaign = year(shop, what, checks=AT + WITHIN[what])
    found = judged("model.toml", "--campaign", campaign, "--lasting")
    assert found["verdict"] == "changed"
    alarm = found["alarm"]
    assert 1 <= index(alarm, "check") - AT + 1 <= WITHIN[what]
    told = alarm["patterns"][0]
    expected = {
        "crash": {("Y", "X")},
        "levelling": {("X", "Y"), ("Z", "X"), ("X", "Z"), ("Z", "Y")},
        "sensor": {("X", "X")},
        "quill": {("Z", "T_z1"), ("Z", "T_z2"), ("Z", "T_x1"), ("Z", "T_x2"), ("Z", "T_y1"),
                  ("Z", "T_y2"), ("Z", "T_amb")},
    }[what]  # fmt: skip
    assert (told["component"], told["along"]) in expected
    if what == "crash":
        assert alarm["course"] == "at once"
        assert index(alarm, "first_changed") == AT
        # 10 µrad are 10 µm per metre
        assert told["slope"] * 1e3 == pytest.approx(10.0, abs=3.0 * told["slope_sd"] * 1e3 + 0.3)
    elif what != "quill":
        assert alarm["course"] == ("at once" if what == "levelling" else "ever more")


def in_a_shell(command: str) -> str:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-ec", command],
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{command}\n{done.stderr}"
    return done.stdout


@pytest.mark.thorough
@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("what", "named"),
    [("crash", "squareness axes=Y,X"), ("levelling", "angular axis=Y about=Y")],
)
def test_the_printed_command_hands_the_rows_to_a_diagnosis(shop: Path, what, named) -> None:
    campaign = year(shop, what, checks=AT + 5)
    done = abbe("check-point", "model.toml", "--campaign", campaign, "--lasting")
    assert done.status == 0, done.err
    assert done.out.startswith("THE MACHINE HAS CHANGED between the checks of ")
    (command,) = [
        line.removeprefix("next: ") for line in done.out.splitlines() if line.startswith("next: ")
    ]
    assert command == (
        "abbe check-point model.toml --changed changed.csv && abbe diagnose model.toml changed.csv"
    )
    told = in_a_shell(command)
    assert "changed: the model as it was given does not hold" in told
    assert re.search(rf"{re.escape(named)} .*changed (since|\(against the model of) 20\d\d-", told)
    # the rows as they stand, for whoever wants to see what is handed over
    assert "# free = []" in (shop / "changed.csv").read_text("utf-8")


@pytest.mark.thorough
def test_the_printed_command_with_every_option(shop: Path) -> None:
    campaign = year(shop, "crash", checks=AT + 3)
    kept = shop / "my checks.csv"
    done = abbe(
        "check-point", shop / "model.toml", "--campaign", campaign, "--lasting",
        "--checks", kept, "--since", "2026-01-01 06:00", "--report", "page.html",
    )  # fmt: skip
    assert done.status == 0, done.err
    (command,) = [x[6:] for x in done.out.splitlines() if x.startswith("next: ")]
    assert re.search(r" changed (since|\(against the model of) 20\d\d-", in_a_shell(command))
    page = (shop / "page.html").read_text("utf-8")
    assert "THE MACHINE HAS CHANGED" in page
    assert "CUSUM" in page


def typed(*arguments: object) -> Done:
    return abbe("check-point", "model.toml", *arguments)


def test_a_sphere_is_typed_day_by_day(shop: Path) -> None:
    for day in range(3):
        at = f"80.000{day},99.9990,-300.0010"
        done = typed(
            "ball", f"found={at}", "tool=0,0,-150", "sd=0.5", *SIGNALS, f"when=2026-02-0{day + 1}"
        )
        assert done.status == 0, done.err
    assert done.out.startswith("NOTHING HAS CHANGED: 3 checks since 2026-02-01 00:00")
    assert "is known after 17 more" in done.out
    rows = (shop / "checks.csv").read_text("utf-8").splitlines()
    header = next(k for k, line in enumerate(rows) if line.startswith("time,"))
    values = [
        line.split(",")[rows[header].split(",").index("value")] for line in rows[header + 1 :]
    ]
    # error = where it is − where it was found; it is where it was found first
    assert [float(v) for v in values[::3]] == pytest.approx([0.0, -0.1, -0.2], abs=1e-6)
    found = judged("model.toml")
    assert [s["name"] for s in found["series"]] == ["ball_X", "ball_Y", "ball_Z"]
    assert [s["readings"] for s in found["series"]] == [3, 3, 3]
    assert found["series"][0]["beyond_prediction"] is None


def test_an_artefact_that_is_calibrated_is_held_against_the_prediction(shop: Path) -> None:
    at = ["X=600", "Y=700", "Z=-100", "tool=0,0,-150"]
    asked = json.loads(abbe("correct", "model.toml", *at, *SIGNALS, "--json").out)
    error = asked["correction"]["X"] * 1e3
    done = typed("block", *at, "u=X", f"value={error + 20.0}", "sd=0.5", *SIGNALS, "--json")
    assert done.status == 0, done.err
    (series,) = json.loads(done.out)["series"]
    assert series["beyond_prediction"] == pytest.approx(20.0, abs=0.01)
    # what the fit left over counts beside the reading and the parameters
    assert 0.6 < series["beyond_prediction_sd"] < 1.5


def test_what_was_read_while_abbe_corrected_is_put_back(shop: Path) -> None:
    at = ["X=600", "Y=700", "Z=-100", "tool=0,0,-150", *SIGNALS]
    done = typed("block", *at, "u=X", "value=0.3", "sd=0.5", "--active", "model.toml", "--json")
    assert done.status == 0, done.err
    (series,) = json.loads(done.out)["series"]
    assert series["beyond_prediction"] == pytest.approx(0.3, abs=0.01)


def test_a_sphere_that_was_found_while_abbe_corrected_is_put_back(shop: Path) -> None:
    """Corrected or not, on whichever day: it is the same sphere in the same place."""
    at = (600.0, 700.0, -100.0)
    where = dict(zip("XYZ", at, strict=True))
    words = [f"{a}={q}" for a, q in where.items()]
    asked = json.loads(
        abbe("correct", "model.toml", *words, "tool=0,0,-150", *SIGNALS, "--json").out
    )
    corrected = ",".join(f"{q + asked['correction'][a]:.6f}" for a, q in where.items())
    more = ["tool=0,0,-150", "sd=0.5", *SIGNALS]
    said = [
        typed("ball", f"found={corrected}", *more, "when=2026-02-01", "--active", "model.toml"),
        typed("ball", f"found={','.join(map(str, at))}", *more, "when=2026-02-02"),
        typed("ball", f"found={corrected}", *more, "when=2026-02-03", "--active", "model.toml"),
    ]
    assert [done.status for done in said] == [0, 0, 0], said[0].err
    rows = (shop / "checks.csv").read_text("utf-8").splitlines()
    header = next(k for k, line in enumerate(rows) if line.startswith("time,"))
    names = rows[header].split(",")
    cells = [dict(zip(names, line.split(","), strict=True)) for line in rows[header + 1 :]]
    assert [float(c["value"]) for c in cells] == pytest.approx([0.0] * 9, abs=0.01)
    for axis, q in where.items():
        assert [float(c[axis]) for c in cells] == pytest.approx([q] * 9, abs=1e-5)


def test_a_wild_reading_asks_to_be_repeated(shop: Path) -> None:
    campaign = year(shop, "nothing", checks=60)
    text = campaign.read_text("utf-8").splitlines()
    cells = text[-12].split(",")
    at = next(x for x in text if x.startswith("time,")).split(",").index("value")
    cells[at] = str(float(cells[at]) + 40.0)
    text[-12] = ",".join(cells)
    campaign.write_text("\n".join(text) + "\n", "utf-8")
    done = typed("--campaign", campaign, "--lasting")
    assert done.out.startswith("NOTHING HAS CHANGED")
    assert "sphere1_X: +40" in done.out.replace("+39", "+40").replace("+41", "+40")
    assert "Measure it again" in done.out


def test_lasers_are_placed_anew_for_each_campaign(shop: Path) -> None:
    line = shop / "line.csv"
    names = ("T_x1", "T_x2", "T_y1", "T_y2", "T_z1", "T_z2")
    rows = [
        '# format = "abbe-campaign/1"',
        "time,setup,kind,X,Y,Z,ux,uy,uz,value,sd," + ",".join(names),
        *(f"{60 * k},x,displacement,{100 * k},450,-180,1,0,0,{0.1 * k},0.3" + 6 * ",20.1"
          for k in range(6)),
    ]  # fmt: skip
    line.write_text("\n".join(rows) + "\n", "utf-8")
    for day in (1, 2):
        done = typed("--campaign", line, "--when", f"2026-02-0{day} 08:00")
        assert done.status == 0, done.err
    kept = (shop / "checks.csv").read_text("utf-8")
    assert '[setups."x@2026-02-01T08:00:00"]' in kept
    assert '[setups."x@2026-02-02T08:00:00"]' in kept
    found = judged("model.toml")
    assert found["checks"] == 2
    assert [s["readings"] for s in found["series"]] == [2] * 6


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["ball"], "either a place or an error is read"),
        (["found=1,2,3"], "the check has no name"),
        (["ball", "found=1,2"], "not three numbers"),
        (["ball", "found=1,2,3", "X=4"], "where the sphere was found is where the axes stood"),
        (["ball", "found=1,2,3", "value=1", "u=X"], "either a place or an error"),
        (["ball", "value=1"], "value= goes with u="),
        (["ball", "value=1", "u=Q", "X=1", "Y=1", "Z=-1"], "not a direction"),
        (["ball", "value=1", "u=X", "X=1", "Z=-1"], "no position given for Y"),
        (["ball", "found=1,2,-3"], "T_x1"),
        (["ball", "found=1,2,-3", *SIGNALS, "sd=-1"], "sd"),
        (["ball", "found=1,2,-3", *SIGNALS, "when=noon"], "not a moment"),
        (["ball", "found=1,2,-3", *SIGNALS, "kind=rotation"], "what is read"),
        (["--when", "now"], "--when goes with --campaign"),
        (["--lasting"], "--lasting goes with --campaign"),
        (["--active", "model.toml"], "--active goes with a reading"),
        (["ball", "found=1,2,-3", "--campaign", "model.toml"], "typed, or read"),
        ([], "no check was recorded yet"),
    ],
)
def test_what_cannot_be_recorded(shop: Path, arguments, said) -> None:
    done = typed(*arguments)
    assert done.status == 1
    assert said in done.err
    assert "Traceback" not in done.err
    assert not (shop / "checks.csv").exists()


def test_nothing_is_recorded_twice_or_for_another_machine(shop: Path) -> None:
    campaign = year(shop, "nothing", checks=3)
    assert typed("--campaign", campaign, "--lasting").status == 0
    before = (shop / "checks.csv").read_bytes()
    twice = typed("--campaign", campaign, "--lasting")
    assert (twice.status, "there already" in twice.err) == (1, True)
    fewer = typed("ball", "found=80,100,-300", "sd=1", *SIGNALS[:-1])
    assert (fewer.status, "T_z2" in fewer.err) == (1, True)
    other = shop / "other.toml"
    other.write_text((shop / "model.toml").read_text().replace("Bridge CMM", "Mill"), "utf-8")
    foreign = abbe("check-point", other)
    # the campaign calls itself so; the file is the simulated bridge's
    assert (foreign.status, "another machine" in foreign.err) == (1, True)
    assert (shop / "checks.csv").read_bytes() == before


def test_checks_before_the_fit_do_not_count(shop: Path) -> None:
    campaign = year(shop, "nothing", checks=10)
    assert typed("--campaign", campaign, "--lasting").status == 0
    later = judged("model.toml", "--since", "2026-01-12")
    assert later["checks"] == 5
    none = typed("--since", "2027-01-01")
    assert (none.status, "older" in none.err) == (1, True)
    nothing = typed("--changed", "changed.csv")
    assert (nothing.status, "nothing has changed" in nothing.err) == (1, True)
    assert not (shop / "changed.csv").exists()
