"""The workbench's own words: each in every language, and none in English on a German page."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from abbe.compcore.campaign.measuring_conditions import STATED
from abbe.compcore.diagnosis.explain import page_sentences
from abbe.compcore.diagnosis.shop_words import templates
from abbe.compcore.effects import make_effect
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.planning.undetermined import titles
from abbe.daemon.application import app
from abbe.daemon.report.language import language
from abbe.drivers.controllers import controller_kinds, make_controller
from abbe.drivers.transducers.base import TransducerFault
from tests.support.compcore.catalogue import ROWS
from tests.support.daemon.german import as_pattern

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

BRIDGE = Path(__file__).parents[1] / "data" / "p03-bridge"
STATIC = Path(__file__).parents[2] / "daemon" / "workbench" / "static"
LANGUAGES = sorted((STATIC / "words").glob("*.json"))


def used() -> set[str]:
    """Every text that the page says in its own words."""
    found = set()
    for path in STATIC.rglob("*.js"):
        if not path.name.endswith(".min.js"):
            script = path.read_text("utf-8")
            found |= set(re.findall(r'(?<![\w.])t\("((?:[^"\\]|\\.)+)"', script))
    for path in STATIC.rglob("*.html"):
        page = path.read_text("utf-8")
        found |= set(re.findall(r"data-t>([^<]+)<", page))
        for tag in re.findall(r"<[^>]*data-t-label[^>]*>", page):
            found |= set(re.findall(r'aria-label="([^"]+)"', tag))
        for tag in re.findall(r"<[^>]*data-t-hint[^>]*>", page):
            found |= set(re.findall(r'placeholder="([^"]+)"', tag))
    return found


def words_of(path: Path) -> tuple[dict[str, str], dict[str, str]]:
    """Its own words, and the names and headings that the server gives."""
    words = json.loads(path.read_text("utf-8"))
    assert words.pop("_language")
    del words["_sentences"]
    return words, words.pop("_labels")


def said_somewhere() -> set[str]:
    """The template of every sentence that a command says with its parts: ``said("…", …)``."""
    found = {*templates(), *page_sentences(), *titles()}
    for folder in ("compcore", "daemon"):
        for path in (STATIC.parents[2] / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                if not isinstance(node, ast.Call):
                    continue
                # of a number of things the words for one, and those for several
                words = {"said": node.args[:1], "counted": node.args[1:3]}
                for template in words.get(getattr(node.func, "id", ""), []):
                    if isinstance(template, ast.Constant):
                        found.add(str(template.value))
    # of values alone there is nothing to translate
    return {text for text in found if re.search(r"\w", re.sub(r"{\w+}", "", text))}


READERS = ("files/campaign_csv", "files/text/bounded_text.py", "files/campaign_file.py")
"""What reads that which is dropped on a page."""


def faults() -> tuple[set[str], list[str]]:
    """What a reader says is wrong, and what it expects; where it says so without a template."""
    found, bare = set(), []
    compcore = STATIC.parents[2] / "compcore"
    files = [
        p for n in READERS for p in ([compcore / n], (compcore / n).rglob("*.py"))["." not in n]
    ]
    for path in files:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            words = {"InputError": node.args[:1], "_refuse": node.args[2:]}.get(name, [])
            for part in (
                *words,
                *(k.value for k in node.keywords if words and k.arg == "expected"),
            ):
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    found.add(part.value)
                elif isinstance(part, ast.JoinedStr | ast.BinOp):
                    bare.append(f"{path.name}, line {part.lineno}")
    return {text for text in found if re.search(r"[^\W\d]{2}", text)}, bare


FAULTS_SEEN = (
    "daemon/config", "drivers/transducers", "daemon/pipeline/reading", "compcore/validation.py",
    "compcore/files/text",
)  # fmt: skip
"""Rooms whose faults a page shows without having asked: a configuration changed, a sensor torn."""
_FAULTS = {"InputError", "ValueError", "LinkConfigError", "error"}
_OF_LINKS = {"LinkError", "LinkTimeoutError", "LinkDownError", "LinkProtocolError", "FieldError",
             "SubscriptionLostError", "RefusedError", "ControlRefusesError", "AbortCodeError",
             "GoneError", "TooLateError", "WriteNotVerifiedError"}  # fmt: skip
"""What goes wrong with a link while it is used."""


def with_places(node: ast.AST) -> str:
    """A text of the code, `7` where a value comes; empty for anything else."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(with_places(part) if isinstance(part, ast.Constant) else "7"
                       for part in node.values)  # fmt: skip
    return ""


def sensor_faults() -> set[str]:
    """What a transducer says of a raw number that is no measurement."""
    found = set()
    for path in (STATIC.parents[2] / "drivers" / "transducers").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "SensorFaultError":
                which, detail = node.args
                if isinstance(which, ast.Attribute) and (said := with_places(detail)):
                    found.add(f"{TransducerFault[which.attr].value}: {said}")
    return found


