from __future__ import annotations

import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.toml_source import TomlSource, dotted, parse_path

TEXT = """\
# a comment with [brackets] and key = value
format = "x"

[machine]
name = "m"
[machine.axes.X]   # trailing comment
travel = [
    0.0,
    1.0,
]

[[effects]]
kind = "one"

[[effects]]
kind = "two"
[effects.parameters.alpha]
value = 1.0
sd = 2.0

[[effects]]
"kind" = "three"
parameters.beta.value = 3.0
"""


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("format",), 2),
        (("machine",), 4),
        (("machine", "name"), 5),
        (("machine", "axes", "X"), 6),
        (("machine", "axes", "X", "travel"), 7),
        (("machine", "axes", "X", "travel", 1), 7),
        (("effects", 0), 12),
        (("effects", 0, "kind"), 13),
        (("effects", 1, "kind"), 16),
        (("effects", 1, "parameters", "alpha"), 17),
        (("effects", 1, "parameters", "alpha", "sd"), 19),
        (("effects", 1, "shape"), 15),
        (("effects", 2, "kind"), 22),
        (("effects", 2, "parameters", "beta", "value"), 23),
        (("machine", "axes", "Y"), 4),
        (("nowhere",), None),
    ],
)
def test_lines(path, line):
    assert TomlSource(TEXT).line_of(path) == line


def test_nested_arrays_of_tables():
    text = "[[a]]\n[[a.b]]\nx = 1\n[[a.b]]\nx = 2\n[[a]]\n[[a.b]]\nx = 3\n"
    source = TomlSource(text)
    assert source.line_of(("a", 0, "b", 1, "x")) == 5
    assert source.line_of(("a", 1, "b", 0, "x")) == 8


def test_text_inside_strings_is_not_a_key():
    text = 'note = """\n[machine]\nname = 1\n"""\n[machine]\nname = "m"\n'
    assert TomlSource(text).line_of(("machine", "name")) == 6


def test_not_toml_names_file_and_line():
    with pytest.raises(InputError, match=r"m\.toml, line 2: not valid TOML"):
        TomlSource("a = 1\nb = \n", "m.toml")
    with pytest.raises(InputError, match=r"m\.toml, line 3: not valid TOML"):
        TomlSource('a = 1\nb = """\n', "m.toml")


def test_reading_a_file(tmp_path):
    path = tmp_path / "a.toml"
    path.write_bytes('﻿name = "µ"\r\nx = 1\r\n'.encode())  # as Windows' Notepad saves it
    source = TomlSource.read(path)
    assert source.data == {"name": "µ", "x": 1}
    assert source.line_of(("x",)) == 2


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        TomlSource.read(tmp_path / "none.toml")
    with pytest.raises(InputError, match="is a folder"):
        TomlSource.read(tmp_path)
    latin = tmp_path / "latin.toml"
    latin.write_bytes("name = 'é'".encode("latin-1"))
    with pytest.raises(InputError, match="not UTF-8 text"):
        TomlSource.read(latin)


def test_errors_are_located():
    source = TomlSource(TEXT, "m.toml")
    error = source.located(InputError("bad", field="effects[1].kind", found="two"))
    assert str(error) == "m.toml, line 16, field 'effects[1].kind': bad: found 'two'"
    assert source.error("bad", ("machine", "name"), expected="text").line == 5


def test_paths_round_trip():
    for path in [("effects", 2, "shape"), ("a",), ("fit", "x", 0, "y")]:
        assert parse_path(dotted(path)) == path
