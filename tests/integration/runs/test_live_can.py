"""``abbe run`` on two CAN buses: encoders and a thermometer by CANopen, another one by DBC."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import abbe.drivers.simulated.can
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.live_run import PATIENCE, Cycle, compensating, live_run

pytestmark = pytest.mark.integration

ALPHA = 1.6e-5
"""Expansion of the scales of X and Y, 1/K."""
T_X, T_Y = 21.25, 21.5
"""Temperatures of the simulated inputs: CiA 404's second, T_left of machine.dbc."""
MODEL = f"""format = "abbe-model/1"
[machine]
name = "Bench"
structure = "w b Y X Z t"
reference_temperature = 20.0
[machine.axes.X]
travel = [0.0, 200.0]
[machine.axes.Y]
travel = [0.0, 300.0]
[machine.axes.Z]
travel = [0.0, 400.0]
[machine.signals.T_x]
unit = "degC"
role = "scale"
axis = "X"
[machine.signals.T_y]
unit = "degC"
role = "scale"
axis = "Y"
[[effects]]
kind = "scale_expansion"
axis = "X"
signals = ["T_x"]
[effects.parameters.alpha]
value = {ALPHA}
unit = "1/K"
[[effects]]
kind = "scale_expansion"
axis = "Y"
signals = ["T_y"]
[effects.parameters.alpha]
value = {ALPHA}
unit = "1/K"
"""
CONFIG = """format = "abbe-config/1"
model = "model.toml"

[links.encoders]
driver = "canopen"
interface = "slcan"
channel = "{nodes}"
bitrate = 500000
sync = "read"
nodes = {{ x = {{ id = 3 }}, y = {{ id = 4 }}, z = {{ id = 5 }}, t = {{ id = 6 }} }}
[links.encoders.channels]
x = {{ node = "x", profile = "cia406", by = "pdo", unit = "count" }}
y = {{ node = "y", profile = "cia406", by = "pdo", unit = "count" }}
z = {{ node = "z", profile = "cia406", by = "pdo", unit = "count" }}
T = {{ node = "t", profile = "cia404", input = 2, every = 0.2, unit = "degC" }}

[links.shop]
driver = "can"
interface = "slcan"
channel = "{frames}"
dbc = "{dbc}"
[links.shop.channels]
T_left = {{ message = "TEMPERATURES" }}
[links.shop.messages]
TEMPERATURES = {{ within = 2.0 }}

[axes.X]
source = "encoders.x"
transducer = {{ type = "encoder", counts_per_mm = 10000, travel = [0, 400] }}
[axes.Y]
source = "encoders.y"
transducer = {{ type = "encoder", counts_per_mm = 10000, travel = [0, 400] }}
[axes.Z]
source = "encoders.z"
transducer = {{ type = "encoder", counts_per_mm = 10000, travel = [0, 400] }}

[signals.T_x]
source = "encoders.T"
[signals.T_y]
source = "shop.T_left"

[guard]
max_correction = 0.1
max_rate = 1.0
stale_after = 2.0
hold = 0.3
ramp = 0.5
"""


FIELD = """format = "abbe-config/1"
model = "model.toml"

[links.encoders]
driver = "canopen"
interface = "slcan"
channel = "{encoders}"
bitrate = 500000
sync = "read"
nodes = {{ x = {{ id = 3 }}, y = {{ id = 4 }}, z = {{ id = 5 }} }}
[links.encoders.channels]
x = {{ node = "x", profile = "cia406", by = "pdo", unit = "count" }}
y = {{ node = "y", profile = "cia406", by = "pdo", unit = "count" }}
z = {{ node = "z", profile = "cia406", by = "pdo", unit = "count" }}

[links.field]
driver = "canopen"
interface = "slcan"
channel = "{field}"
bitrate = 500000
adapter_status = "usbtin"
nodes = {{ t = {{ id = 6 }} }}
[links.field.channels]
T_x = {{ node = "t", profile = "cia404", input = 2, every = 0.2, unit = "degC" }}
T_y = {{ node = "t", profile = "cia404", input = 3, every = 0.2, unit = "degC" }}

[signals.T_x]
source = "field.T_x"
[signals.T_y]
source = "field.T_y"
"""
"""Positions from one bus, temperatures from another."""


@contextmanager
def buses(folder: Path) -> Iterator[tuple[SimulatedProcess, Path]]:
    """Two buses in processes of their own, and a configuration for them."""
    with SimulatedProcess("can") as nodes, SimulatedProcess("can", "--frames", "0.02") as frames:
        (folder / "model.toml").write_text(MODEL, encoding="utf-8")
        config = folder / "config.toml"
        text = CONFIG.format(
            nodes=nodes.ready["channel"],
            frames=frames.ready["channel"],
            dbc=Path(abbe.drivers.simulated.can.__file__).with_name("machine.dbc"),
        )
        config.write_text(text, encoding="utf-8")
        yield nodes, config


