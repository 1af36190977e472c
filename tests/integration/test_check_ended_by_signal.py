"""A check ended by a signal, while it measures and while it is judged: the same command goes on."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.plan_file import read_plan
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon import gauge_measuring, plate_measuring
from tests.support.daemon.command_line import abbe
from tests.support.daemon.gauge_measuring import STEPS
from tests.support.daemon.verified_line import fitted, line, written

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
EFFECTS = '[[effects]]\nkind = "positioning"\naxis = "X"\nshape = "polynomial:1"\n'
CHECK = ("--instruments", "step-gauge", "--time", "20min", "--runs", "1", "--tool", "P=0,0,-150")
AT_THE_WORST_MOMENT = """
import os, sys
from abbe.compcore.files.text import atomic
from abbe.daemon.cli import main
prepared = atomic._prepared
def ended(*given):
    made = prepared(*given)
    os.kill(os.getpid(), {number})
    return made
atomic._prepared = ended
sys.argv = ["abbe", *sys.argv[1:]]
main()
"""
"""A signal when the certificate is whole on the disk and not in its place yet."""


@pytest.fixture
def check(tmp_path: Path) -> Iterator[tuple[SimulatedProcess, Path]]:
    """The plan of ``abbe verify -o`` for the gauge at hand, which lies there."""
    # slow enough that a signal comes between two faces
    with plate_measuring.machine("--hurry", "300") as process:
        gauge_measuring.write_files(tmp_path, process.ready["port"], STEPS)
        model = tmp_path / "model.toml"
        model.write_text(model.read_text("utf-8") + EFFECTS, encoding="utf-8")
        made = abbe("verify", model, "-o", tmp_path / "check.toml", "--gauge",
                    tmp_path / "gauge.csv", *CHECK)  # fmt: skip
        assert made.status == 0, made.err
        (setup,) = read_plan(tmp_path / "check.toml", load_model(model).machine).setups
        gauge_measuring.lay(process, setup, STEPS)
        yield process, tmp_path


def rows(folder: Path) -> list[str]:
    """The whole rows of the check's campaign, as they stand there."""
    lines = (folder / "check.csv").read_text("utf-8").splitlines(keepends=True)
    return [ln for ln in lines if not ln.startswith("#") and ln.endswith("\n")][1:]


@pytest.mark.thorough
def test_ended_while_the_check_is_measured(check: tuple[SimulatedProcess, Path]) -> None:
    """SIGINT, SIGTERM, SIGKILL one after the other; what was told is kept, and nothing twice."""
    process, folder = check
    files = [str(folder / n) for n in ("check.toml", "config.toml")]
    command = ["measure", *files, "-o", str(folder / "check.csv"), "--yes"]
    judging = ("--check", folder / "check.toml", "--mpe", "99+L/300")
    kept: list[str] = []
    for number in ENDS:
        with subprocess.Popen(
            [sys.executable, "-m", "abbe.daemon", *command], text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8",
        ) as run:  # fmt: skip
            assert run.stdout is not None
            assert run.stderr is not None
            told = next((ln for ln in run.stdout if " target " in ln and "µm" in ln), "")
            assert told, run.stderr.read()
            run.send_signal(number)
            said = run.stderr.read()
            run.stdout.read()
        if number == signal.SIGKILL:
            assert run.returncode == -signal.SIGKILL
        else:
            assert run.returncode == 1
            assert "targets are not measured; the same command goes on" in said
            assert "Traceback" not in said
        now = rows(folder)
        assert len(now) > len(kept)
        assert now[: len(kept)] == kept
        kept = now
    done = abbe(*command)
    assert done.status == 0, done.err
    assert rows(folder)[: len(kept)] == kept
    found = read_campaign(folder / "check.csv", load_model(folder / "model.toml").machine)
    c = found.conditions
    assert c.setup is not None
    assert c.u is not None
    visited = len({name.partition(".")[0] for name in c.setup.tolist()})
    assert visited == 1
    assert found.n == len(STEPS) + 1  # and the first again
    at = np.stack([c.positions[a] for a in "XYZ"], axis=1)
    for name in np.unique(c.setup):
        mine = c.setup == name
        left = found.value[mine] * 1e3 - gauge_measuring.true_errors(
            process, at[mine], c.u[mine][0]
        )
        assert np.ptp(left) < 2.0
    judged = abbe("verify", folder / "model.toml", folder / "check.csv", *judging)
    assert judged.status in (1, 4), judged.out  # nothing that was measured in parts passes
    command[command.index(str(folder / "check.csv"))] = str(folder / "whole.csv")
    done = abbe(*command)
    assert done.status == 0, done.err
    judged = abbe("verify", folder / "model.toml", folder / "whole.csv", *judging)
    assert judged.status == 0, judged.out + judged.err


@pytest.mark.parametrize("number", ENDS, ids=[n.name for n in ENDS])
def test_ended_while_the_certificate_is_written(tmp_path: Path, number: signal.Signals) -> None:
    """The certificate that was there stays whole; the same command writes the new one."""
    fitted(tmp_path)
    written(tmp_path / "after.csv", line("x_check", 310.0, scale=0.0))
    page = tmp_path / "certificate.html"
    words = ["verify", str(tmp_path / "m.toml"), str(tmp_path / "after.csv"), "--report", str(page)]
    assert abbe(*words, "--coverage", "3").status == 0
    before = page.read_bytes()
    done = subprocess.run(
        [sys.executable, "-c", AT_THE_WORST_MOMENT.format(number=int(number)), *words],
        capture_output=True, text=True, check=False, timeout=120, encoding="utf-8",
    )  # fmt: skip
    assert done.returncode == (130 if number == signal.SIGINT else -number), done.stderr
    assert "Traceback" not in done.stderr
    assert page.read_bytes() == before
    again = abbe(*words)
    assert again.status == 0, again.err
    assert page.read_bytes() != before
    assert page.read_text("utf-8").rstrip().endswith("</html>")
