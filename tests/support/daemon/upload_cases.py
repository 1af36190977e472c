"""A mill with a simulated control, its configuration, two sets of tables: for uploads."""

from __future__ import annotations

import asyncio
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.effects import Backlash, Positioning
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.tables.volume import Volume
from abbe.daemon.answers.tables.make import TableRequest, make
from abbe.daemon.config import load_config
from abbe.daemon.upload.history.upload_log import read_journal
from abbe.daemon.upload.operator_port import OperatorPort
from abbe.daemon.upload.session import Result, UploadRequest, finish, roll_back, upload
from abbe.drivers.controllers import make_controller
from abbe.drivers.simulated.process import SimulatedProcess

NAME, SERIAL = "ABBE SIMULATED CONTROL 1.0", "SIM-4711"
OPTIONS = {"holds": "moves"}
TRAVELS = {"X": (0.0, 500.0), "Y": (0.0, 400.0), "Z": (-300.0, 0.0)}


def model(size: float, backlash: float = 0.003) -> Model:
    """Three axes, each with a positioning error of about `size` mm and play."""
    machine = Machine(
        "mill", Structure.parse("w X' Y' b Z t"), {a: Axis(a, r) for a, r in TRAVELS.items()}
    )
    rng = np.random.default_rng(7)
    terms = []
    for axis in TRAVELS:
        effect = Positioning(axis=axis, shape="spline:5")
        values = {p.name: Value(float(size * v)) for p, v in
                  zip(effect.linear(machine), rng.uniform(-1.0, 1.0, 5), strict=True)}  # fmt: skip
        terms.append(Term(effect, values))
        terms.append(Term(Backlash(axis=axis), {"b": Value(-backlash)}))
    return Model(machine, tuple(terms))


def make_tables(
    model_file: Path,
    folder: Path,
    options: Mapping[str, str] = OPTIONS,
    points: int = 20,
    dialect: str = "csv",
) -> Path:
    """What ``abbe table --controller csv`` writes."""
    loaded = load_model(model_file)
    controller = make_controller(dialect, loaded.machine, options)
    order = TableRequest(
        model_file,
        controller,
        options,
        SlowState(),
        Volume.of(loaded.machine),
        points=points,
        by="test",
    )
    make(order, loaded).made.write(folder)
    return folder


def sums(folder: Path) -> dict[str, str]:
    """SHA-256 of each file of a set, worked out here."""
    return {
        p.name: hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(folder.iterdir())
        if p.name != "abbe-tables.json"
    }


def texts(folder: Path) -> dict[str, str]:
    return {p.name: p.read_text() for p in sorted(folder.iterdir()) if p.name != "abbe-tables.json"}


CONFIG = """
format = "abbe-config/1"
model = "model.toml"
[links.cnc]
driver = "modbus"
host = "127.0.0.1"
port = 1
[links.cnc.channels]
x = {{ table = "input", address = 0, type = "int32", unit = "mm" }}
y = {{ table = "input", address = 2, type = "int32", unit = "mm" }}
z = {{ table = "input", address = 4, type = "int32", unit = "mm" }}
[axes.X]
source = "cnc.x"
[axes.Y]
source = "cnc.y"
[axes.Z]
source = "cnc.z"
[guard]
max_correction = 0.1
max_rate = 1.0
[upload]
controller = "csv"
options = {{ holds = "moves" }}
identity = "ABBE SIMULATED CONTROL 1.0"
serial = "SIM-4711"
max_entry_um = 60.0
max_change_um = 120.0
effect_every = 0.0
patience = {patience}
{upload}
[upload.store]
{store}
"""

SLOW = {"timeout": 10.0, "command_timeout": 20.0, "reconnect_within": 20.0}
"""Nothing goes wrong: only patience."""
QUICK = {"timeout": 0.15, "command_timeout": 0.5, "reconnect_within": 0.3, "attempts": 3}
"""Something goes wrong: it has to be noticed soon."""


@dataclass
class Place:
    """A folder with a configuration, an old and a new set of tables, and a control."""

    folder: Path
    control: SimulatedProcess
    store: dict[str, Any]
    slow: dict[str, Any]
    when_restart_is_asked: Callable[[], bool] = lambda: False
    said: list[str] = field(default_factory=list)

    @property
    def config(self) -> Path:
        return self.folder / "mill.toml"

    @property
    def journal(self) -> Path:
        return self.folder / "uploads.jsonl"

    def configure(self, patience: float = 60.0, more: str = "", **keys: Any) -> None:
        store = self.store | keys
        lines = "\n".join(f"{k} = {json.dumps(v)}" for k, v in store.items())
        self.config.write_text(CONFIG.format(patience=patience, upload=more, store=lines))

    def _operator(self, agrees: bool = True) -> OperatorPort:
        async def restarted() -> bool:
            return self.when_restart_is_asked()

        return OperatorPort(self.said.append, lambda _: None, lambda _: agrees, restarted)

    def upload(self, folder: Path, **request: Any) -> Result:
        return asyncio.run(
            upload(
                load_config(self.config),
                folder,
                UploadRequest(by="tester", **request),
                self._operator(),
            )
        )

    def roll_back(self) -> Result:
        return asyncio.run(
            roll_back(load_config(self.config), UploadRequest(by="tester"), self._operator())
        )

    def recover(self) -> Any:
        return asyncio.run(
            finish(load_config(self.config), UploadRequest(by="tester"), self._operator())
        )

    def truth(self) -> dict[str, Any]:
        return self.control.order("truth")

    def entries(self) -> list[Mapping[str, Any]]:
        return list(read_journal(self.journal).entries)


def fill(folder: Path) -> None:
    """The model and tables of two of its versions."""
    for name, size in (("old", 0.010), ("new", 0.012)):
        save_model(model(size), folder / "model.toml")
        make_tables(folder / "model.toml", folder / name)


@contextmanager
def patient_place(folder: Path) -> Iterator[Place]:
    """A mill with the page of its service, its tables ``old`` (active) and ``new``, a control."""
    fill(folder)
    with SimulatedProcess("controller", "modbus") as control:
        control.order("reset")
        control.order("load", files=texts(folder / "old"))
        keys = {"driver": "modbus", "host": "127.0.0.1", "port": control.ready["port"]}
        here = Place(folder, control, keys, SLOW)
        here.configure(**SLOW)
        here.config.write_text(here.config.read_text() + "\n[http]\n")
        yield here


__all__ = [
    "NAME",
    "SERIAL",
    "Place",
    "fill",
    "make_tables",
    "model",
    "patient_place",
    "sums",
    "texts",
]
