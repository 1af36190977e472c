"""± for the controller: worked out by hand, read by mbpoll, refused, lost, and at the end."""

from __future__ import annotations

import asyncio
import logging
import math
import sqlite3
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.daemon.config import load_config
from abbe.daemon.config.notes import notes
from abbe.daemon.pipeline.writing.reported_uncertainty import ReportedAxis
from abbe.daemon.service import Service
from abbe.daemon.status.status_source import StatusSource
from abbe.drivers.link import ChannelInfo
from tests.support.daemon.command_line import abbe
from tests.support.daemon.live_run import PATIENCE, read_holding
from tests.support.daemon.small_line import ALPHA, SD, write_campaign, write_model
from tests.support.drivers.modbus_devices import Memory, Request, TcpDevice

LEVER = np.outer(np.linspace(20.0, 27.0, 5) - 20.0, np.linspace(50.0, 450.0, 17))
SD_ALPHA = SD * 1e-3 / math.sqrt(3.0 * float((LEVER**2).sum()))
"""Of a line through the origin, three readings at each point, mm per mm and K."""
NOT_KNOWN = 65535
"""The most that pm_X's register holds."""

CONFIG = """format = "abbe-config/1"
model = "fitted.toml"
[cycle]
period = 0.02
signals_every = 0.1
[guard]
max_correction = 0.1
max_rate = 1.0
stale_after = 5.0
signals_stale_after = 60.0
hold = 0.2
ramp = 0.2
[records]
every = 0.1
[axes]
X = {{ source = "plc.X" }}
Y = {{ source = "plc.Y" }}
Z = {{ source = "plc.Z" }}
[signals]
T_x = {{ source = "plc.T_x", max_rate = 1e6 }}
T_hall = {{ source = "plc.T_hall" }}
[output]
status = "plc.status"
heartbeat = "plc.heartbeat"
axes.X.target = "plc.corrected_X"
{reported}
[links.plc]
driver = "modbus"
transport = "tcp"
host = "127.0.0.1"
port = {port}
unit_id = 1
timeout = 3.0
separate = ["tables"]
[links.plc.channels]
X = {{ table = "input", address = 0, type = "float32", unit = "mm" }}
Y = {{ table = "input", address = 2, type = "float32", unit = "mm" }}
Z = {{ table = "input", address = 4, type = "float32", unit = "mm" }}
T_x = {{ table = "input", address = 6, type = "float32", unit = "degC" }}
T_hall = {{ table = "input", address = 8, type = "float32", unit = "degC" }}
status = {{ {word} address = 10 }}
heartbeat = {{ {word} address = 11 }}
corrected_X = {{ table = "holding", writable = true, address = 12, type = "float32", unit = "mm" }}
pm_X = {{ {word} address = 20, scale = 0.01, unit = "um" }}
outside = {{ {word} address = 21 }}
narrow = {{ {word} address = 22, scale = 0.001, unit = "um" }}
bare = {{ {word} address = 23 }}
scaled = {{ {word} address = 24, scale = 0.1 }}
read_only = {{ table = "holding", address = 30, type = "uint16", scale = 0.01, unit = "um" }}
"""
WORD = 'table = "holding", type = "uint16", writable = true,'
STANDS = {"X": 300.0, "Y": 120.0, "Z": -80.0, "T_x": 25.0, "T_hall": 20.5}
REPORTED = 'plus_minus.X = "plc.pm_X"\noutside = "plc.outside"'


