"""Patterns of lines: whatever they are, a line holds the event loop up for milliseconds only."""

from __future__ import annotations

import time

import pytest
from pydantic import ValidationError

from abbe.drivers.serial.config import SerialConfig
from abbe.drivers.serial.patterns import LIMIT, LinePattern, SlowPatternError, checked, simple_up_to
from abbe.drivers.serial.question import SerialQuestion
from tests.support.drivers.serial.links import section

ROOM = 0.5
"""s that a shared machine may add."""


def config(**keys: str) -> SerialConfig:
    message = {"query": "R"} | keys
    return section("/dev/null", {"messages": {"m": message}, "channels": {"x": {"message": "m"}}})


def test_a_nested_repetition_is_read_at_once() -> None:
    question = SerialQuestion("m", r"(?P<x>(\d+)+)")
    began = time.monotonic()
    assert question.match([b"1" * 128])["x"] == "1" * 128
    assert not question.fits(b"1" * 60 + b"x")
    assert time.monotonic() - began < ROOM


def test_a_line_that_takes_too_long_is_given_up() -> None:
    pattern = LinePattern(r"(?P<x>(q|qq)+)")
    began = time.process_time()
    with pytest.raises(SlowPatternError, match="takes more than"):
        pattern.fullmatch("q" * 60 + "w")
    assert time.process_time() - began < 20 * LIMIT + ROOM
    # and, as the answer to a query, is one that does not fit
    assert not SerialQuestion("m", pattern.text).fits(b"q" * 60 + b"w")


@pytest.mark.parametrize("bad", [r"(?P<x>(\d|\d\d)+)", r"(?P<x>(\S|\S\S)+)"])
def test_an_ambiguous_pattern_is_one_clear_error(bad: str) -> None:
    began = time.process_time()
    with pytest.raises(ValidationError, match="takes too long over a line of") as caught:
        config(pattern=bad)
    assert caught.value.error_count() == 1
    with pytest.raises(ValidationError, match=r"refused: pattern .* takes too long"):
        config(pattern=r"(?P<x>\d+)", refused=bad)
    assert time.process_time() - began < ROOM


def test_what_cannot_be_compiled_is_one_clear_error() -> None:
    for bad in ("(", "a" * 5000, r"(?P<x>\d+)\9"):
        began = time.process_time()
        with pytest.raises(ValueError, match="pattern"):
            checked(bad).fields.index("x")
        assert time.process_time() - began < ROOM


@pytest.mark.parametrize(
    ("pattern", "longest"),
    [
        (r"(?P<x>[-+.\d]+)", 65_536),
        (r"X(?P<x>[-+.\d]+) Y(?P<y>[-+.\d]+) Z(?P<z>[-+.\d]+)", 104),
        (r"[]+]+ \)+", 630),
        (r"x?[^]\]+]+y*z*", 82),
        (r"(\d+)+", -1),
        (r"(?:ab)*", -1),
        (r"(a|ab)c+", -1),
        (r"(?P<a>.)(?P=a)+", -1),
        (r"(.)\1+", -1),
        (r"(?=x).+", -1),
        (r"(?x) a + b", -1),
    ],
)
def test_up_to_which_length_a_pattern_is_certainly_fast(pattern: str, longest: int) -> None:
    assert simple_up_to(pattern) == longest


@pytest.mark.parametrize(
    "pattern", [r"\d*\d*\d*x", r"\d*\d*x", r"(\d+)(\d+)(\d+)\D", r"\d?" * 9 + "x"]
)
def test_no_line_of_that_length_takes_long(pattern: str) -> None:
    made, line = LinePattern(pattern), "1" * min(simple_up_to(pattern), 4096)
    began = time.process_time()
    assert made.fullmatch(line) is None
    assert made.fullmatch(line + "1") is None  # and one more is given to the other one
    assert time.process_time() - began < ROOM


def test_a_busy_computer_makes_no_pattern_bad(monkeypatch):
    matched, calls = LinePattern.fullmatch, []

    def slow_twice(pattern, text):
        calls.append(text)
        if calls.count(text) < 3:
            raise SlowPatternError("another thread had the processor")
        return matched(pattern, text)

    monkeypatch.setattr(LinePattern, "fullmatch", slow_twice)
    LinePattern(r"X(?P<x>[-+.\d]+)").check()
    assert len(calls) == 3 * len(set(calls))
