"""Bad model files: every fault told in one line, nothing written, nothing overwritten."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.hostile import mutate
from tests.support.hostile.forked import Case, faults, run
from tests.support.hostile.good import MODEL, covariance, model

CORRECT = ("correct", "m.toml", "X=100", "Y=200", "Z=-30", "T_x=21")
READ = (
    CORRECT,
    ("history", "m.toml"),
    ("history", "m.toml", "--json"),
    ("remove", "m.toml", "positioning", "-o", "out.toml", "--force"),
)
"""What reads a model, in turn."""


def changed(name: str, before: str, after: str, *says: str, packed: str | None = None) -> Case:
    """The good model with one thing changed, told with file and `says`."""
    assert before in MODEL, before
    text = model(MODEL.replace(before, after, 1), packed)
    return Case(name, {"m.toml": text}, CORRECT, ("m.toml", *says))


def explicit() -> Iterator[Case]:
    """Faults by name, each with what the line has to say."""
    travel = "travel = [0.0, 700.0]"
    where = "machine.axes.X.travel"
    for text in (
        "[0, true]", "[false, true]", '["0", "700"]', "[nan, 700.0]", "[0.0, inf]", "[-inf, inf]",
        "[700.0, 0.0]", "[0.0, 0.0]", "[0.0]", "[0.0, 1.0, 2.0]", "700.0", "{ low = 0.0 }",
        "[[0.0], [700.0]]", "[0.0, 1e308]", "[-1e308, 1e308]", "[0.0, 5e-324]", "[0.0, 1e9]",
        '"0..700"', "[1979-05-27, 1980-05-27]", "[]",
    ):  # fmt: skip
        yield changed(f"travel = {text}", travel, f"travel = {text}", "line 9", where)
    for text in ("293.15", "1e300", "nan", "true", '"20"', "[20.0]", "-273.15"):
        yield changed(
            f"reference_temperature = {text}", "reference_temperature = 20.0",
            f"reference_temperature = {text}", "line 6", "machine.reference_temperature",
        )  # fmt: skip
    for text in ("1e300", "true", "[1.0, 2.0]", "[1.0, 2.0, nan]", '"low"', "[1, 2, 1e9]"):
        yield changed(
            f"rotation_point = {text}", "rotation_point = 10.0", f"rotation_point = {text}",
            "line 12", "machine.axes.Y.rotation_point",
        )  # fmt: skip
    for text in ("[1.0, 2.0, 1e300]", "[1.0]", "[true, 0.0, 0.0]", "3", "[0, 0, -inf]"):
        yield changed(
            f"location = {text}", "location = [1.0, 2.0, 3.0]", f"location = {text}",
            "line 15", "machine.axes.Z.location",
        )  # fmt: skip
    for text in ("[1.0, 1.0, 0.0]", "[1e300, 0.0, 0.0]", "[0.0, 0.0, 0.0]", "[nan, 0.0, 1.0]"):
        yield changed(
            f"direction = {text}", "rotation_point = 10.0", f"direction = {text}",
            "line 12", "machine.axes.Y.direction",
        )  # fmt: skip
    for key, text in (
        ("unit", "3"), ("unit", "[]"), ("role", '"thermometer"'), ("role", "1"), ("axis", '"Q"'),
        ("axis", "1"),
    ):  # fmt: skip
        before = {"unit": 'unit = "degC"', "role": 'role = "scale"', "axis": 'axis = "X"'}[key]
        yield changed(
            f"signal's {key} = {text}", before, f"{key} = {text}", f"machine.signals.T_x.{key}"
        )
    for text in ("1e308", "-1e308", "1e12", "nan", "inf", "true", '"0.001"', "[0.001]", "{}"):
        yield changed(
            f"value = {text}", "value = 0.001", f"value = {text}",
            "line 28", "effects[0].parameters.c0.value",
        )  # fmt: skip
    for text in ("1e308", "-1.0", "nan", "inf", "true", '"1"'):
        yield changed(
            f"sd = {text}", "sd = 0.0001", f"sd = {text}", "line 29", "effects[0].parameters.c0.sd"
        )
    for text in ('"kg"', '"mm/s/s"', "1", '"1e3"'):
        yield changed(
            f"unit = {text}", 'unit = "mm"', f"unit = {text}", "effects[0].parameters.c0.unit"
        )
    for text in (
        "polynomial:-1", "polynomial:21", "polynomial:999999999999", "spline:0", "spline:201",
        "spline:1000000000", "table", "wavelet", "", "polynomial:1.5", "polynomial:١",
    ):  # fmt: skip
        yield changed(f"shape {text}", '"polynomial:1"', f'"{text}"', "effects[0].")
    yield changed("shape of a number", '"polynomial:1"', "3", "effects[0].shape")
    yield changed("kind unknown", '"positioning"', '"positionning"', "effects[0].kind")
    yield changed("kind a number", '"positioning"', "3", "effects[0].kind")
    yield changed("effect's axis", 'axis = "X"\nshape', 'axis = "Q"\nshape', "effects[0].axis")
    yield changed("effect's axis a list", 'axis = "X"\nshape', 'axis = ["X"]\nshape', "effects[0]")
    yield changed("effect's key unknown", "[effects.parameters.c0]", "more = 1", "effects[0].more")
    for text in ("true", "1", '"Off"', "[]", "{}", '""'):
        yield changed(
            f"switch = {text}", 'kind = "scale', f'switch = {text}\nkind = "scale', "switch"
        )
    yield changed(
        "tables of an effect that has none",
        'kind = "scale', 'tables = { E_XX = "off" }\nkind = "scale', "effects[1]",
    )  # fmt: skip
    yield changed("signal not recorded", 'signals = ["T_x"]', 'signals = ["T_q"]', "effects[1]")
    yield changed("signals a number", 'signals = ["T_x"]', "signals = 1", "effects[1].signals")
    yield changed("no signals", 'signals = ["T_x"]', "signals = []", "effects[1].signals")
    yield changed("a parameter too many", "parameters.c1]", "parameters.c7]", "effects[0]", "c7")
    yield changed(
        "a parameter missing",
        '[effects.parameters.c1]\nvalue = -0.002\nsd = 0.0001\nunit = "mm"\n', "",
        "effects[0].parameters.c1",
    )  # fmt: skip
    yield changed(
        "the same effect twice", 'kind = "scale_expansion"\naxis = "X"\nsignals = ["T_x"]',
        'kind = "positioning"\naxis = "X"\nshape = "polynomial:1"', "effects[1]",
    )  # fmt: skip
    for text in ("3", '"none"', "[]", "{ alpha = 3 }", "{ alpha = [1.0] }", "{ alpha = {} }"):
        whole = MODEL[MODEL.index("[effects.parameters.alpha]") : MODEL.index("[fit]")]
        yield changed(f"parameters = {text}", whole, f"parameters = {text}\n", "effects[1]")
    for text in ("format = 1", 'format = "abbe-model/2"', 'format = "abbe-campaign/1"', ""):
        yield changed(f"format: {text}", 'format = "abbe-model/1"', text, "format")
    for text in (
        '""',
        '"w b t"',
        '"w b Y X Z"',
        '"w b Y X X Z t"',
        '"w b Y X Z Q t"',
        "3",
        '"' + "X " * 500 + '"',
    ):
        yield changed(f"structure = {text[:20]}", '"w b Y X Z t"', text, "machine.structure")
    yield changed(
        "composition", 'structure = "w', 'composition = "third"\nstructure = "w', "line 5"
    )
    yield changed("axis twice", "[machine.axes.Y]", "[machine.axes.X]", "line 10")
    yield changed("axis of another name", "[machine.axes.Y]", "[machine.axes.V]", "machine.axes.Y")
    yield changed("axis of no name", "[machine.axes.Y]", '[machine.axes.""]', "machine.axes")
    yield changed("machine's key unknown", 'name = "Bridge CMM"', "colour = 1", "machine.colour")
    yield changed("name a number", 'name = "Bridge CMM"', "name = 1", "machine.name")
    yield changed("key twice", "n = 60\n", "n = 60\nn = 61\n", "TOML")
    yield changed("section of a section", "[fit]", "[machine.axes.X.travel.low]", "TOML")
    for name, after in (("date", "date = 1"), ("fit.n", 'n = "many"'), ("rms", 'rms = "low"')):
        before = {
            "date": 'date = "2026-01-01T00:00:00+00:00"',
            "fit.n": "n = 60",
            "rms": "rms = 0.31",
        }
        for command in READ[1:3]:
            text = model(MODEL.replace(before[name], after, 1))
            title = f"{name}: {after}, {command[-1]}"
            yield Case(title, {"m.toml": text}, command, ("m.toml", f"fit.{name.split('.')[-1]}"))
    for after in ("history = 1", "history = [1]", 'history = ["one"]'):
        text = model(after + "\n" + MODEL[: MODEL.index("[[history]]")])
        yield Case(after, {"m.toml": text}, READ[1], ("m.toml", "history"))
    for after in ('effects = "one"', "rms = true", "rms = [1]", "date = 2025-12-01"):
        key = after.split()[0]
        before = {
            "effects": "effects = 1",
            "rms": "rms = 1.2",
            "date": 'date = "2025-12-01T00:00:00+00:00"',
        }
        text = model(MODEL.replace(before[key], after, 1))
        yield Case(f"history: {after}", {"m.toml": text}, READ[1], ("m.toml", f"history[0].{key}"))


def of_covariance() -> Iterator[Case]:
    """Bad covariances: damaged, of another size, not numbers, a bomb."""
    good = covariance(1e-8, 0.0, 0.0, 1e-8, 0.0, 4e-14)
    bomb = base64.b64encode(zlib.compress(bytes(300_000_000), 9)).decode()
    for name, packed in (
        ("too few numbers", covariance(1.0, 2.0)),
        ("too many numbers", covariance(*[1.0] * 700)),
        ("NaN in it", covariance(1e-8, float("nan"), 0.0, 1e-8, 0.0, 4e-14)),
        ("infinite", covariance(float("inf"), 0.0, 0.0, 1e-8, 0.0, 4e-14)),
        ("a negative variance", covariance(-1e-8, 0.0, 0.0, 1e-8, 0.0, 4e-14)),
        ("a variance of 1e300", covariance(1e300, 0.0, 0.0, 1e-8, 0.0, 4e-14)),
        ("cut off", good[: len(good) // 2 // 4 * 4]),
        ("odd number of bytes", base64.b64encode(zlib.compress(b"1234567")).decode()),
        ("not base 64", "*" + good[1:]),
        ("not ASCII", "ä" + good[1:]),
        ("empty", ""),
        ("not deflated", base64.b64encode(bytes(48)).decode()),
        ("300 MB of zeros", bomb),
    ):
        files = {"m.toml": model(packed=packed)}
        yield Case(f"covariance: {name}", files, CORRECT, ("m.toml", "fit.covariance"))
    for text in ("1", "[1.0, 2.0]", "true", "{ rows = 1 }"):
        yield changed(f"covariance = {text}", '"@COVARIANCE@"', text, "m.toml", "fit.covariance")


def deep() -> Iterator[Case]:
    """Nested deeper than anything means something."""
    for name, more in (
        ("arrays", "x = " + "[" * 5000 + "]" * 5000),
        ("open arrays", "x = " + "[" * 100_000),
        ("tables", "x = " + "{a=" * 3000 + "1" + "}" * 3000),
        ("dotted keys", ".".join("a" * 1 for _ in range(50_000)) + " = 1"),
        ("sections", "[" + ".".join("a" for _ in range(20_000)) + "]"),
        ("many sections", "\n".join(f"[fit.s{i}]" for i in range(30_000))),
        ("a long string", 'x = "' + "y" * 5_000_000 + '"'),
        ("a long number", "x = " + "9" * 100_000),
    ):
        text = more + "\n" + model()
        yield Case(
            f"deep: {name}", {"m.toml": text}, CORRECT, ("m.toml",), may_succeed=name[0] == "m"
        )


def mutated() -> Iterator[Case]:
    """The good model damaged by a machine."""
    good = model().encode()
    damaged = [
        *mutate.whole(good), *mutate.flipped(good, 40, 1), *mutate.cut(good, 20, 2),
        *mutate.lines_mixed(good, 24, 3), *mutate.numbers_replaced(good, 40, 4),
    ]  # fmt: skip
    for i, (name, content) in enumerate(damaged):
        yield Case(
            name, {"m.toml": content}, READ[i % len(READ)], ("m.toml",), True,
            ("out.toml",) if READ[i % len(READ)][0] == "remove" else (),
        )  # fmt: skip


CASES = [*explicit(), *of_covariance(), *deep(), *mutated()]


@pytest.mark.one_in(6)
@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_bad_model_is_reported_in_one_line(case: Case, tmp_path: Path) -> None:
    outcome = run(case, tmp_path)
    assert not faults(case, outcome, tmp_path)
