"""A machine that lost its squareness, checked by a short campaign: the rest is not forgotten."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.files.model_file import load_model
from tests.support.daemon.command_line import abbe

DATA = Path(__file__).parents[3] / "data" / "p02-bridge"
SPEC = "squareness axes=Y,X"
LOST = 50e-6


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The acceptance, and a check after the crash: lines and diagonals of one morning.

    A crash turns X on Y about Z: at X the point stands 50 µrad times X further along Y.
    """
    folder = tmp_path_factory.mktemp("crashed")
    assert abbe("fit", DATA / "model.toml", DATA / "fit.csv", "-o", folder / "was.toml").status == 0
    lines = (DATA / "check.csv").read_text(encoding="utf-8").splitlines()
    top = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    value, x, along_y = map(lines[top].split(",").index, ("value", "X", "uy"))
    kept = []
    for line in lines[top + 1 :]:
        cells = line.split(",")
        if cells[1].startswith("c0_"):
            lost = LOST * float(cells[x]) * float(cells[along_y]) * 1e3
            cells[value] = f"{float(cells[value]) + lost:.4f}"
            kept.append(",".join(cells))
    (folder / "check.csv").write_text("\n".join([*lines[: top + 1], *kept]) + "\n")
    return folder


def _sds(path: Path) -> dict[str, float]:
    model = load_model(path)
    assert model.covariance is not None
    sd = iter(np.sqrt(np.diag(model.covariance)))
    return {f"{t.effect.spec} {n}": float(next(sd)) for t in model.terms for n in t.values}


def test_the_printed_line_keeps_what_holds(shop: Path) -> None:
    said = abbe("diagnose", shop / "was.toml", shop / "check.csv", "--no-measure-next").out
    assert f"{SPEC} changed" in said
    (line,) = re.findall(r"the new values: .*?: (abbe fit .*)", said)
    assert line.endswith("--renew")
    words = shlex.split(line)
    done = abbe(*words[1:])
    assert done.status == 0, done.err
    assert f"fitted anew, as it has changed: {SPEC}" in done.out
    renewed = Path(words[words.index("-o") + 1])
    alone = shop / "alone.toml"
    forgetting = abbe("fit", shop / "was.toml", shop / "check.csv", "-o", alone)
    assert forgetting.status == 0
    assert "FORGOTTEN: other campaigns showed more than this one does (" in forgetting.out
    assert "FORGOTTEN" not in done.out
    surer = [_sds(renewed)[name] < 0.5 * sd for name, sd in _sds(alone).items()]
    assert np.mean(surer) > 0.3
    was, now = (
        next(t.values["angle"] for t in load_model(p).terms if t.effect.spec == SPEC)
        for p in (shop / "was.toml", renewed)
    )
    assert abs(abs(now.value - was.value) - LOST) < 3e-6
    # once more it counts once; beside another campaign's rows it would count twice
    more = abbe("fit", renewed, shop / "check.csv", "--renew", "-o", shop / "again.toml")
    assert more.status == 0, more.err
    both = abbe(
        "fit", renewed, shop / "check.csv", DATA / "fit.csv", "--renew", "-o", shop / "b.toml"
    )
    assert (both.status, both.out) == (1, "")
    assert "would count twice" in both.err


def test_the_way_to_the_verdict_keeps_it_too(shop: Path) -> None:
    out = shop / "applied.toml"
    done = abbe(
        "diagnose", shop / "was.toml", shop / "check.csv", "--apply", "-o", out, "--json",
        "--no-measure-next",
    )  # fmt: skip
    steps = json.loads(done.out)["steps"]
    assert steps[-1]["action"] == "kept from before"
    assert load_model(out).fit["renewed"]["fitted_anew"] == [SPEC]


def test_what_cannot_be_renewed_is_refused(shop: Path) -> None:
    for more, words in (
        (["--cautious"], "--renew keeps the values and the frame"),
        (["--frame", "X,Y"], "--renew keeps the values and the frame"),
    ):
        done = abbe(
            "fit", shop / "was.toml", shop / "check.csv", "--renew", *more, "-o", shop / "n.toml"
        )
        assert (done.status, done.out) == (1, "")
        assert words in done.err
    done = abbe("fit", DATA / "model.toml", shop / "check.csv", "--renew", "-o", shop / "n.toml")
    assert done.status == 1
    assert "no values with their covariance" in done.err
    assert not (shop / "n.toml").exists()
