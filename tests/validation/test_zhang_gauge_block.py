"""Zhang's 515 mm gauge block in seven orientations by the command line: 7.5 → 1.4 µm at worst.

The machine is the study's exact chain of rigid bodies; it is calibrated as the paper's, and the
block, warm by its own amount, is probed where the scales say, never fitted.
"""

from __future__ import annotations

import json

import numpy as np

from abbe.compcore.files.model_file import save_model
from abbe.compcore.fitting.fit import fit
from benchmarks.sources import zhang
from tests.support.daemon.command_line import abbe

WAYS = {
    "X": (1, 0, 0), "Y": (0, 1, 0), "XY+": (1, 1, 0), "XY-": (-1, 1, 0), "XZ": (1, 0, 0.45),
    "YZ": (0, 1, 0.45), "XYZ": (1, 1, 0.5),
}  # fmt: skip
STEEL = 11.5e-6


def probed(exact, signals, actual):
    """Where the scales stand when the exact machine's tip is at points, machine coordinates."""
    point = actual.copy()
    for _ in range(6):
        positions = {a: (point - zhang.PROBE)[:, k] for k, a in enumerate("XYZ")}
        point = actual - exact.error({**positions, **signals}, zhang.PROBE)
    return point


def test_worst_of_seven_orientations_before_and_after(tmp_path):
    exact = zhang.machine()
    save_model(fit(zhang.model(), zhang.calibration(exact, 1)).model, tmp_path / "bridge.toml")
    rng = np.random.default_rng(515)
    centre = np.array(list(zhang.MIDDLE.values())) + zhang.PROBE
    names = ["position", "calibrated", "sd", "expansion", "temperature"]
    names += ["x1", "y1", "z1", "x2", "y2", "z2"]
    rows, truth = [], []
    for name, way in WAYS.items():
        u = np.array(way) / np.linalg.norm(way)
        warm = float(rng.uniform(19.3, 20.9))
        signals = zhang.thermometers(warm, np.full(2, rng.uniform(0.0, 1e4)))
        length = 515.0 * (1 + STEEL * (warm - 20.0))
        actual = centre + np.array([[-0.5], [0.5]]) * length * u
        ends = probed(exact, signals, actual)
        truth.append(1e3 * (np.linalg.norm(ends[1] - ends[0]) - length))
        ends += rng.normal(0.0, 0.2e-3, ends.shape)
        cells = [name, "515", "0.08", "11.5", f"{warm:.3f}", *(f"{v:.6f}" for v in ends.ravel())]
        rows.append(",".join([*cells, *(f"{v[0]:.3f}" for v in signals.values())]))
    header = ",".join([*names, *signals])
    tool = ",".join(map(str, zhang.PROBE))
    text = "\n".join([f"# tool = {tool}", header, *rows]) + "\n"
    (tmp_path / "block.csv").write_text(text, encoding="utf-8")
    done = abbe("gauges", tmp_path / "block.csv", "--model", tmp_path / "bridge.toml", "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)
    before = [g["before"] for g in found["lengths"]]
    np.testing.assert_allclose(before, truth, atol=1.0)
    assert len(before) == 7
    assert found["worst_before"] > 6.5
    # the source: worst 7.5 µm before, 1.4 µm after
    assert found["worst_after"] < 1.4
