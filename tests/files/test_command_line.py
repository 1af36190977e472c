"""Full and broken output, interruptions, names that are no UTF-8: one line and a true status."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.daemon.command_line import abbe
from tests.support.daemon.shop_floor import MODEL, furnish, line_of

EXAMPLE = Path(__file__).parents[2] / "examples" / "bridge-cmm" / "config.toml"
# six commands one after the other, on a busy computer
pytestmark = pytest.mark.timeout(600)

PRINTING = [
    "--version",
    "--help",
    "effects",
    "controllers",
    "history fitted.toml --json",
    "compare fitted.toml day.csv --json",
    "diagnose fitted.toml day.csv --json",
    "fit model.toml day.csv -o out.toml",
    "iso230 day.csv",
    "correct fitted.toml X=1 Y=2 Z=-3",
    "correct fitted.toml --points points.csv -o out.csv",
    "remove fitted.toml positioning axis=X shape=polynomial:2 -o out.toml",
    "table fitted.toml --controller linuxcnc -o out",
    f"check {EXAMPLE}",
    f"run --duration 3 {EXAMPLE}",
    f"run --duration 3 --json {EXAMPLE}",
]


@pytest.fixture
def shop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with all inputs, and the present one."""
    furnish(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def process(*words: str | bytes, code: str = "", **more: object) -> subprocess.Popen[bytes]:
    """The command line as a process of its own, after `code`."""
    start = [sys.executable, "-c", f"{code}\nfrom abbe.daemon.cli import main; main()"]
    return subprocess.Popen([*start, *words], stderr=subprocess.PIPE, **more)  # type: ignore[call-overload,no-any-return]


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("line", "unbuffered"),
    [(line, "") for line in PRINTING] + [(line, "1") for line in ("--version", "effects")],
)
def test_a_full_standard_output_is_one_line_and_a_status(shop: Path, line: str, unbuffered: str):
    with Path("/dev/full").open("wb") as full:
        running = process(
            *line.split(), stdout=full, env={**os.environ, "PYTHONUNBUFFERED": unbuffered}
        )
        _, said = running.communicate(timeout=300)
    lines = [x for x in said.decode().splitlines() if x.startswith("abbe: ")]
    [message] = lines
    assert message.startswith("abbe: standard output c")
    assert "be written: No space left on device" in message
    assert running.returncode == 1
    assert b"Traceback" not in said
    assert b"ignored" not in said
    if not line.startswith("run"):
        assert len(said.splitlines()) == 1


@pytest.mark.parametrize("line", ["effects", "history fitted.toml --json", "controllers"])
def test_a_reader_that_goes_away_is_no_error(shop: Path, line: str):
    read, write = os.pipe()
    os.close(read)
    running = process(*line.split(), stdout=write)
    os.close(write)
    assert running.communicate(timeout=300)[1] == b""


INTERRUPT_AT = """
import importlib.abc, os, signal, sys
class Interrupt(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupt())
"""


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    "name",
    ["typer", "abbe.compcore.errors", "abbe.daemon.application",
     "abbe.daemon.commands.model.fit", "numpy", "pydantic", "abbe.compcore.fitting.fit",
     "abbe.compcore.files.model_file", "tomli_w"],
)  # fmt: skip
def test_an_interruption_while_python_imports_is_one_line(shop: Path, name: str):
    words = ["fit", "model.toml", "day.csv", "-o", "out.toml"]
    running = process(*words, code=INTERRUPT_AT.format(name=name), stdout=subprocess.PIPE)
    out, said = running.communicate(timeout=300)
    assert (running.returncode, out, said) == (130, b"", b"abbe: interrupted\n")
    assert not (shop / "out.toml").exists()


def test_little_is_imported_before_interruptions_are_caught():
    root = str(EXAMPLE.parents[2])
    code = f"import sys; sys.path.insert(0, {root!r}); import abbe.daemon.cli; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-S", "-E", "-c", code], capture_output=True, check=True)
    slow = {"typing", "contextlib", "re", "pathlib", "typer", "numpy"}
    assert not slow & set(done.stdout.decode().split())


@pytest.mark.parametrize(
    "task", ["fit", "import-campaign", "import-map", "correct", "compare", "remove"]
)
def test_an_interruption_while_a_file_is_written_leaves_the_old_one(
    shop: Path, monkeypatch: pytest.MonkeyPatch, task: str
):
    out = shop / "out.x"
    assert abbe(*line_of(task)(shop, out)).status == 0
    before = {p: p.read_bytes() for p in shop.iterdir()}

    def interrupted(_handle: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    done = abbe(*line_of(task)(shop, out))
    assert (done.status, done.out, done.err) == (130, "", "abbe: interrupted\n")
    assert {p: p.read_bytes() for p in shop.iterdir()} == before


def test_a_command_leaves_the_interruptions_of_its_process_alone(shop: Path):
    before = signal.getsignal(signal.SIGINT)
    assert abbe("history", shop / "fitted.toml").status == 0
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.thorough
def test_names_that_are_no_utf_8(shop: Path):
    names = {n: os.fsdecode(n.encode() + b"\xff\xe9") for n in ("m", "c", "o", "r", "t")}
    (shop / names["m"]).write_text(MODEL)
    (shop / names["c"]).write_bytes((shop / "day.csv").read_bytes())
    for line in (
        "fit m c -o o --report r --json",
        "diagnose o c --report r --json",
        "table o --controller linuxcnc -o t --report r --json",
    ):
        words = [names.get(word, word) for word in line.split()]
        if words[0] == "fit":  # how a process reads its arguments one of them shows
            running = process(*map(os.fsencode, words), stdout=subprocess.PIPE)
            out, said = running.communicate(timeout=300)
            assert (running.returncode, said) == (0, b""), line
        else:
            done = abbe(*words)
            out, said = done.out, done.err
            assert (done.status, said) == (0, ""), line
        json.loads(out)
        assert (shop / names["r"]).read_text(encoding="utf-8")
    said = abbe("history", names["o"] + "no").err
    assert said == "abbe: o\\udcff\\udce9no: no such file\n"


def test_a_name_with_line_ends_is_reported_in_one_line(shop: Path):
    assert abbe("history", "a\nb\x1b").err == "abbe: a\\nb\\x1b: no such file\n"
