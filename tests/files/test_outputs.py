"""No command writes over what it reads, over another output, or over what is not Abbe's."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tests.support.daemon.command_line import abbe
from tests.support.daemon.shop_floor import FITTED, MODEL, TASKS, furnish, line_of

READS = [(task, name) for task, what in TASKS.items() for name in what.reads]


@pytest.fixture
def shop(tmp_path: Path) -> Path:
    """A folder with all inputs."""
    furnish(tmp_path)
    return tmp_path


def contents(folder: Path) -> dict[str, bytes]:
    """Name → content of every file, hidden ones too."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def refused(words: list[str], folder: Path, *expected: str) -> None:
    """A command ends with one line on standard error, and every file is what it was."""
    before = contents(folder)
    done = abbe(*words)
    assert (done.status, done.out) == (1, ""), done
    assert done.err.startswith("abbe: ")
    assert done.err.count("\n") == 1, done.err
    for part in expected:
        assert part in done.err
    assert contents(folder) == before


@pytest.mark.parametrize("task", TASKS)
def test_every_task_does_its_work(shop: Path, task: str):
    done = abbe(*line_of(task)(shop, shop / "out.x"))
    assert (done.status, done.err) == (0, "") or done.err.startswith("abbe: note"), done
    assert (shop / "out.x").stat().st_size
    # and once more over what it wrote itself
    done = abbe(*line_of(task)(shop, shop / "out.x"))
    assert done.status == 0, done


@pytest.mark.one_in(3)
@pytest.mark.parametrize(("task", "name"), READS)
@pytest.mark.parametrize("way", ["name", "spelling", "symbolic link", "hard link", "--force"])
def test_an_input_is_never_overwritten(shop: Path, task: str, name: str, way: str):
    out = shop / name
    if way == "spelling":
        (shop / "sub").mkdir()
        out = shop / "sub" / ".." / name
    elif way == "symbolic link":
        (shop / "one").symlink_to(shop / name)
        (shop / "link").symlink_to("one")
        out = shop / "link"
    elif way == "hard link":
        out = shop / "hard"
        out.hardlink_to(shop / name)
    words = line_of(task)(shop, out)
    if way == "--force":
        words.append("--force")
    refused(words, shop, str(out), "this command reads that file", "another name")


@pytest.mark.one_in(3)
@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("content", [b"my notes\n", b"\x89PNG\r\n\x1a\n\0\0", b"a,b\n1,2\n"])
def test_a_foreign_file_is_overwritten_with_force_only(shop: Path, task: str, content: bytes):
    out = shop / "there.x"
    out.write_bytes(content)
    words = line_of(task)(shop, out)
    refused(words, shop, "is something else than what would be written", "--force")
    assert abbe(*words, "--force").status == 0
    assert out.read_bytes() != content


def test_a_measurement_writes_over_nothing_and_offers_nothing_of_the_kind(tmp_path: Path):
    for name in ("plan.toml", "config.toml", "notes.csv"):
        (tmp_path / name).write_text("my notes\n")
    words = ["measure", "--yes", *(str(tmp_path / n) for n in ("plan.toml", "config.toml"))]
    refused(
        [*words, "-o", str(tmp_path / "notes.csv")], tmp_path, "is something else", "a new name"
    )
    assert "--force" not in abbe(*words, "-o", tmp_path / "notes.csv").err


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("empty", [True, False])
def test_a_file_of_its_own_kind_is_overwritten(shop: Path, task: str, empty: bool):
    out = shop / "there.x"
    out.write_text("" if empty else TASKS[task].kind)
    done = abbe(*line_of(task)(shop, out))
    assert done.status == 0, done
    assert out.read_text() != TASKS[task].kind


