"""Ball bar and plate as figures of a check: their ranges by hand, before and after."""

from __future__ import annotations

import json
import math
from html import unescape
from pathlib import Path
from typing import Any

import pytest

from abbe.compcore.verification.verdict import VerdictOutcome, check_verdict
from abbe.daemon.answers.measurements.verified_files import (
    VerifiedFiles,
    fitted_campaigns,
    named_model,
)
from abbe.daemon.commands.measurements.verify import judge
from tests.support.daemon.command_line import abbe
from tests.support.daemon.verified_line import HEAD, SCALE, fitted

NOISE = (0.2, -0.1, 0.0, 0.1, -0.2, 0.1, 0.0, -0.1)
RADIUS = 100.0
TURNED = 16


def ball_bar(path: Path, scale: float = SCALE, *, more: float = 0.0) -> Path:
    """A circle in X, Y whose radius changes by R·s·cos²φ; `more` µm at one of its readings."""
    rows = ["time,setup,kind,X,Y,Z,ux,uy,uz,base,value,sd"]
    for k in range(TURNED):
        phi = 2.0 * math.pi * k / TURNED
        x, y = 150.0 + RADIUS * math.cos(phi), 200.0 + RADIUS * math.sin(phi)
        # what is measured is the distance from where the centre's ball really stands
        true = math.hypot(RADIUS * math.cos(phi) * (1.0 + scale * 1e-6), RADIUS * math.sin(phi))
        value = true + (NOISE[k % 8] + more * (k == 3)) * 1e-3
        rows.append(f"{k},bar,distance,{x!r},{y!r},-100,,,,B,{value!r},0.0003")
    bases = "# [bases.B]\n# position = [150.0, 200.0, -100.0]\n"
    path.write_text(HEAD + bases + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def plate(path: Path) -> Path:
    """Balls at 0 to 200 mm along X in two rows, seen along X and Y; it lies anyhow."""
    rows = ["time,setup,kind,X,Y,Z,ux,uy,uz,value,sd"]
    for i in range(10):
        x, y = 50.0 * (i % 5), 100.0 + 150.0 * (i // 5)
        for u, error in (((1, 0, 0), SCALE * 1e-3 * x + 30.0), ((0, 1, 0), -12.0)):
            value = error + NOISE[i % 8]
            rows.append(f"{i},plate,displacement,{x},{y},-100,{u[0]},{u[1]},{u[2]},{value!r},0.3")
    setup = '# [setups.plate]\n# free = ["frame"]\n'
    path.write_text(HEAD + setup + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def test_ranges_before_and_after_are_those_by_hand(tmp_path: Path) -> None:
    model = fitted(tmp_path)
    bar, lying = ball_bar(tmp_path / "bar.csv"), plate(tmp_path / "plate.csv")
    page = tmp_path / "certificate.html"
    done = abbe("verify", model, bar, lying, "--json", "--report", page)
    assert done.status == 0, done.err
    found = json.loads(done.out)
    assert found["verdict"]["outcome"] == "verified", found["verdict"]
    by_name = {p["setup"]: p for p in found["placed"]}
    # R·s = 20 µm, 200 mm · s = 40 µm; noise to 0.4 µm
    assert by_name["bar"]["range_before"] == pytest.approx(20.0, abs=0.5)
    assert by_name["plate"]["range_before"] == pytest.approx(40.0, abs=0.5)
    for one in by_name.values():
        assert one["range_after"] < 0.6
        assert one["agrees"] is True
        assert one["U"] == pytest.approx(2.0 * math.sqrt(2.0) * 0.3, rel=0.01)
    assert "Other set-ups, before and after" in page.read_text("utf-8")
    said = abbe("verify", model, bar, lying)
    assert "distances from a base point" in said.out
    assert "as foretold" in said.out


@pytest.mark.parametrize(
    ("scale", "more", "outcome", "reason"),
    [
        (-SCALE, 0.0, "worse", "bar: range 19.60 ± 0.85 before, 39.60 "),
        (SCALE, 8.0, "not verified", "does not foretell bar"),
    ],
)
def test_a_ball_bar_can_fail(
    tmp_path: Path, scale: float, more: float, outcome: str, reason: str
) -> None:
    model = fitted(tmp_path)
    done = abbe("verify", model, ball_bar(tmp_path / "bar.csv", scale, more=more), "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)["verdict"]
    assert found["outcome"] == outcome, found
    assert reason in "; ".join(found["reasons"])


def test_a_circle_that_is_read_as_displacements_has_a_radial_range(tmp_path: Path) -> None:
    """As `abbe plan` plans a ball bar: four times round, each reading along its own radius."""
    model = fitted(tmp_path)
    rows = ["time,setup,kind,X,Y,Z,ux,uy,uz,value,sd"]
    for k in range(4 * TURNED):
        cos, sin = (f(2.0 * math.pi * k / TURNED) for f in (math.cos, math.sin))
        x, y = 150.0 + RADIUS * cos, 200.0 + RADIUS * sin
        value = RADIUS * SCALE * 1e-3 * cos * cos + NOISE[k % 8]
        rows.append(f"{k},bar,displacement,{x!r},{y!r},-100,{cos!r},{sin!r},0,{value!r},0.3")
    setup = '# [setups.bar]\n# free = ["zero", "frame"]\n'
    bar = tmp_path / "bar.csv"
    bar.write_text(HEAD + setup + "\n".join(rows) + "\n", encoding="utf-8")
    done = abbe("verify", model, bar, "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)
    (one,) = found["placed"]
    assert one["range_before"] == pytest.approx(20.0, abs=0.5)
    assert one["range_after"] < 0.6
    assert "no line was measured" in found["verdict"]["reasons"][-1]
    assert any("no line was measured" in w for w in found["warnings"])


def test_ranges_within_their_own_uncertainty_prove_nothing(tmp_path: Path) -> None:
    """Seen at a laser tracker of 10 µm: 22 ± 30 before, 18 ± 30 after was *verified*."""
    model = fitted(tmp_path)
    text = ball_bar(tmp_path / "bar.csv").read_text("utf-8")
    (tmp_path / "bar.csv").write_text(text.replace(",0.0003\n", ",0.01\n"), "utf-8")
    done = abbe("verify", model, tmp_path / "bar.csv", "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)["verdict"]
    assert found["outcome"] == "not verified"
    assert "unsure by is more than" in found["reasons"][0]


@pytest.mark.parametrize("why", ["", "what no set-up showed is not known"])
def test_a_doubt_about_what_was_found_is_in_the_verdict_and_in_the_certificate(
    tmp_path: Path, why: str
) -> None:
    """Of a calibration whose ranges are as foretold, where the model knows little of the rest."""
    named = named_model(fitted(tmp_path))
    files, page = VerifiedFiles((ball_bar(tmp_path / "bar.csv"),)), tmp_path / "page.html"
    done = judge(named, fitted_campaigns(named), files, (), None, page, doubt=lambda _: why)
    found = check_verdict(done.verification)
    assert found.outcome is (VerdictOutcome.OPEN if why else VerdictOutcome.VERIFIED)
    assert not why or found.reasons[0] == why
    assert (f"not verified: {why}" in unescape(page.read_text("utf-8"))) is bool(why)


U_RANGE = 2.0 * math.sqrt(2.0) * 0.3
"""µm: two readings of 0.3 µm, k = 2."""


def judged(folder: Path, *words: object) -> tuple[dict[str, Any], int]:
    """A ball bar before and after, measured both times, against what is stated."""
    model = fitted(folder)
    (folder / "later").mkdir()
    before, after = ball_bar(folder / "bar.csv"), ball_bar(folder / "later" / "bar.csv", SCALE / 2)
    done = abbe("verify", model, after, "--before", before, *words, "--json")
    return json.loads(done.out), done.status


@pytest.mark.parametrize(
    ("more", "outcome", "status"),
    [
        (0.01, "passes", 0),
        (-0.01, "neither", 4),
        (0.01 - 2.0 * U_RANGE, "neither", 4),
        (-2.0 * U_RANGE - 0.01, "fails", 3),
    ],
)
def test_a_range_against_its_tolerance_before_and_after(
    tmp_path: Path, more: float, outcome: str, status: int
) -> None:
    """The guard band on either side; before, 20 µm, it fails; both on the certificate."""
    plain, _ = judged(tmp_path)
    (one,) = plain["placed"]
    assert one["range_before"] == pytest.approx(20.0, abs=0.5)
    assert one["agrees"] is True
    assert one["range_after"] == pytest.approx(10.0, abs=0.5)
    limit = one["range_after"] + U_RANGE + more
    page = tmp_path / "certificate.html"
    for stated in (f"range={limit:.5f}um", f"bar.range={limit:.5f}um"):
        again = tmp_path / stated.partition("=")[0]
        again.mkdir()
        found, code = judged(again, "--tolerance", stated, "--report", page, "--force")
        assert (found["outcome"], code) == (outcome, status)
        (held,) = found["tolerances"]
        assert held["U"] == pytest.approx(U_RANGE)
        assert held["value"] == pytest.approx(one["range_after"])
        assert held["before"]["value"] == pytest.approx(one["range_before"])
        assert held["before"]["outcome"] == "fails"
    text = page.read_text("utf-8")
    assert "Before ± U</th>" in text
    assert f"{one['range_before']:.2f} ± 0.85" in text


@pytest.mark.parametrize(
    ("stated", "says"),
    [
        ("other.range=9um", "one of bar (range)"),
        ("A=9um", "one of bar (range)"),
        ("range=9urad", "one of bar (range)"),
        ("range=9", "needs its unit"),
        ("spread=9um", "not a tolerance"),
    ],
)
def test_a_tolerance_that_no_range_has_is_refused(tmp_path: Path, stated: str, says: str) -> None:
    model = fitted(tmp_path)
    done = abbe("verify", model, ball_bar(tmp_path / "bar.csv"), "--tolerance", stated)
    assert done.status == 1
    assert says in done.err


def test_a_set_up_that_nobody_measured_before_has_no_state_before(tmp_path: Path) -> None:
    model = fitted(tmp_path)
    bar = ball_bar(tmp_path / "bar.csv", 0.0)
    done = abbe("verify", model, bar, "--before", plate(tmp_path / "plate.csv"), "--json",
                "--report", tmp_path / "page.html", "--tolerance", "range=9um")  # fmt: skip
    assert done.status == 0, done.err
    found = json.loads(done.out)
    (one,) = found["placed"]
    assert one["range_before"] is None
    assert one["agrees"] is None
    assert one["range_after"] < 0.6
    assert found["tolerances"][0]["before"] is None
    assert found["verdict"]["outcome"] == "not verified"