def check_positions(cycle: Cycle) -> None:
    """The encoders stand 100 mm apart; the warm scales of X and Y read too little."""
    indicated, corrected = cycle["indicated"], cycle["corrected"]
    assert indicated["Y"] - indicated["X"] == pytest.approx(100.0, abs=1e-9)
    assert indicated["Z"] - indicated["X"] == pytest.approx(200.0, abs=1e-9)
    for axis, temperature in (("X", T_X), ("Y", T_Y)):
        expected = indicated[axis] * (1.0 + ALPHA * (temperature - 20.0))
        assert corrected[axis] == pytest.approx(expected, abs=2e-5)
        assert corrected[axis] - indicated[axis] > 1e-3
    assert corrected["Z"] == indicated["Z"]
    assert cycle["temperatures"] == {"T_x": pytest.approx(T_X), "T_y": pytest.approx(T_Y)}


def test_positions_from_can_are_corrected_and_a_lost_encoder_is_named(tmp_path: Path) -> None:
    with buses(tmp_path) as (nodes, config), live_run(config) as run:
        for _ in range(5):
            check_positions(run.until(compensating))
        silenced = len(run.cycles)
        nodes.order("node", number=4, silent=True)
        lost = run.until(lambda c: "axis Y" in c["faults"], since=silenced)
        assert "node y (4)" in lost["faults"]["axis Y"]
        # what belongs to Y's position is not written; X and Z are still known
        assert lost["corrected"]["Y"] is None
        healed = len(run.cycles)
        nodes.order("node", number=4, silent=False)
        check_positions(run.until(compensating, since=healed))
        assert run.end() == 0
        assert "Traceback" not in run.journal


def test_bus_off_of_the_thermometers_bus_is_named_and_the_correction_ramped_down(
    tmp_path: Path,
) -> None:
    """CAN-H and CAN-L touch: held, ramped to zero, positions unaffected; mended: back."""
    axes = CONFIG[CONFIG.index("[axes.X]") : CONFIG.index("[signals.T_x]")]
    guard = CONFIG[CONFIG.index("[guard]") :]
    (tmp_path / "model.toml").write_text(MODEL, encoding="utf-8")
    config = tmp_path / "config.toml"
    with SimulatedProcess("can") as encoders, SimulatedProcess("can", "--reports", "flags") as bus:
        text = (FIELD + axes + guard).format(
            encoders=encoders.ready["channel"], field=bus.ready["channel"]
        )
        config.write_text(text, encoding="utf-8")
        with live_run(config) as run:
            good = run.until(compensating)
            assert good["corrected"]["X"] - good["indicated"]["X"] > 1e-3
            shorted = len(run.cycles)
            bus.order("fault", shorted=True)
            named = run.until(lambda c: "bus-off" in c["faults"].get("link field", ""), shorted)
            assert "the controller has left the bus" in named["faults"]["link field"]
            run.until(lambda c: c["guard"]["states"]["X"] == "holding", since=shorted)
            run.until(lambda c: c["guard"]["states"]["X"] == "falling", since=shorted)
            off = run.until(lambda c: c["guard"]["states"]["X"] == "off", since=shorted)
            assert off["corrected"] == off["indicated"]
            assert None not in off["indicated"].values()
            assert "bus-off" in off["faults"]["link field"]
            mended = len(run.cycles)
            bus.order("fault")
            back = run.until(compensating, since=mended)
            assert back["corrected"]["X"] - back["indicated"]["X"] > 1e-3
            assert "link field" not in back["faults"]
            assert run.end() == 0
            assert "bus-off" in run.journal
            assert "Traceback" not in run.journal


def test_check_says_what_would_be_linked_without_a_bus(tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text(MODEL, encoding="utf-8")
    config = tmp_path / "config.toml"
    dbc = Path(abbe.drivers.simulated.can.__file__).with_name("machine.dbc")
    text = CONFIG.format(nodes="/dev/no-such-port", frames="/dev/nor-this", dbc=dbc)
    config.write_text(text, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "abbe.daemon", "check", str(config), "--json"],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    where = {row["what"]: row["where"] for row in json.loads(done.stdout)["inputs"]}
    assert where["axis X"] == "node x (3) 6004h:00, int32 by PDO at SYNC, in count"
    assert where["signal T_x"] == "node t (6) 9130h:02, int32 by SDO, every 0.2 s, in degC"
    assert where["signal T_y"] == (
        "signal T_left of TEMPERATURES (202h), missing after 2 s, in degC"
    )
