"""Configurations: the example is in order; every mistake is one clear message at its place."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from abbe.compcore.errors import InputError
from abbe.daemon.config import load_config

EXAMPLE = Path(__file__).parents[3] / "examples" / "bridge-cmm"
TEXT = (EXAMPLE / "config.toml").read_text(encoding="utf-8")
MODEL = str(EXAMPLE / "model.toml")


def write(folder: Path, text: str) -> Path:
    path = folder / "config.toml"
    path.write_text(text.replace('"model.toml"', f'"{MODEL}"'), encoding="utf-8")
    return path


def test_the_example_is_in_order() -> None:
    found = load_config(EXAMPLE / "config.toml")
    assert list(found.links) == ["cmm"]
    assert found.limits.max_correction == (0.1, 0.1, 0.1)
    assert found.limits.max_norm == pytest.approx(0.1 * 3**0.5)
    assert found.model.signals_needed() == ("T_x1", "T_x2", "T_y1", "T_y2", "T_z1", "T_z2")


def test_limits_per_direction(tmp_path: Path) -> None:
    text = TEXT.replace(
        "max_correction = 0.1 ", "max_correction = { X = 0.05, Y = 0.1, Z = 0.02 }\nmax_norm = 0.1 "
    )
    limits = load_config(write(tmp_path, text)).limits
    assert limits.max_correction == (0.05, 0.1, 0.02)
    assert limits.max_norm == 0.1


WRONG = {
    "unknown section": ("[journal]", "[jornal]", "jornal", "unknown key"),
    "unknown key": ("period = 0.02", "priod = 0.02", "cycle.priod", "unknown key"),
    "text for a number": ("period = 0.02", 'period = "fast"', "cycle.period", "'fast'.*a number"),
    "too fast": ("period = 0.02", "period = -1", "cycle.period", "greater than or equal to 0"),
    "format": ("abbe-config/1", "abbe-config/7", "format", "'abbe-config/7'.*abbe-config/1"),
    "no model": ('"model.toml"', '"other.toml"', "model", "no such model file"),
    "missing guard key": ("max_rate = 0.5", "", "guard.max_rate", "missing"),
    "negative limit": (
        "max_correction = 0.1",
        "max_correction = -0.1",
        "guard.max_correction",
        "0",
    ),
    "one direction missing": (
        "max_correction = 0.1 ",
        "max_correction = { X = 0.1, Y = 0.1 } ",
        "guard.max_correction.Z",
        "missing",
    ),
    "rate cannot ramp": ("max_rate = 0.5", "max_rate = 0.01", "guard.max_rate", "at least 0.05"),
    "stale too soon": ("stale_after = 0.3", "stale_after = 0.03", "guard.stale_after", "0.04 s"),
    "driver": ('driver = "modbus"', 'driver = "telepathy"', "links.cmm.driver", "modbus"),
    "link key": ("timeout = 0.3", "timeut = 0.3", "links.cmm.timeut", "unknown key"),
    "channel type": (
        'count_X = { table = "input", address = 4, type = "int32"',
        'count_X = { table = "input", address = 4, type = "int33"',
        "links.cmm.channels.count_X.type",
        "'int33'.*'int32'",
    ),
    "source": ('"cmm.count_X"', '"cmm.cuont_X"', "axes.X.source", "no channel 'cuont_X'.*count_X"),
    "source's link": ('"cmm.count_X"', '"cnc.count_X"', "axes.X.source", "no link 'cnc'.*cmm"),
    "not a channel": ('"cmm.count_X"', '"count_X"', "axes.X.source", "link.channel"),
    "transducer type": (
        '{ type = "encoder", counts_per_mm = 10000, zero = 0,',
        '{ type = "encodr", counts_per_mm = 10000, zero = 0,',
        "axes.X.transducer.type",
        "'encodr'.*encoder",
    ),
    "transducer key": (
        "counts_per_mm = 10000, zero = 0,",
        "counts_per_mm = 10000, zer = 0,",
        "axes.X.transducer.zer",
        "unknown key",
    ),
    "transducer's law": (
        "counts_per_mm = 10000, zero = 0,",
        "zero = 0,",
        "axes.X.transducer",
        "counts_per_mm and counts_per_rev",
    ),
    "transducer of another unit": (
        "counts_per_mm = 10000, zero = 0, travel = [0, 700]",
        "counts_per_rev = 10000",
        "axes.X.transducer",
        "for rad, and mm is needed",
    ),
    "wire of another unit": (
        'scale = 0.1, unit = "ohm" }\ntool_x',
        'scale = 0.1, unit = "mA" }\ntool_x',
        "signals.T_z2.transducer",
        "takes ohm, and channel cmm.R_T_z2 is in mA",
    ),
    "no transducer": (
        'transducer = { type = "encoder", counts_per_mm = 10000, zero = 0, travel = [0, 700] }',
        "",
        "axes.X",
        "in count, and mm is needed",
    ),
    "axis that is not there": ("[axes.X]", "[axes.U]", "axes.U", "no such axis"),
    "signal that the model lacks": ("[signals.T_x1]", "[signals.T_q]", "signals.T_q", "no such"),
    "signal that an effect needs": (
        '[signals.T_x1]\nsource = "cmm.R_T_x1"\ntransducer = { type = "steinhart-hart", '
        "a = 1.032e-3, b = 2.387e-4, c = 1.580e-7, r25 = 10000 }\n",
        "",
        "signals.T_x1",
        "'scale_expansion axis=X signals=T_x1,T_x2' needs it",
    ),
    "output that is read only": (
        'target = "cmm.corrected_X"',
        'target = "cmm.tool_x"',
        "output.axes.X.target",
        "cannot be written",
    ),
    "output over an output": (
        'target = "cmm.corrected_X"',
        'target = "cmm.corrected_Y"',
        "output.axes.Y.target",
        "written twice",
    ),
    "output axis": ("[output.axes.X]", "[output.axes.C]", "output.axes.C", "no such axis"),
    "minus an axis that is not there": (
        "[signals.T_x1]\n",
        '[signals.T_x1]\nminus = "U"\n',
        "signals.T_x1.minus",
        "no such axis",
    ),
    "minus an axis that is converted": (
        "[signals.T_x1]\n",
        '[signals.T_x1]\nminus = "X"\n',
        "signals.T_x1.minus",
        "converted",
    ),
    "two tools": ("[tool]", "[tool]\noffset = [0, 0, -150]", "tool", "either fixed .* or read"),
    "watch without status": (
        'status = "cmm.status"\n',
        "",
        "controller.require",
        "where the status word is",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_mistake_is_named_with_its_place(name: str, tmp_path: Path) -> None:
    old, new, field, words = WRONG[name]
    assert old in TEXT
    path = write(tmp_path, TEXT.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load_config(path)
    error = caught.value
    assert error.field == field
    assert error.file == str(path)
    assert error.line is not None or "has no source" in error.problem
    assert re.search(words, str(error))
    assert "\n" not in str(error)


def test_an_axis_without_a_source_is_named(tmp_path: Path) -> None:
    start, end = TEXT.index("[axes.Z]"), TEXT.index("# Ohms")
    with pytest.raises(InputError, match=r"axis Z of the model has no source.*\[axes\.Z\]"):
        load_config(write(tmp_path, TEXT[:start] + TEXT[end:]))


def test_a_place_points_at_the_very_line(tmp_path: Path) -> None:
    path = write(tmp_path, TEXT.replace("period = 0.02", 'period = "fast"', 1))
    with pytest.raises(InputError) as caught:
        load_config(path)
    lines = path.read_text(encoding="utf-8").splitlines()
    assert caught.value.line is not None
    assert lines[caught.value.line - 1].startswith('period = "fast"')


@pytest.mark.parametrize(
    ("content", "words"),
    [("model = [", "not valid TOML"), ("", "format.*missing"), ("a\x00", "not valid TOML")],
)
def test_what_is_no_configuration_is_refused(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        load_config(path)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_config(tmp_path / "none.toml")