@pytest.mark.parametrize("link", [False, True])
def test_two_outputs_onto_one_file_are_refused(shop: Path, link: bool):
    out, other = shop / "x", shop / "x"
    if link:
        other = shop / "y"
        other.symlink_to("x")
    words = ["fit", shop / "model.toml", shop / "day.csv", "-o", out, "--report", other]
    refused([str(w) for w in words], shop, "two outputs would go to one place")
    refused([*map(str, words), "--force"], shop, "two outputs would go to one place")


def null_device(folder: Path) -> Path:
    """A null device; for root a copy, so that a mistake does not cost the system its own."""
    if os.geteuid():
        return Path(os.devnull)
    copy = folder / "null"
    try:
        os.mknod(copy, 0o666 | stat.S_IFCHR, os.makedev(1, 3))
        copy.write_bytes(b"")
    except OSError:
        pytest.skip("no devices can be made here")
    return copy


@pytest.mark.parametrize("task", [t for t in TASKS if t != "import-grid"])
def test_devices_pipes_and_folders(shop: Path, task: str):
    null = null_device(shop)
    before = null.stat()
    assert abbe(*line_of(task)(shop, null)).status == 0
    now = null.stat()
    assert (now.st_ino, now.st_rdev, now.st_mode) == (
        before.st_ino,
        before.st_rdev,
        before.st_mode,
    )
    pipe = shop / "pipe"
    os.mkfifo(pipe)
    found: list[bytes] = []
    reader = threading.Thread(target=lambda: found.append(pipe.read_bytes()), daemon=True)
    reader.start()
    assert abbe(*line_of(task)(shop, pipe)).status == 0
    reader.join(60)
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert found
    assert len(found[0]) > 40
    pipe.unlink()
    refused(line_of(task)(shop, shop), shop, "Is a directory")
    refused(line_of(task)(shop, shop / "no" / "x"), shop, "No such file or directory")


def test_a_full_device_is_one_message(shop: Path):
    refused(line_of("fit")(shop, "/dev/full"), shop, "/dev/full: cannot be written: No space left")


@pytest.mark.parametrize("task", TASKS)
def test_a_link_stays_and_what_it_leads_to_is_replaced(shop: Path, task: str):
    (shop / "real").mkdir()
    link = shop / "link.x"
    link.symlink_to("real/there.x")  # dangling at first
    for _ in range(2):
        assert abbe(*line_of(task)(shop, link)).status == 0
        assert link.is_symlink()
        assert (shop / "real" / "there.x").is_file()
    assert sorted(p.name for p in (shop / "real").iterdir()) == ["there.x"]


def test_links_in_a_circle(shop: Path):
    (shop / "a").symlink_to("b")
    (shop / "b").symlink_to("a")
    done = abbe(*line_of("import-map")(shop, shop / "a"))
    assert done.status == 1
    assert "a: cannot be written" in done.err


def test_umask_and_mode_are_kept(shop: Path):
    old = os.umask(0o027)
    try:
        out = shop / "out.toml"
        assert abbe(*line_of("import-map")(shop, out)).status == 0
        assert stat.S_IMODE(out.stat().st_mode) == 0o640
        out.chmod(0o604)
        assert abbe(*line_of("import-map")(shop, out)).status == 0
        assert stat.S_IMODE(out.stat().st_mode) == 0o604
    finally:
        os.umask(old)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_the_owner_is_kept(shop: Path):
    out = shop / "out.toml"
    out.write_text(MODEL)
    os.chown(out, 12345, 23456)
    assert abbe(*line_of("import-map")(shop, out)).status == 0
    assert (out.stat().st_uid, out.stat().st_gid) == (12345, 23456)


def test_a_write_protected_file_is_left_alone(shop: Path):
    out = shop / "out.toml"
    out.write_text(MODEL)
    out.chmod(0o444)
    refused([*line_of("fit")(shop, out), "--force"], shop, "write-protected", "chmod u+w")


def process(*words: object, **more: object) -> subprocess.CompletedProcess[bytes]:
    """The command line as a process of its own."""
    command = [sys.executable, "-m", "abbe.daemon", *map(str, words)]
    return subprocess.run(command, check=False, timeout=60, **{"capture_output": True, **more})  # type: ignore[call-overload,no-any-return]


