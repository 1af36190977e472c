"""What a check says without a tolerance: verified, not verified, worse; and that each can come."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.daemon.command_line import abbe
from tests.support.daemon.verified_line import SCALE, fitted, written

NOISE = (0.2, -0.1, 0.0, 0.1, -0.2, 0.1, 0.0, -0.1, 0.2, -0.2, 0.1, 0.0)


def line(setup: str, scale: float, *, more: float = 0.0) -> str:
    """A line along X at a Y that was not fitted, two runs each way; `more` µm at its end."""
    rows = []
    for _ in range(2):
        for sense in (1, -1):
            for i in range(3)[::sense]:
                x = 20.0 + 100.0 * i
                k = len(rows)
                value = scale * 1e-3 * x + more * (i == 2) + NOISE[k]
                rows.append(f"{10 * k},{setup},displacement,{x},120,-100,{sense},1,0,0,{value},0.3")
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize(
    ("lines", "outcome", "reason"),
    [
        ((("a", SCALE, 0.0),), "verified", "X a: E 40"),
        # as if a sign were turned between campaign and check
        ((("a", -SCALE, 0.0),), "worse", "X a: E 40"),
        # one line is better, one is worse
        ((("a", SCALE, 0.0), ("b", -0.5 * SCALE, 0.0)), "worse", "X b: E 20"),
        # better, but not by what the model says
        ((("a", SCALE, 15.0),), "not verified", "does not foretell a"),
    ],
)
def test_a_check_is_judged_beside_before_and_beside_what_was_foretold(
    tmp_path: Path, lines: tuple[tuple[str, float, float], ...], outcome: str, reason: str
) -> None:
    model = fitted(tmp_path)
    check = written(tmp_path / "check.csv", *(line(s, c, more=m) for s, c, m in lines))
    done = abbe("verify", model, check, "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)["verdict"]
    assert found["outcome"] == outcome, found
    assert reason in "; ".join(found["reasons"])
    said = abbe("verify", model, check)
    assert f"no tolerance is stated; {outcome}: " in said.out


def test_faces_touched_from_either_side_have_no_figure_and_are_judged_by_their_readings(
    tmp_path: Path,
) -> None:
    """Of a step gauge each face is touched from one side: seen *verified* without a number."""
    model = fitted(tmp_path)
    rows = [
        f"{i},a,displacement,{x},120,-100,{1 - 2 * (i % 2)},1,0,0,{SCALE * 1e-3 * x + NOISE[i]},0.3"
        for i, x in enumerate((20.0, 70.0, 120.0, 170.0, 220.0, 270.0))
    ]
    check = written(tmp_path / "check.csv", "\n".join(rows) + "\n")
    page = tmp_path / "certificate.html"
    done = abbe("verify", model, check, "--report", page)
    assert done.status == 0, done.err
    assert "verified: all readings: " in done.out
    assert "foretold  " not in done.out
    assert "all readings, rms, before" in page.read_text("utf-8")


def test_readings_that_were_fitted_verify_nothing(tmp_path: Path) -> None:
    model = fitted(tmp_path)
    done = abbe("verify", model, tmp_path / "fit.csv", "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)["verdict"]
    assert found["outcome"] == "not verified"
    assert "fitted to these very readings" in found["reasons"][0]


@pytest.mark.parametrize(
    ("more", "size", "outcome"),
    [(15.0, "5um", "worse"), (15.0, "60um", "not verified"), (0.0, "20um", "verified")],
)
def test_a_tolerance_decides_first(tmp_path: Path, more: float, size: str, outcome: str) -> None:
    model = fitted(tmp_path)
    check = written(tmp_path / "check.csv", line("a", SCALE, more=more))
    done = abbe("verify", model, check, "--json", "--tolerance", f"E={size}")
    assert json.loads(done.out)["verdict"]["outcome"] == outcome
