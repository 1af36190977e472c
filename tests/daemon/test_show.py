"""What is shown of a run is true, fits its place, and never gets in the machine's way."""

from __future__ import annotations

import io
import json
import logging
import math
import os
import queue
import threading
from pathlib import Path

import pytest
from rich.console import Console

from abbe.daemon.config import load_config
from abbe.daemon.event_log import BoundedQueueHandler, journal
from abbe.daemon.guard import Decision, GuardState
from abbe.daemon.pipeline.faults import StandingFaults
from abbe.daemon.pipeline.headline import headline
from abbe.daemon.pipeline.reading.convert import SignalReading
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.show.bars import deviation_bar, sparkline
from abbe.daemon.show.json_lines import JsonLines
from abbe.daemon.show.plain import PlainLines
from abbe.daemon.show.screen import LiveScreen
from abbe.daemon.show.writer import LineWriter
from abbe.daemon.status.figures import Durations, ErrorFigures, Figures, volumetric_errors
from abbe.daemon.status_word import Status, describe
from abbe.drivers.link import LinkState
from tests.support.daemon.memory_link import MemoryLink

MACHINE = load_config(
    Path(__file__).parents[2] / "examples" / "bridge-cmm" / "config.toml"
).model.machine
AXES = ("Y", "X", "Z")
FULL = (GuardState.ACTIVE,) * 3
SIGNALS = {"T_x1": SignalReading(20.5, "", 1.0), "T_x2": SignalReading(math.nan, "not read")}


def record(
    number: int = 1,
    states: tuple[GuardState, GuardState, GuardState] = FULL,
    indicated: tuple[float, float, float] = (900.0, 350.0, -180.0),
    correction: tuple[float, float, float] = (0.010, -0.020, 0.0),
    reference: tuple[float, float, float] = (899.979, 350.011, -180.0),
    faults: dict[str, str] | None = None,
    duration: float = 0.002,
) -> CycleRecord:
    y, x, z = indicated
    corrected = (y + correction[1], x + correction[0], z + correction[2])
    return CycleRecord(
        number,
        0.02 * number,
        indicated,
        corrected,
        Decision(correction, states, False, False),
        0x7003,
        SIGNALS,
        faults or {},
        reference,
        duration,
        True,
    )


def test_volumetric_errors_are_distances_to_the_reference() -> None:
    before, after = volumetric_errors(record(), (0, 1, 2)) or (0.0, 0.0)
    assert before == pytest.approx(math.hypot(21.0, 11.0))
    assert after == pytest.approx(math.hypot(1.0, 1.0))
    assert volumetric_errors(record(reference=(math.nan,) * 3), (0, 1, 2)) is None


def test_figures_count_full_correction_only() -> None:
    figures = Figures((0, 1, 2))
    figures(record(1, states=(GuardState.RISING,) * 3, correction=(0.0, 0.0, 0.0)))
    for number in range(2, 6):
        figures(record(number))
    summary = figures.summary()
    assert summary["cycles"] == 5
    assert summary["cycles_corrected_in_full"] == 4
    assert summary["rms_after_um"] == pytest.approx(math.sqrt(2.0), abs=1e-3)
    assert summary["max_before_um"] == pytest.approx(math.hypot(21.0, 11.0), abs=1e-3)
    assert summary["improvement"] == pytest.approx(math.hypot(21, 11) / math.sqrt(2), rel=1e-3)
    assert summary["drift"] == {"T_x1": 0.0}


def test_an_error_that_is_no_number_is_never_the_largest() -> None:
    figures = ErrorFigures()
    for value in (3.0, 1.0):
        figures.add(value)
    assert figures.max == 3.0
    assert figures.rms == pytest.approx(math.sqrt(5.0))


def test_quantiles_of_durations() -> None:
    durations = Durations()
    assert math.isnan(durations.quantile(0.5))
    for i in range(1, 1001):
        durations.add(1e-6 * i)
    assert durations.quantile(0.5) == pytest.approx(500e-6, rel=0.01)
    assert durations.quantile(0.99) == pytest.approx(990e-6, rel=0.01)


def test_json_lines_name_units_and_have_no_nan() -> None:
    stream = io.StringIO()
    writer = LineWriter(stream)
    link = MemoryLink("cmm", {})
    lines = JsonLines(writer, MACHINE, AXES, AXES, {"cmm": link})
    lines(record())
    lines(record(2, indicated=(math.nan, 350.0, -180.0), faults={"axis Y": "stale"}))
    writer.end(json.dumps({"summary": {}}))

    def refuse(text: str) -> None:
        raise AssertionError(text)

    first, second, last = (
        json.loads(line, parse_constant=refuse) for line in stream.getvalue().splitlines()
    )
    assert first["unit"] == "mm"
    assert first["indicated"] == {"X": 350.0, "Y": 900.0, "Z": -180.0}
    assert first["corrected"] == pytest.approx({"X": 350.010, "Y": 899.980, "Z": -180.0})
    assert first["correction"] == {"X": 0.01, "Y": -0.02, "Z": 0.0}
    assert first["temperatures"] == {"T_x1": 20.5, "T_x2": None}
    assert first["guard"]["states"] == {"X": "active", "Y": "active", "Z": "active"}
    assert first["links"]["cmm"]["state"] == "up"
    assert first["cycle_ms"] == 2.0
    assert second["indicated"]["Y"] is None
    assert second["corrected"]["Y"] is None
    assert second["faults"] == {"axis Y": "stale"}
    assert last == {"summary": {}}


def test_a_reader_that_is_gone_does_not_matter() -> None:
    read_end, write_end = os.pipe()
    os.close(read_end)
    with os.fdopen(write_end, "w", buffering=1) as stream:
        writer = LineWriter(stream)
        for _ in range(100):
            writer.put("a line")
        writer.end()
        assert not [t for t in threading.enumerate() if t.name == "lines"]