@pytest.mark.one_in(4)
@pytest.mark.parametrize("out", ["-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
def test_standard_output_takes_the_file_and_nothing_else(shop: Path, out: str):
    done = process(*line_of("import-map")(shop, out))
    assert done.returncode == 0
    assert done.stdout.startswith(b'format = "abbe-model/1"')
    assert b"2 rows" in done.stderr
    kept = shop / "kept"
    with kept.open("ab") as stream:
        stream.write(b"before\n")
        stream.flush()
        process(*line_of("import-map")(shop, out), stdout=stream, capture_output=False)
    assert kept.read_bytes().startswith(b'before\nformat = "abbe-model/1"')
    both = process(*line_of("fit")(shop, out), "--json")
    assert both.returncode == 1
    assert b"cannot take both" in both.stderr


def test_an_output_is_not_where_standard_output_goes(shop: Path):
    log = shop / "log.toml"
    with log.open("wb") as stream:
        done = process(
            *line_of("import-map")(shop, log),
            stdout=stream,
            stderr=subprocess.PIPE,
            capture_output=False,
        )
    assert done.returncode == 1
    assert b"found 'standard output'" in done.stderr


def test_a_descriptor_of_the_shell_is_written_to(shop: Path):
    read, write = os.pipe()
    done = process(*line_of("import-map")(shop, f"/dev/fd/{write}"), pass_fds=(write,))
    os.close(write)
    with os.fdopen(read, "rb") as stream:
        assert stream.read().startswith(b'format = "abbe-model/1"')
    assert done.returncode == 0


class TestTables:
    """``abbe table -o DIR``."""

    def words(self, shop: Path, *more: object) -> list[str]:
        words = ["table", shop / "fitted.toml", "--controller", "linuxcnc", *more]
        return [str(w) for w in words]

    def test_over_its_own_set_only(self, shop: Path):
        folder = shop / "tables"
        words = self.words(shop, "-o", folder)
        assert abbe(*words).status == 0
        assert abbe(*words).status == 0
        table = sorted(p for p in folder.iterdir() if p.name != "abbe-tables.json")[0]
        table.write_text(table.read_text() + "\n")
        refused(words, shop, str(table), "was changed since Abbe made it", "--force")
        (folder / "abbe-tables.json").unlink()
        refused(words, shop, str(table), "no record of Abbe's tables", "--force")
        assert abbe(*words, "--force").status == 0

    def test_over_a_foreign_record(self, shop: Path):
        folder = shop / "tables"
        folder.mkdir()
        (folder / "abbe-tables.json").write_text('{"my": "notes"}')
        refused(self.words(shop, "-o", folder), shop, "abbe-tables.json", "--force")

    def test_over_what_was_active(self, shop: Path):
        folder = shop / "tables"
        assert abbe(*self.words(shop, "-o", folder)).status == 0
        again = self.words(shop, "-o", folder, "--on", folder, "--force")
        refused(again, shop, "this command reads that file")

    def test_a_model_with_the_name_of_a_table(self, shop: Path):
        folder = shop / "tables"
        assert abbe(*self.words(shop, "-o", folder)).status == 0
        table = sorted(p for p in folder.iterdir() if p.name != "abbe-tables.json")[0]
        table.write_text(FITTED)
        words = ["table", str(table), "--controller", "linuxcnc", "-o", str(folder), "--force"]
        refused(words, shop, "this command reads that file")

    def test_a_file_in_the_folders_place(self, shop: Path):
        refused(self.words(shop, "-o", shop / "notes.txt"), shop, "is not a folder")


def test_the_demo_keeps_to_its_own_folder(shop: Path):
    (shop / "campaign.csv").write_text("mine\n")
    refused(["demo", "--out", str(shop)], shop, "is not of an earlier demo", "--force")
