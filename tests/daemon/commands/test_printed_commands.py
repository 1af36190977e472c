"""Every command that an answer or a page prints runs as it is printed, quotes and all."""

from __future__ import annotations

import ast
import html
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.daemon.command_line import abbe
from tests.support.daemon.small_line import ALPHA, write_campaign, write_model

# whole diagnoses, one after the other: minutes on a busy computer
pytestmark = pytest.mark.timeout(600)

ROOT = Path(__file__).parents[3]
VERBS = "new|fit|add|remove|compare|diagnose|history|correct|table|upload|check|import-[a-z]+"
COMMAND = re.compile(rf"\babbe (?:{VERBS}) [^\n<]*")


def printed(text: str) -> list[str]:
    """The commands in a text, in order, each once."""
    return list(dict.fromkeys(html.unescape(c).strip() for c in COMMAND.findall(text)))


def run(command: str) -> str:
    words = shlex.split(command)
    done = abbe(*words[1:])
    assert done.status == 0, f"{command}\n{done.err}"
    return done.out


@pytest.fixture
def shop(tmp_path, monkeypatch) -> Path:
    """A folder whose name needs quotes, with a fitted model and a campaign that it does not fit."""
    folder = tmp_path / "hall 3"
    folder.mkdir()
    monkeypatch.chdir(folder)
    write_campaign(folder / "CAMPAIGN.csv", seed=1)
    write_campaign(folder / "other.csv", seed=2)
    write_campaign(folder / "warmer.csv", seed=3, alpha=1.4 * ALPHA)
    assert abbe("fit", write_model(folder), folder / "CAMPAIGN.csv", "-o", "f.toml").status == 0
    return folder


def test_a_model_that_was_not_fitted(shop):
    (command,) = printed(abbe("history", shop / "small.toml").out)
    run(command)
    assert (shop / "small-2.toml").exists()
    page = shop / "page.html"
    assert abbe("history", shop / "small.toml", "--report", page).status == 0
    (command,) = printed(page.read_text("utf-8"))
    run(command)
    assert (shop / "small-3.toml").exists()


def test_a_new_model(shop):
    travels = [w for a in "XYZ" for w in ("--travel", f"{a}=-400,500")]
    made = abbe("new", "-o", shop / "my mill.toml", "--structure", "w b Y X Z t", *travels)
    assert made.status == 0, made.err
    commands = printed(made.out)
    assert len(commands) == 1
    run(commands[0])
    assert (shop / "my mill-2.toml").exists()


def test_an_effect_that_was_removed(shop):
    words = ("scale", "axis=X", "--campaign", "CAMPAIGN.csv", "-o", "two effects.toml")
    assert abbe("add", "f.toml", *words).status == 0
    out = shop / "one effect.toml"
    (command,) = printed(abbe("remove", "two effects.toml", "scale", "axis=X", "-o", out).out)
    run(command)
    assert (shop / "one effect-2.toml").exists()


def test_compare_leads_to_diagnose_and_diagnose_to_the_new_values(shop):
    """α is 1.4 times what it was: changed, and the fit that is printed takes the new value in."""
    said = abbe("compare", shop / "f.toml", shop / "warmer.csv").out
    (diagnosing,) = printed(said)
    page = shop / "page.html"
    again = run(f"{diagnosing} --report {shlex.quote(str(page))}")
    assert again.splitlines()[1].startswith("changed:")
    (fitting,) = printed(again)
    assert fitting.startswith("abbe fit ")
    assert fitting in printed(page.read_text("utf-8"))
    run(fitting)
    alpha = re.search(r"alpha\]\nvalue = (\S+)", (shop / "f-2.toml").read_text("utf-8"))
    assert alpha is not None
    assert float(alpha[1]) == pytest.approx(1.4 * ALPHA, rel=0.01)
    # the next time it prints another name: what was written is not overwritten
    assert printed(run(diagnosing))[0].endswith("f-3.toml' --renew")


def test_a_missing_cause_on_the_screen_and_on_the_page(shop):
    bare = shop / "bare.toml"
    text = (shop / "small.toml").read_text("utf-8")
    bare.write_text(text[: text.index("[[effects]]")], encoding="utf-8")
    page = shop / "page.html"
    said = abbe("diagnose", bare, "CAMPAIGN.csv", "--report", page)
    assert said.status == 0, said.err
    on_screen, on_page = printed(said.out), printed(page.read_text("utf-8"))
    assert on_screen
    assert all(c.startswith("abbe add ") for c in on_screen)
    promised = re.search(r"brings the residuals from ([0-9.]+) to ([0-9.]+) µm RMS", said.out)
    assert promised is not None
    for i, command in enumerate((*on_screen, *on_page)):
        done = run(command)
        if i == 0:
            # what was promised beside the first is what comes of it
            before, after = re.search(r"campaigns: (\S+) → (\S+) µm rms", done).groups()
            assert float(before) == pytest.approx(float(promised[1]), abs=0.006)
            assert float(after) == pytest.approx(float(promised[2]), abs=0.006)


def test_what_a_start_model_says_in_its_comments(shop):
    travels = [w for a in "XYZ" for w in ("--travel", f"{a}=-400,500")]
    abbe("new", "-o", "start.toml", "--structure", "w b Y X Z t", *travels)
    commands = printed((shop / "start.toml").read_text("utf-8"))
    run(next(c for c in commands if c.startswith("abbe fit")))


PLACEHOLDER = re.compile(rf"abbe (?:{VERBS}|run|effects)\b[^'\"]*\b(?:MODEL|CAMPAIGN|CONFIG)\b")
SHOWN_AS_A_FORM = {
    # on a page of the catalogue, and where nothing has been measured yet
    "daemon/commands/effects.py",
    "daemon/answers/typed.py",
    "compcore/files/model_toml/commented.py",
    # told through `abbe upload`, which names its configuration (test_upload_printed.py)
    "daemon/commands/tables/upload.py",
    "daemon/answers/tables/upload_words.py",
    "daemon/upload/changeover.py",
    "daemon/upload/steps.py",
    "daemon/upload/outcome.py",
    "daemon/upload/status.py",
}


def test_an_option_that_lacks_another(shop):
    """--apply needs -o and -o needs --apply: the command with both is printed and runs."""
    write_campaign(shop / "my day.csv", seed=5)
    for words, out in ((("--apply",), "f-2.toml"), (("-o", "my next.toml"), "my next.toml")):
        done = abbe("diagnose", "f.toml", "my day.csv", *words)
        assert done.status == 1
        (command,) = printed(done.err)
        assert command == f"abbe diagnose f.toml 'my day.csv' --apply -o {shlex.quote(out)}"
        run(command)
        assert Path(out).exists()


def texts(file: Path) -> Iterator[str]:
    """The strings of a file that are no docstrings."""
    tree = ast.parse(file.read_text("utf-8"))
    docs = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
            yield node.value


def test_no_other_answer_prints_a_command_with_something_left_to_fill_in():
    found = {
        str(file.relative_to(ROOT))
        for folder in ("compcore", "daemon")
        for file in (ROOT / folder).rglob("*.py")
        for text in texts(file)
        if PLACEHOLDER.search(text)
    }
    assert found - SHOWN_AS_A_FORM == set()