def test_a_slow_reader_costs_lines_not_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("abbe.daemon.show.writer._WAITING", 10)
    read_end, write_end = os.pipe()
    with os.fdopen(write_end, "w", buffering=1) as stream:
        writer = LineWriter(stream)
        for _ in range(100):
            writer.put("x" * 65_536)
        assert writer.dropped > 50
        reader = threading.Thread(
            target=lambda: [None for _ in iter(lambda: os.read(read_end, 1 << 20), b"")]
        )
        reader.start()
        writer.end()
    reader.join()
    os.close(read_end)


@pytest.mark.parametrize("width", [80, 100, 140])
@pytest.mark.parametrize("faults", [{}, {"link cmm": "down: refused"}])
def test_the_screen_fits_and_tells(width: int, faults: dict[str, str]) -> None:
    link = MemoryLink("cmm", {})
    screen = LiveScreen(MACHINE, AXES, AXES, {"cmm": link}, "Abbe · test", 50.0)
    console = Console(width=width, height=50, file=io.StringIO(), force_terminal=True)
    console.print(screen.picture(width))
    states = FULL if not faults else (GuardState.OFF,) * 3
    for number in range(1, 400):
        screen(record(number, states=states, faults=faults))
    if faults:
        link.status.become(LinkState.DOWN, "refused")
    screen.events.handle(logging.makeLogRecord({"msg": "guard: X: held", "levelno": 30}))
    with console.capture() as captured:
        console.print(screen.picture(width))
    text = captured.get()
    assert "350.0100" in text
    assert "+10.0" in text
    assert "20.50 °C" in text
    assert "guard: X: held" in text
    assert ("CORRECTED IN FULL" in text) == (not faults)
    assert ("NOT CORRECTED" in text) == bool(faults)
    assert "down" in text if faults else "up" in text
    plain = Console(width=width, file=io.StringIO(), color_system=None)
    plain.print(screen.picture(width))
    lines = plain.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert max(map(len, lines)) <= width


def test_bars() -> None:
    assert sparkline([0.0, 5.0, 10.0, 20.0, math.nan], 10.0) == "▁▄██ "
    assert deviation_bar(0.0, 10.0, 4) == "    │    "
    assert deviation_bar(-5.0, 10.0, 4) == "  ██│    "
    assert deviation_bar(math.nan, 10.0, 4) == "    │    "


def test_the_headline_names_the_gravest_and_its_directions() -> None:
    off, on, held = GuardState.OFF, GuardState.ACTIVE, GuardState.HOLDING
    assert headline(record(states=(off, on, held))) == "X: NOT CORRECTED"
    assert headline(record(states=(held, on, held))) == "X, Z: last good correction held"
    assert headline(record(states=(off, off, off))) == "NOT CORRECTED"
    assert headline(record()) == "corrected in full"
    limited = record()._replace(decision=Decision((0.1, 0.0, 0.0), FULL, True, False))
    assert headline(limited) == "correction limited"
    ending = record(states=(off, off, off))._replace(status=int(Status.ENDING))
    assert headline(ending) == "ended, not corrected"


def test_plain_lines_come_every_other_second() -> None:
    stream = io.StringIO()
    writer = LineWriter(stream)
    plain = PlainLines(writer, {"cmm": MemoryLink("cmm", {})}, (0, 1, 2))
    for number in range(1, 251):
        plain(record(number))
    writer.end()
    lines = stream.getvalue().splitlines()
    assert len(lines) == 3
    assert "corrected in full" in lines[0]
    assert "error 23.7 → 1.4 µm" in lines[0]


def test_the_journal_is_written_and_rotated(tmp_path: Path) -> None:
    file = tmp_path / "journal.log"
    with journal(file, max_bytes=10_000, keep=2, to_stderr=False):
        for number in range(400):
            logging.getLogger("abbe.faults").warning("event %d: %s", number, "x" * 40)
        logging.getLogger("elsewhere").warning("not ours")
    kept = sorted(p.name for p in tmp_path.iterdir())
    assert kept == ["journal.log", "journal.log.1", "journal.log.2"]
    text = file.read_text(encoding="utf-8")
    assert "event 399" in text
    assert "not ours" not in text
    assert not logging.getLogger("abbe").handlers


def test_a_journal_that_hangs_costs_events_and_no_memory() -> None:
    waiting: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    handler = BoundedQueueHandler(waiting, 100)
    for number in range(1000):
        handler.emit(logging.makeLogRecord({"msg": f"event {number}"}))
    assert waiting.qsize() == 100
    assert [waiting.get().getMessage() for _ in range(100)][-1] == "event 99"
    handler.emit(logging.makeLogRecord({"msg": "later"}))
    said = [waiting.get().getMessage() for _ in range(waiting.qsize())]
    assert said == ["the journal's disk did not keep up: 900 events are missing", "later"]


def test_a_fault_is_logged_once_when_it_comes_and_once_when_it_is_over(
    caplog: pytest.LogCaptureFixture,
) -> None:
    faults = StandingFaults(linger=1.0)
    with caplog.at_level(logging.INFO, "abbe"):
        for i in range(50):
            flickers = {"signal T": f"reading {i}"} if i % 2 else {}
            faults.update(flickers, 0.1 * i)
        for i in range(50, 80):
            faults.update({}, 0.1 * i)
    assert [r.message for r in caplog.records] == [
        "signal T: reading 1",
        "signal T: sound again after 4.8 s",
    ]


def test_the_status_word_in_words() -> None:
    assert describe(0) == "STOPPED"
    assert describe(int(Status.RUNNING | Status.Y_ACTIVE)) == "RUNNING Y_ACTIVE"