def shown_faults() -> set[str]:
    """What those rooms say is wrong and what they expect, as a person may read it."""
    found = set()
    root = STATIC.parents[2]
    for room, kinds in (*((r, _FAULTS) for r in FAULTS_SEEN), ("drivers", _OF_LINKS)):
        for path in [root / room] if room.endswith(".py") else sorted((root / room).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                if not isinstance(node, ast.Call):
                    continue
                if getattr(node.func, "id", getattr(node.func, "attr", "")) not in kinds:
                    continue
                if getattr(getattr(node.func, "value", None), "id", "") == "logger":
                    continue
                parts = (*node.args[:1], *(k.value for k in node.keywords if k.arg == "expected"))
                found |= {with_places(part) for part in parts}
    # of commands, addresses and names of keys there is nothing to translate
    return {text for text in found if re.search(r"[a-z]{3,} [a-z]", text) and "abbe " not in text}


@pytest.mark.parametrize("path", LANGUAGES, ids=lambda path: path.stem)
def test_a_language_has_the_faults_that_a_page_shows(path: Path) -> None:
    words = json.loads(path.read_text("utf-8"))
    patterns = [as_pattern(text) for text in words["_labels"] | words["_sentences"]]
    typed = ("pip install", "chmod", "writable = true")
    said = {text for text in shown_faults() if not text.startswith(typed)} | sensor_faults()
    assert len(said) > 100
    assert sorted(text for text in said if not any(p.fullmatch(text) for p in patterns)) == []


@pytest.mark.parametrize("path", LANGUAGES, ids=lambda path: path.stem)
def test_what_stands_within_a_fault_is_translated_too(path: Path) -> None:
    """The first colon ends a name, whatever follows has colons, too."""
    said = language(path.stem).say("signal T_x1: broken wire: 429.5 MΩ, above 1 MΩ")
    assert "broken" not in said
    assert "above" not in said


@pytest.mark.parametrize("path", LANGUAGES, ids=lambda path: path.stem)
def test_a_language_has_every_sentence_of_the_commands(path: Path) -> None:
    sentences = json.loads(path.read_text("utf-8"))["_sentences"]
    of_readers, bare = faults()
    assert bare == []
    assert len(of_readers) > 40
    said = said_somewhere() | of_readers
    assert len(said) > 90
    assert sorted(said - set(sentences)) == []
    assert sorted(set(sentences) - said) == []
    for english, own in sentences.items():
        assert own.strip(), english
        # a value may be said once where English says it twice, never another one
        assert set(re.findall(r"{\w+}", own)) == set(re.findall(r"{\w+}", english)), english


@pytest.mark.parametrize("path", LANGUAGES, ids=lambda path: path.stem)
def test_a_language_has_every_word_and_no_other(path: Path) -> None:
    words, labels = words_of(path)
    assert len(words) > 150
    assert sorted(used() - set(words)) == []
    assert sorted(set(words) - used()) == []
    for english, own in (words | labels).items():
        assert own.strip(), english
        assert sorted(re.findall(r"{\w+}", own)) == sorted(re.findall(r"{\w+}", english))


@pytest.mark.parametrize("path", LANGUAGES, ids=lambda path: path.stem)
def test_a_language_has_what_every_parameter_is(path: Path) -> None:
    patterns = [as_pattern(english) for english in words_of(path)[1]]
    described = set()
    for row in ROWS:
        effect = make_effect(row.kind, row.keys)
        for p in (*effect.linear(row.machine), *effect.nonlinear(row.machine)):
            # what is only a name of the field, as E_CC, A1, is the same everywhere
            if re.search(r"\b[a-z]{3}", p.description):
                described.add(p.description)
    assert len(described) > 60
    assert [d for d in sorted(described) if not any(p.fullmatch(d) for p in patterns)] == []


@pytest.mark.parametrize("path", LANGUAGES, ids=lambda path: path.stem)
def test_a_language_has_the_lines_of_abbe_table(path: Path, tmp_path: Path) -> None:
    """As the step of a calibration prints them; numbers and names of axes are everybody's."""
    labels, sentences = words_of(path)[1], json.loads(path.read_text("utf-8"))["_sentences"]
    patterns = [as_pattern(text) for text in labels | sentences]
    words = ["table", str(BRIDGE / "model.toml"), "--controller", "csv", "-o", str(tmp_path / "t")]
    made = CliRunner().invoke(app, words)
    assert made.exit_code == 0, made.output
    lines = [line.strip() for line in made.output.splitlines() if re.search(r"[a-z]{3}", line)]
    assert len(lines) > 15
    # a table's own row: its name, a comma, its types, and numbers
    own = re.compile(r"csv, [\w+-]+ [\d. ]+")
    bare = [line for line in lines if not own.fullmatch(line)]
    assert [line for line in bare if not any(p.fullmatch(line) for p in patterns)] == []


@pytest.mark.parametrize("path", LANGUAGES, ids=lambda path: path.stem)
def test_a_language_has_what_is_done_at_each_controller(path: Path) -> None:
    """What its numbers mean, and how its tables get to act."""
    patterns = [as_pattern(text) for text in words_of(path)[1]]
    bridge = Machine("", Structure.parse("w b X Y Z t"), {a: Axis(a, (0.0, 500.0)) for a in "XYZ"})
    said = set()
    ways: list[tuple[str, dict[str, str]]] = [(kind, {}) for kind in controller_kinds()]
    for kind, options in (*ways, ("twincat-isg", {"form": "axes"})):
        controller = make_controller(kind, bridge, options)
        said |= {controller.sign, *controller.activation()}
    assert len(said) > 60
    assert [text for text in sorted(said) if not any(p.fullmatch(text) for p in patterns)] == []


def test_what_is_text_of_a_script_is_translated() -> None:
    """A sentence that is put into an element without `t` would stay English."""
    bare = []
    for path in STATIC.rglob("*.js"):
        if not path.name.endswith(".min.js"):
            found = re.findall(r'[,?:] "([A-Z][a-z]+ [a-z][^"\\]*)"', path.read_text("utf-8"))
            bare += [f"{path.name}: {text}" for text in found if text not in STATED.values()]
    assert bare == []