class Plc(Memory):
    """A controller: X, Y, Z and two thermometers as float32; its registers begin at 4711."""

    def __init__(self) -> None:
        super().__init__()
        self.words[1, "holding"] = [4711] * self.size
        self.words[1, "holding"][10:12] = [0, 0]
        self.refuses = False
        self.forbidden = self._forbidden
        for name, value in {
            "X": 300.0,
            "Y": 120.0,
            "Z": -80.0,
            "T_x": 25.0,
            "T_hall": 20.5,
        }.items():
            self.stand(name, value)

    def stand(self, name: str, value: float) -> None:
        at = {"X": 0, "Y": 2, "Z": 4, "T_x": 6, "T_hall": 8}[name]
        self.words[1, "input"][at : at + 2] = struct.unpack(">HH", struct.pack(">f", value))

    def _forbidden(self, request: Request) -> int:
        reported = request.function in (6, 16) and request.address >= 20
        return 2 if self.refuses and reported else 0

    @property
    def reported(self) -> tuple[int, int]:
        """pm_X and outside, as they stand in the registers."""
        found = self.words[1, "holding"][20:22]
        return found[0], found[1]

    @property
    def status(self) -> int:
        return self.words[1, "holding"][10]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model fitted to its campaign."""
    made = tmp_path_factory.mktemp("reported")
    campaign = write_campaign(made / "c.csv", seed=5)
    done = abbe("fit", write_model(made), campaign, "-o", made / "fitted.toml")
    assert done.status == 0, done.err
    return made


def config(folder: Path, to: Path, port: int = 502, reported: str = REPORTED) -> Path:
    text = CONFIG.format(port=port, reported=reported, word=WORD).replace(
        "fitted.toml", str(folder / "fitted.toml")
    )
    (to / "config.toml").write_text(text, "utf-8")
    return to / "config.toml"


@asynccontextmanager
async def running(
    folder: Path, to: Path, reported: str = REPORTED
) -> AsyncIterator[tuple[Service, Plc, TcpDevice]]:
    """A run on a controller over a real socket; ended as Ctrl-C does."""
    plc = Plc()
    async with TcpDevice(plc) as device:
        service = Service(load_config(config(folder, to, device.port, reported)))
        task = asyncio.create_task(service.run())
        try:
            yield service, plc, device
        finally:
            service.stop()
            await asyncio.wait_for(task, PATIENCE)


async def until(what: Callable[[], object]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not what():  # noqa: ASYNC110
            await asyncio.sleep(5e-3)


def in_full(service: Service) -> bool:
    latest = service.logbook.cycles.latest
    return latest is not None and latest.in_full


def in_steps(wide_mm: float) -> tuple[int, int]:
    """± in the steps of pm_X (0.01 µm), as the fit may have it within half a percent, up."""
    return math.floor(wide_mm * 1e5 * 0.995), math.ceil(wide_mm * 1e5 * 1.005)


INSIDE = 2.0 * SD_ALPHA * 5.0 * 300.0
"""At X = 300 and 25 °C: the correction is α·5 K·300 mm."""


async def test_it_is_twice_the_standard_deviation_worked_out_by_hand(folder, tmp_path) -> None:
    async with running(folder, tmp_path) as (_, plc, device):
        await until(lambda: plc.reported[1] == 0)
        low, high = in_steps(INSIDE)
        assert low <= plc.reported[0] <= high
        # an unrelated client reads the same
        seen = await asyncio.to_thread(read_holding, device.port, 20, 2)
        assert struct.unpack(">HH", seen) == plc.reported
        # the place decides, and what was never measured: 450 mm was the last
        plc.stand("X", 499.0)
        await until(lambda: plc.reported[1] == 1)
        change = ALPHA * 5.0 * (499.0 - 450.0) / math.sqrt(3.0)
        low, high = in_steps(2.0 * math.hypot(SD_ALPHA * 5.0 * 499.0, change))
        await until(lambda: low <= plc.reported[0] <= high)
        plc.stand("T_x", 31.0)
        await until(lambda: plc.reported[1] == 3)
    assert plc.reported == (NOT_KNOWN, 8)
    assert plc.status == 0


async def test_records_and_status_have_it_too(folder, tmp_path) -> None:
    async with running(folder, tmp_path) as (service, plc, _):
        plc.stand("X", 499.0)
        await until(lambda: plc.reported[1] == 1)
        assert StatusSource(service)().outside == ["X"]
        seen = service.logbook.cycles.latest.time
        await until(lambda: service.logbook.cycles.latest.time > seen + 0.5)
    with sqlite3.connect(tmp_path / "records.sqlite") as records:
        names = {row[0] for row in records.execute("SELECT name FROM series")}
        far = records.execute(
            "SELECT DISTINCT value FROM full JOIN series USING (series) WHERE name = 'beyond_X'"
        ).fetchall()
    assert {"plus_minus_X", "plus_minus_Y", "plus_minus_Z", "outside", "in_full"} <= names
    assert far == [(499.0 - 450.0,)]


async def test_what_is_held_has_no_uncertainty(folder, tmp_path) -> None:
    async with running(folder, tmp_path) as (_, plc, _):
        await until(lambda: plc.reported[1] == 0)
        plc.stand("T_x", math.nan)
        await until(lambda: plc.reported == (NOT_KNOWN, 8))
        plc.stand("T_x", 25.0)
        await until(lambda: plc.reported[1] == 0)


async def test_a_refused_one_costs_no_corrected_position(folder, tmp_path, caplog) -> None:
    caplog.set_level(logging.INFO, "abbe.pipeline")
    async with running(folder, tmp_path) as (service, plc, _):
        plc.refuses = True
        said = "how sure the correction is was not written"
        await until(lambda: said in caplog.text)
        await until(lambda: in_full(service))
        number = service.logbook.cycles.latest.number
        await until(lambda: service.logbook.cycles.latest.number > number + 100)
        assert service.logbook.cycles.latest.in_full
        assert service.logbook.cycles.latest.faults == {}
        assert plc.reported == (4711, 4711)
        assert caplog.text.count(said) == 1
        plc.refuses = False
        await until(lambda: plc.reported[1] == 0)
        # the controller has it before it is said
        await until(lambda: caplog.text.count("is written again") == 1)
    assert plc.reported == (NOT_KNOWN, 8)


async def test_a_lost_link_is_told_when_it_is_back(folder, tmp_path) -> None:
    async with running(folder, tmp_path) as (service, plc, device):
        await until(lambda: plc.reported[1] == 0)
        await device.stop()
        await until(lambda: service.links["plc"].status.state.value == "down")
        plc.words[1, "holding"][20:22] = [0, 0]  # a controller that was switched off and on
        await device.start()
        await until(lambda: plc.reported == (NOT_KNOWN, 8) or plc.reported[0])
        await until(lambda: plc.reported[1] == 0)
        low, high = in_steps(INSIDE)
        await until(lambda: low <= plc.reported[0] <= high)


async def test_without_a_covariance_it_says_so(tmp_path) -> None:
    """As of an imported model: nothing is ever known."""
    write_model(tmp_path).rename(tmp_path / "fitted.toml")
    model = tmp_path / "fitted.toml"
    model.write_text(model.read_text() + "[effects.parameters]\nalpha = { value = 1e-5 }\n")
    loaded = load_config(config(tmp_path, tmp_path))
    assert [n for n in notes(loaded) if "output.plus_minus" in n]
    async with running(tmp_path, tmp_path) as (service, plc, _):
        await until(lambda: plc.reported == (NOT_KNOWN, 8))
        await until(lambda: in_full(service))


async def test_a_flag_says_that_something_was_not_measured(folder, tmp_path) -> None:
    """Where the channel is a bit, that is all it can say: 1 for anything, and at the end."""
    channel = 'outside = { table = "coil", type = "bit", writable = true, address = 21 }\n'
    plc = Plc()
    coils = plc.bits[1, "coil"]
    async with TcpDevice(plc) as device:
        path = config(folder, tmp_path, device.port)
        text = path.read_text()
        was = f"outside = {{ {WORD} address = 21 }}\n"
        assert was in text
        path.write_text(text.replace(was, channel))
        service = Service(load_config(path))
        task = asyncio.create_task(service.run())
        try:
            await until(lambda: in_full(service) and service.uncertainty.latest is not None)
            await until(lambda: plc.words[1, "holding"][20] != 4711)
            await until(lambda: coils[21] == 0)
            plc.stand("X", 499.0)
            await until(lambda: coils[21] == 1)
            plc.stand("X", 300.0)
            await until(lambda: coils[21] == 0)
            plc.stand("T_x", 31.0)
            await until(lambda: coils[21] == 1)
            plc.stand("T_x", 25.0)
            await until(lambda: coils[21] == 0)
        finally:
            service.stop()
            await asyncio.wait_for(task, PATIENCE)
    assert coils[21] == 1
    assert set(coils) == {0, 1}


@pytest.mark.parametrize(
    ("reported", "said"),
    [
        ('plus_minus.Y = "plc.pm_X"', "no linear axis of that name is corrected.*one of X"),
        ('plus_minus.X = "plc.bare"', 'of no stated unit.*unit = "um"'),
        ('plus_minus.X = "plc.T_hall"', "is in degC|cannot be written"),
        ('plus_minus.X = "plc.narrow"', "cannot hold 100 um.*65.535"),
        ('plus_minus.X = "plc.nothing"', "no channel 'nothing'"),
        ('plus_minus.X = "plc.read_only"', "cannot be written.*writable = true"),
        ('plus_minus.X = "plc.corrected_X"', "written twice"),
        ('plus_minus.X = "plc.pm_X"\noutside = "plc.pm_X"', "written twice"),
        ('outside = "plc.scaled"', "whole numbers"),
    ],
)
def test_what_cannot_be_told_is_refused(folder, tmp_path, reported: str, said: str) -> None:
    path = config(folder, tmp_path, reported=reported)
    with pytest.raises(InputError, match=said) as caught:
        load_config(path)
    assert str(caught.value).startswith(str(path))


def test_it_overwrites_nothing_that_is_read(folder, tmp_path) -> None:
    """Where one memory holds both tables, as in many devices."""
    path = config(folder, tmp_path)
    text = path.read_text().replace('separate = ["tables"]\n', "")
    path.write_text(text.replace("address = 20, scale", "address = 6, scale"))
    with pytest.raises(InputError, match="plc.pm_X would overwrite what is read as plc.T_x"):
        load_config(path)


@pytest.mark.parametrize(
    ("info", "wide", "written"),
    [
        # never less than it is
        (ChannelInfo("um", True, 0.0, 0.0, 6553.5, 0.1), 0.00121, 1.3),
        (ChannelInfo("um", True, 0.0, 0.0, 6553.5, 0.1), 0.0012, 1.2),
        # what is wider than the register can say is not known
        (ChannelInfo("um", True, 0.0, 0.0, 6553.5, 0.1), 7.0, 6553.5),
        (ChannelInfo("mm", True, 0.0, -32.768, 32.767, 0.001), 0.0012, 0.002),
        # 10 mm is not known, in a register that holds more
        (ChannelInfo("mm", True, 0.0, -32.768, 32.767, 0.001), 11.0, 10.0),
        (ChannelInfo("mm", True), 0.00121, 0.00121),
        (ChannelInfo("µm", True), math.nan, 10_000.0),
        (ChannelInfo("µm", True), math.inf, 10_000.0),
    ],
)
def test_it_is_bounded_and_rounded_to_the_safe_side(info, wide, written) -> None:
    reported = ReportedAxis("X", 0, ("plc", "pm"), info)
    assert reported.value(wide) == pytest.approx(written, abs=1e-9)
    assert info.low <= reported.value(wide) <= info.high


def test_abbe_check_shows_what_is_written(folder, tmp_path) -> None:
    done = abbe("check", config(folder, tmp_path))
    assert done.status == 0, done.err
    assert "± of X" in done.out
    assert "never measured" in done.out
