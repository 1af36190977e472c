"""What a step's process hands on: lines with what they were made of, faults likewise."""

from __future__ import annotations

import io
import json

from abbe.compcore import sentences
from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.sentences import joined, remembered, said, sentences_in
from abbe.daemon.commands.calibration.step_child import SaidLines


def test_a_line_that_is_a_sentence_says_what_it_was_made_of() -> None:
    out = io.StringIO()
    with remembered() as made:
        lines = SaidLines(out, made)
        inner = said("{axis} is {size} off", axis="X", size=said("far"))
        lines.write(f"   {inner}\nno sentence\n")
        lines.write(str(said("  indented: {what}", what=inner)))
        lines.write("\nhalf a line")
    moved, plain, indented = out.getvalue().splitlines()
    parts = {"X is far off": ["{axis} is {size} off", {"axis": "X", "size": "far"}],
             "far": ["far", {}]}  # fmt: skip
    assert json.loads(moved) == {"line": "   X is far off", "sentences": parts}
    assert plain == "no sentence"
    known = json.loads(indented)["sentences"]
    assert known["  indented: X is far off"][0] == "  indented: {what}"
    assert known.items() >= parts.items()


def test_nothing_is_remembered_longer_than_it_is_wanted() -> None:
    with remembered() as made:
        said("one")
    said("two")
    assert list(made) == ["one"]


def test_the_newest_are_remembered(monkeypatch) -> None:
    monkeypatch.setattr(sentences, "_MOST", 3)
    with remembered() as made:
        for number in range(9):
            said("{n}", n=number)
    assert list(made) == ["6", "7", "8"]


def test_a_fault_is_a_sentence_of_its_place_and_what_is_wrong() -> None:
    error = InputError(
        "not a number", file="a.csv", line=7, field="value", found="abc",
        expected=said("{low} to {high}", low="1", high="2 µm"),
    )  # fmt: skip
    text = "a.csv, line 7, field 'value': not a number: found 'abc', expected 1 to 2 µm"
    assert error.sentence == str(error) == text
    known = sentences_in(error.sentence)
    assert known["not a number"] == ["not a number", {}]
    assert known["line 7"] == ["line {number}", {"number": "7"}]
    assert known["1 to 2 µm"][0] == "{low} to {high}"
    told = AbbeError(said("{file} is gone", file="a.csv"))
    assert told.sentence.template == "{file} is gone"
    assert AbbeError("as it stands {}").sentence.template == "as it stands {}"


def test_more_than_an_alphabet_in_a_row() -> None:
    assert joined([str(n) for n in range(60)], ",") == ",".join(str(n) for n in range(60))


def test_a_place_that_stands_alone_is_a_sentence_of_its_own() -> None:
    """Wrapped in a row of one it had the same text, and could not be told in another language."""
    found = sentences_in(InputError("unknown key", field="links", expected="a word").sentence)
    assert found["field 'links'"] == ["field {name}", {"name": "'links'"}]
    assert found["expected a word"] == ["expected {what}", {"what": "a word"}]
