"""Ball bar and plate as figures of a check: their ranges by hand, before and after."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

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
