"""Check points that a controller measures over a real socket: recorded, judged, said, refused."""

from __future__ import annotations

import asyncio
import logging
import math
import sqlite3
import struct
from pathlib import Path

import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.daemon.config import load_config
from abbe.daemon.http.metrics import RunCollector
from abbe.daemon.service import Service
from abbe.daemon.status.status_source import StatusSource
from abbe.daemon.status.text import lines
from tests.support.daemon.command_line import abbe
from tests.support.daemon.plant_files import named
from tests.support.daemon.probing_plc import (
    POINTS_AT,
    ProbingPlc,
    looked_at,
    probing,
    sphere,
    until,
)
from tests.support.daemon.small_line import write_campaign, write_model

STANDS = {"X": 300.0, "Y": 120.0, "Z": -80.0, "T_x": 25.0, "T_hall": 20.5}
POINTS = ("ball", "block", "laser")
BALL = sphere("ball", "nominal = [300.0, 120.0, -80.0]\nsd = 0.5\ntool = [0, 0, -50]")
BLOCK = (
    '[checks.points.block]\ntrigger = "plc.block_n"\nvalue = "plc.block_um"\nu = "-X"\nsd = 0.3\n'
)
LASER = (
    '[checks.points.laser]\ntrigger = "plc.laser_n"\nreference = "X"\nsd = 0.2\n'
    '[reference.X]\nsource = "plc.laser_X"\n'
)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fitted to its campaign: X grows by 11 ppm/K."""
    folder = tmp_path_factory.mktemp("fitted")
    campaign = write_campaign(folder / "c.csv", seed=5)
    done = abbe("fit", write_model(folder), campaign, "-o", folder / "fitted.toml")
    assert done.status == 0, done.err
    return folder / "fitted.toml"


def plc() -> ProbingPlc:
    return ProbingPlc(STANDS, POINTS)


def series(service: Service) -> dict:
    answer = service.checks.state.answer
    return {} if answer is None else {s["name"]: s for s in answer["series"]}


@pytest.mark.thorough
async def test_a_sphere_is_recorded_judged_and_shown(model, tmp_path, caplog) -> None:
    caplog.set_level(logging.INFO, "abbe.checks")
    machine = load_model(model).machine
    device = plc()
    async with probing(device, model, BALL, tmp_path) as (service, _):
        await until(lambda: looked_at(service))
        device.measured("ball", 300.004, 119.999, -80.002)
        await until(lambda: "ball_X" in series(service))
        kept = read_campaign(tmp_path / "checks.csv", machine)
        # error = where it is − where it was found, µm; float32 has some 0.02 µm here
        assert kept.value * 1e3 == pytest.approx([-4.0, 1.0, 2.0], abs=0.05)
        assert kept.conditions.positions["X"] == pytest.approx([300.004] * 3, abs=1e-4)
        assert kept.conditions.tool.tolist() == [[0.0, 0.0, -50.0]] * 3
        assert kept.conditions.signals["T_x"] == pytest.approx([25.0] * 3)
        # beyond the prediction: the scale has grown by α·5 K·300 mm = 16.5 µm
        found = series(service)["ball_X"]
        assert found["beyond_prediction"] == pytest.approx(-4.0 - 16.5, abs=0.5)
        status = StatusSource(service)()
        assert status.checks is not None
        assert (status.checks.verdict, status.checks.checks) == ("sound", 1)
        assert any("checks: sound, 1 of them" in line for line in lines(status))
        collector = RunCollector()
        collector.status = status
        samples = {
            (s.name, tuple(s.labels.values())): s.value
            for family in collector.collect()
            for s in family.samples
        }
        assert samples["abbe_checks_recorded", ()] == 1.0
        assert samples["abbe_check_verdict", ("sound",)] == 1.0
        assert ("abbe_check_chart_ratio", ("ball_X",)) in samples
        # the plant's rules and dashboard ask for nothing else
        of_checks = {name for name in named() if name.startswith("abbe_check_")}
        assert of_checks <= {name for name, _ in samples} | {"abbe_check_refused"}
        assert "abbe_check_refused" in {family.name for family in collector.collect()}
        assert "check ball: ball_X" in caplog.text
    with sqlite3.connect(tmp_path / "records.sqlite") as records:
        names = {row[0] for row in records.execute("SELECT name FROM series")}
    assert {"check_ball_X", "check_ball_Y", "check_ball_Z"} <= names


async def test_what_the_run_records_is_what_the_command_judges(model, tmp_path) -> None:
    device = plc()
    async with probing(device, model, BALL, tmp_path) as (service, _):
        await until(lambda: looked_at(service))
        device.measured("ball", 300.004, 119.999, -80.002)
        await until(lambda: "ball_X" in series(service))
        said = service.checks.state.answer["words"]
    done = abbe("check-point", tmp_path / "config.toml")
    assert done.status == 0, done.err
    assert done.out.splitlines()[0] == said[0]
    # a run that begins knows what was recorded before
    async with probing(plc(), model, BALL, tmp_path) as (service, _):
        await until(lambda: service.checks.state.answer is not None)
        assert service.checks.state.answer["words"] == said


async def test_what_was_measured_with_corrected_positions_is_put_back(model, tmp_path) -> None:
    """The encoder stood at i, with i + α·5·i = found."""
    loaded = load_model(model)
    alpha = float(loaded.terms[0].values["alpha"].value)
    device = plc()
    outputs = (
        '[output.axes.X]\ntarget = "plc.corrected_X"\n'
        '[links.plc.channels.corrected_X]\ntable = "holding"\naddress = 2\ntype = "float32"\n'
        'unit = "mm"\nwritable = true\n'
    )
    block = BLOCK + "corrected = true\n"
    sections = BALL.replace("sd", "corrected = true\nsd") + block + outputs
    async with probing(device, model, sections, tmp_path) as (service, _):
        await until(lambda: looked_at(service))
        await until(lambda: service.logbook.cycles.latest.in_full)
        device.measured("ball", 300.0, 120.0, -80.0)
        device.measured("block", 2.0)
        await until(lambda: {"ball_X", "block"} <= set(series(service)))
    kept = read_campaign(tmp_path / "checks.csv", loaded.machine)
    at = {str(s): k for k, s in enumerate(kept.conditions.setup)}
    stood = 300.0 / (1.0 + 5.0 * alpha)
    assert kept.conditions.positions["X"][at["ball_X"]] == pytest.approx(stood, abs=1e-6)
    assert kept.value[at["ball_X"]] == pytest.approx(300.0 - stood, abs=1e-6)
    # read along −X while corrected: 2 µm beside the prediction, which is −α·5·300 along −X
    expected = 2e-3 - 5.0 * alpha * 300.0
    assert kept.value[at["block"]] == pytest.approx(expected, abs=1e-6)


async def test_a_reference_channel_is_read_where_the_machine_stands(model, tmp_path) -> None:
    device = plc()
    device.measured("laser", 300.0125, trigger=7)
    async with probing(device, model, LASER, tmp_path) as (service, _):
        await until(lambda: looked_at(service))
        await until(lambda: math.isfinite(service.logbook.cycles.latest.reference[1]))
        device.measured("laser", 300.0125)
        await until(lambda: "laser" in series(service))
    kept = read_campaign(tmp_path / "checks.csv", load_model(model).machine)
    assert kept.value * 1e3 == pytest.approx([12.5], abs=0.05)
    assert kept.conditions.u.tolist() == [[1.0, 0.0, 0.0]]
    assert kept.conditions.positions["X"] == pytest.approx([300.0])


@pytest.mark.thorough
async def test_a_reference_that_moves_is_not_taken(model, tmp_path, caplog) -> None:
    """Where X stood when the laser was read is not known while X goes; then it is taken again."""
    device = plc()
    async with probing(device, model, LASER, tmp_path) as (service, _):
        await until(lambda: looked_at(service))
        await until(lambda: math.isfinite(service.logbook.cycles.latest.reference[1]))
        goes = asyncio.create_task(_go(device))
        speed = service.pipeline.axes.index("X")
        await until(lambda: service.logbook.cycles.latest.speeds[speed] > 1.0)
        device.measured("laser", 300.0125)
        await refused(service, "laser", "X moved when it was read")
        assert service.checks.idle
        goes.cancel()
        device.stand("X", 310.0)
        await until(lambda: service.logbook.cycles.latest.speeds[speed] == 0.0)
        device.measured("laser", 310.02)
        await until(lambda: "laser" in series(service))
        assert service.checks.state.refused == {}
    kept = read_campaign(tmp_path / "checks.csv", load_model(model).machine)
    assert kept.value * 1e3 == pytest.approx([20.0], abs=0.05)
    assert kept.conditions.positions["X"] == pytest.approx([310.0])
    assert caplog.text.count("check laser: not recorded") == 1


@pytest.mark.thorough
async def test_a_cycle_from_before_the_measurement_says_nothing_of_it(model, tmp_path) -> None:
    """A busy computer hands on late what it knew of the place before: a new cycle is waited for."""
    device = plc()
    async with probing(device, model, LASER, tmp_path) as (service, _):
        cycles, x = service.logbook.cycles, service.pipeline.axes.index("X")
        await until(lambda: looked_at(service))
        device.measured("laser", 300.0125, trigger=0)
        await until(lambda: cycles.latest.reference[x] == pytest.approx(300.0125, abs=1e-4))
        service.pipeline.listeners.remove(service.checks)
        device.stand("X", 310.0)
        await until(lambda: cycles.latest.indicated[x] == 310.0 and cycles.latest.speeds[x] == 0.0)
        device.measured("laser", 310.02)
        number = cycles.latest.number
        await until(lambda: cycles.latest.number > number + 50)
        assert service.checks.idle
        service.pipeline.listeners.append(service.checks)
        await until(lambda: "laser" in series(service))
    kept = read_campaign(tmp_path / "checks.csv", load_model(model).machine)
    assert kept.value * 1e3 == pytest.approx([20.0], abs=0.05)
    assert kept.conditions.positions["X"] == pytest.approx([310.0])


async def _go(device: ProbingPlc) -> None:
    """To and fro along X, some 10 mm/s, until cancelled."""
    at, step = 300.0, 0.1
    while True:
        at += step
        if not 290.0 < at < 310.0:
            step = -step
        device.stand("X", at)
        await asyncio.sleep(0.01)


async def test_a_reload_judges_by_the_new_model(model, tmp_path) -> None:
    """What was recorded is held against the model that is led in, without a new measurement."""
    own = tmp_path / "own.toml"
    own.write_text(model.read_text())
    alpha = float(load_model(model).terms[0].values["alpha"].value)
    device = plc()
    async with probing(device, own, BALL, tmp_path) as (service, _):
        await until(lambda: looked_at(service))
        device.measured("ball", 300.004, 119.999, -80.002)
        await until(lambda: "ball_X" in series(service))
        before = series(service)["ball_X"]["beyond_prediction"]
        assert before == pytest.approx(-4.0 - alpha * 5.0 * 300.0 * 1e3, abs=0.05)
        kept = (tmp_path / "checks.csv").read_bytes()
        text = own.read_text()
        assert repr(alpha) in text
        own.write_text(text.replace(repr(alpha), repr(2.0 * alpha)))
        service.reload()
        await until(lambda: series(service)["ball_X"]["beyond_prediction"] != before)
        after = series(service)["ball_X"]["beyond_prediction"]
        assert after == pytest.approx(-4.0 - 2.0 * alpha * 5.0 * 300.0 * 1e3, abs=0.05)
        assert not service.again
        assert service.checks.state.answer["checks"] == 1
    assert (tmp_path / "checks.csv").read_bytes() == kept


async def refused(service: Service, name: str, words: str) -> None:
    await until(lambda: words in service.checks.state.refused.get(name, ""))


async def test_what_cannot_be_used_is_refused_and_said(model, tmp_path, caplog) -> None:
    device = plc()
    async with probing(device, model, BALL + BLOCK, tmp_path) as (service, _):
        await until(lambda: looked_at(service))
        device.measured("ball", 3000.0, 120.0, -80.0)
        await refused(service, "ball", "found at X = 3000 mm, outside of")
        device.measured("ball", math.nan, 120.0, -80.0)
        await refused(service, "ball", "not a finite number")
        device.measured("block", 2e6)
        await refused(service, "block", "an error of 2000000 µm is none of a machine")
        device.stand("T_x", math.nan)
        await until(lambda: service.logbook.cycles.latest.signals["T_x"].fault)
        device.measured("ball", 300.004, 119.999, -80.002)
        await refused(service, "ball", "T_x is not given")
        device.stand("T_x", 25.0)
        await until(lambda: not service.logbook.cycles.latest.signals["T_x"].fault)
        # a controller that begins anew measures nothing by that
        device.measured("ball", 300.004, 119.999, -80.002, trigger=0)
        trigger = next(t for t in service.checks._triggers if t.name == "ball")
        await until(lambda: trigger._known == 0.0)
        assert not (tmp_path / "checks.csv").exists()
        status = StatusSource(service)()
        assert set(status.checks.refused) == {"ball", "block"}
        # and what is measured then is taken
        device.measured("ball", 300.004, 119.999, -80.002)
        await until(lambda: "ball_X" in series(service))
        assert "ball" not in service.checks.state.refused
    assert "check ball: not recorded: found at X" in caplog.text
    assert "Traceback" not in caplog.text


@pytest.mark.thorough
async def test_a_file_that_is_none_costs_no_correction(model, tmp_path) -> None:
    (tmp_path / "checks.csv").write_text("rubbish\n")
    device = plc()
    async with probing(device, model, BALL, tmp_path) as (service, _):
        await until(lambda: service.checks.state.problem)
        await until(lambda: looked_at(service))
        device.measured("ball", 300.004, 119.999, -80.002)
        await refused(service, "ball", "checks.csv")
        number = service.logbook.cycles.latest.number
        await until(lambda: service.logbook.cycles.latest.number > number + 20)
        assert service.logbook.cycles.latest.decision.compensating
    assert (tmp_path / "checks.csv").read_text() == "rubbish\n"


@pytest.mark.parametrize("program", ["#!/bin/sh\nexit 3\n", "#!/bin/sh\nexec sleep 1000\n"])
async def test_a_judge_that_fails_or_hangs_costs_no_correction(
    model, tmp_path, monkeypatch, program
) -> None:
    judge = tmp_path / "judge"
    judge.write_text(program)
    judge.chmod(0o755)
    monkeypatch.setattr("abbe.daemon.checks.judging.sys.executable", str(judge))
    monkeypatch.setattr("abbe.daemon.checks.live._JUDGED_WITHIN", 0.5)
    device = plc()
    async with probing(device, model, BALL, tmp_path) as (service, _):
        await until(lambda: looked_at(service))
        device.measured("ball", 300.004, 119.999, -80.002)
        await refused(service, "ball", "ended with 3" if "exit" in program else "longer than")
        number = service.logbook.cycles.latest.number
        await until(lambda: service.logbook.cycles.latest.number > number + 20)
        assert service.logbook.cycles.latest.decision.compensating
        assert StatusSource(service)().checks.verdict == "unknown"
        # the next one is judged again
        monkeypatch.undo()
        device.measured("ball", 300.004, 119.999, -80.002)
        await until(lambda: "ball_X" in series(service))


class Hasty(ProbingPlc):
    """Measures once more just when the first measurement is about to be read."""

    again: tuple[float, ...] = ()

    def answer(self, unit: int, pdu: bytes) -> bytes | None:
        function, address, count = struct.unpack(">BHH", pdu[:5])
        if self.again and function == 4 and address <= POINTS_AT + 2 < address + count:
            again, self.again = self.again, ()
            self.measured("ball", *again)
        return super().answer(unit, pdu)


@pytest.mark.thorough
async def test_values_are_those_of_their_trigger(model, tmp_path) -> None:
    device = Hasty(STANDS, POINTS)
    async with probing(device, model, BALL, tmp_path) as (service, _):
        await until(lambda: looked_at(service))
        device.again = (300.010, 120.0, -80.0)
        device.measured("ball", 300.004, 119.999, -80.002)
        await until(lambda: "ball_X" in series(service))
        seen = service.logbook.cycles.latest.number
        await until(lambda: service.logbook.cycles.latest.number > seen + 20)
    kept = read_campaign(tmp_path / "checks.csv", load_model(model).machine)
    assert kept.value * 1e3 == pytest.approx([-10.0, 0.0, 0.0], abs=0.05)


async def test_what_was_measured_just_before_the_end_is_recorded(model, tmp_path) -> None:
    device = plc()
    async with probing(device, model, BALL, tmp_path) as (service, _):
        await until(lambda: looked_at(service))
        await until(lambda: service.checks.idle)
        device.measured("ball", 300.004, 119.999, -80.002)
        await until(lambda: not service.checks.idle)
    kept = read_campaign(tmp_path / "checks.csv", load_model(model).machine)
    assert kept.n == 3


@pytest.mark.parametrize("grace", [0.0, 0.4, 0.8, 1.2])
async def test_a_busy_computer_loses_no_last_reading_and_records_none_twice(
    model, tmp_path, monkeypatch, grace
) -> None:
    """The judging process is ended before, while or after it records; the run records then."""
    monkeypatch.setattr("abbe.daemon.checks.live._GRACE", grace)
    device = plc()
    async with probing(device, model, BALL, tmp_path) as (service, _):
        await until(lambda: looked_at(service))
        device.measured("ball", 300.004, 119.999, -80.002)
        await until(lambda: not service.checks.idle)
    kept = read_campaign(tmp_path / "checks.csv", load_model(model).machine)
    assert sorted(kept.conditions.setup) == ["ball_X", "ball_Y", "ball_Z"]


def test_abbe_check_shows_what_is_read(model, tmp_path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(plc().config(model, BALL + BLOCK, 502), "utf-8")
    done = abbe("check", path)
    assert done.status == 0, done.err
    for words in ("check ball, complete", "check ball, found Z", "check block"):
        assert words in done.out


async def test_a_link_that_was_away_for_long_says_nothing_of_then(
    model, tmp_path, monkeypatch
) -> None:
    device = plc()
    async with probing(device, model, BALL, tmp_path) as (service, server):
        await until(lambda: looked_at(service))
        await server.stop()
        await until(lambda: service.links["plc"].status.state.value == "down")
        monkeypatch.setattr("abbe.daemon.checks.triggers.LONGEST_GAP", 0.0)
        device.measured("ball", 300.004, 119.999, -80.002)
        await server.start()
        await refused(service, "ball", "measured while nobody looked")


@pytest.mark.parametrize(
    ("sections", "said"),
    [
        (BALL.replace("plc.ball_n", "plc.nothing"), "no channel 'nothing'"),
        (BALL.replace("found", "fuond"), "unknown key"),
        (BALL + 'value = "plc.block_um"\nu = "X"\n', "one of found, value, reference"),
        (BLOCK.replace('u = "-X"\n', ""), "value needs its direction u"),
        (BLOCK.replace('"-X"', '"Q"'), "u"),
        (BLOCK.replace('"-X"', "[0, 0, 0]"), "u is no direction"),
        (BLOCK.replace("block_um", "T_x"), "is in degC"),
        (BLOCK.replace("sd = 0.3", "sd = 0"), "sd"),
        (BLOCK + "at = { Q = 1.0 }\n", "has no such axis"),
        (LASER.replace('reference = "X"', 'reference = "Y"'), "nothing independent measures it"),
        (BALL.replace("plc.ball_X", "plc.T_x"), "degC"),
        (BALL.replace("points.ball", 'points."a b"'), "a b"),
    ],
)
def test_a_point_that_cannot_work_is_refused(model, tmp_path, sections, said) -> None:
    path = tmp_path / "config.toml"
    path.write_text(plc().config(model, sections, 502), "utf-8")
    with pytest.raises(InputError, match=said) as caught:
        load_config(path)
    assert str(path) in str(caught.value)


def test_what_is_read_of_a_check_point_is_not_written(model, tmp_path) -> None:
    text = (
        plc()
        .config(model, BALL, 502)
        .replace(
            'heartbeat = "plc.heartbeat"\n',
            'heartbeat = "plc.heartbeat"\noutside = "plc.over"\n',
            1,
        )
    )
    over = 'over = { table = "holding", address = 100, type = "uint16", writable = true }\n'
    text = text.replace('status = "plc.status"\nheartbeat = "plc.heartbeat"\n', "")
    text = text.replace("[links.plc.channels]\n", f"[links.plc.channels]\n{over}")
    path = tmp_path / "config.toml"
    path.write_text(text.replace('separate = ["tables"]\n', ""), "utf-8")
    with pytest.raises(InputError, match=r"plc.over would overwrite what is read as plc.ball_n"):
        load_config(path)
