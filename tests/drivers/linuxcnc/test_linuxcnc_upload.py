"""``abbe table`` and ``abbe upload`` to a real LinuxCNC, which shows what the tables do; and back.

The machine's error is a function written here; the model knows it as samples. LinuxCNC is started
anew by the user's own command, which also homes it.
"""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from abbe.compcore.effects import Backlash, Positioning
from abbe.compcore.files.model_file import save_model
from abbe.compcore.machine.machine import Axis
from abbe.compcore.machine.machine import Machine as Described
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from abbe.drivers.stores.linuxcnc.config import LinuxCncStoreConfig
from abbe.drivers.stores.linuxcnc.store import LinuxCncStore
from tests.support.drivers.linuxcnc.mill import Mill

pytestmark = pytest.mark.integration

TRAVEL = (-300.0, 300.0)
BACKLASH = -0.008
CONFIG = """
format = "abbe-config/1"
model = "model.toml"

[links.mill]
driver = "linuxcnc"
[links.mill.channels]
{channels}

[guard]
max_correction = 0.1
max_rate = 0.5
stale_after = 0.3

{axes}

[upload]
controller = "linuxcnc"
identity = {identity}
max_entry_um = 100.0
max_change_um = 100.0
effect_tolerance_um = 0.3
effect_looks = 2
[upload.store]
driver = "linuxcnc"
ini = "mill.ini"
restart = {restart}
verify_by_moving = true
verify_step = 3.0
verify_feed = 3000.0
"""


def error(axis: str, q: float, upward: bool, size: float) -> float:
    curve = {"X": np.sin(q / 70.0), "Y": np.cos(q / 50.0), "Z": np.tanh(q / 90.0)}[axis]
    return float(size * curve + 0.5 * BACKLASH * (1.0 if upward else -1.0))


def save_the_model(path: Path, size: float) -> None:
    owner = Described("mill", Structure.parse("w b X Y Z t"), {a: Axis(a, TRAVEL) for a in "XYZ"})
    positions = np.linspace(*TRAVEL, 121)
    terms = []
    for axis in "XYZ":
        effect = Positioning(axis=axis, shape="table", positions=tuple(positions.tolist()))
        middle = [
            0.5 * (error(axis, q, True, size) + error(axis, q, False, size)) for q in positions
        ]
        values = {f"v{i}": Value(v) for i, v in enumerate(middle, start=1)}
        terms += [Term(effect, values), Term(Backlash(axis=axis), {"b": Value(BACKLASH)})]
    save_model(Model(owner, tuple(terms)), path)


def abbe(folder: Path, *words: str) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, "-m", "abbe.daemon", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


@pytest.fixture
def mill() -> Iterator[Mill]:
    with Mill() as machine:
        yield machine


async def moved(mill: Mill) -> Any:
    config = LinuxCncStoreConfig(ini=str(mill.folder / "mill.ini"), verify_by_moving=True)
    store = LinuxCncStore("mill", config)
    await store.open()
    try:
        return await store.effects()
    finally:
        await store.close()


def acts(mill: Mill, size: float) -> None:
    """See on the machine itself, both ways, that it does what a table of this size has to."""
    seen = set()
    for effect in asyncio.run(moved(mill)):
        for axis, way in effect.direction.items():
            wanted = -error(axis, effect.position[axis], way > 0, size)
            assert effect.correction[axis] == pytest.approx(wanted, abs=3e-4)
            seen.add((axis, way))
    assert len(seen) == 6


@pytest.mark.timeout(300)
def test_tables_are_uploaded_verified_on_the_machine_and_rolled_back(mill: Mill) -> None:
    folder = mill.folder
    channels = "\n".join(
        f'{a} = {{ pin = "joint.{i}.pos-cmd", unit = "mm" }}' for i, a in enumerate("XYZ")
    )
    axes = "\n".join(f'[axes.{a}]\nsource = "mill.{a}"' for a in "XYZ")
    version = subprocess.run(
        ["/usr/bin/python3", "-c", "import linuxcnc; print(linuxcnc.version)"],
        capture_output=True, text=True, check=True,
    ).stdout.strip()  # fmt: skip
    (folder / "mill.toml").write_text(
        CONFIG.format(
            channels=channels,
            axes=axes,
            identity=json.dumps(f"LinuxCNC {version}, mill"),
            restart=json.dumps(mill.restart_command()),
        )
    )

    def upload(size: float) -> tuple[int, str]:
        save_the_model(folder / "model.toml", size)
        status, said = abbe(
            folder, "table", "model.toml", "--controller", "linuxcnc", "-o", f"tables-{size}"
        )
        assert status == 0, said
        return abbe(folder, "upload", "mill.toml", f"tables-{size}", "--yes")

    # LinuxCNC is not running: it will read the files when it is started
    status, said = upload(0.02)
    assert status == 0, said
    assert "is active, verified by reading it back" in said
    mill.start()
    mill.ready()
    acts(mill, 0.02)
    status, said = abbe(folder, "upload", "mill.toml", "--check")
    assert status == 0, said
    assert "the controller adds what the table says" in said

    status, said = upload(0.03)
    assert status == 0, said
    found = re.search(r"adds what the table says: (\d+) corrections.* worst difference 0\.0", said)
    assert found, said
    # three steps up and three down, in each of X, Y, Z; an axis that has not moved has nothing yet
    assert int(found[1]) >= 6 * 1 + 6 * 2 + 6 * 3
    acts(mill, 0.03)

    status, said = abbe(folder, "upload", "mill.toml", "--rollback", "--yes")
    assert status == 0, said
    acts(mill, 0.02)
    status, said = abbe(folder, "upload", "mill.toml", "--status")
    assert status == 0, said
