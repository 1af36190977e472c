"""Sets in folders: always an old set or a new one, whole, wherever the power is cut.

A child process switches from set to set and is cut off before each of its file operations in turn.
Three kinds of cut: the process is killed; the power fails and of each file only what was forced to
the disk is there; the power fails, and also the entries of folders that were not forced are as they
were before.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from abbe.drivers.stores.set_folders import SetFolders

NAMES = ("x.comp", "y.comp", "z.comp")
OLD = {n: f"0 {i} {i}\n" for i, n in enumerate(NAMES)}
NEW = {n: f"0 1{i} 1{i}\r\n" for i, n in enumerate(NAMES)}

# Cuts itself off before its n-th operation inside the root, for n = 1, 2, … until it comes through.
CHILD = r"""
import json, os, shutil, sys, traceback
from pathlib import Path
from abbe.drivers.stores.set_folders import SetFolders

home, kind, what = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
old, new = json.loads(sys.argv[4]), json.loads(sys.argv[5])
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT
EVENTS = ("os.mkdir", "os.rename", "os.symlink", "os.remove", "os.rmdir", "open", "fsync")

def entries(folder):
    found = {}
    for e in os.scandir(folder):
        kind = "link" if e.is_symlink() else "folder" if e.is_dir() else "file"
        found[e.name] = (kind, os.readlink(e.path) if kind == "link" else e.inode())
    return found

def child(root, n):
    count = 0
    on = False
    forced = set()       # inodes of files that were forced to the disk
    kept = {}            # folder -> its entries when it was forced last
    trash = root.parent / (root.name + ".trash")

    def cut(status=9):
        nonlocal on
        on = False
        if kind == "unforced files":
            for path in root.rglob("*"):
                if path.is_file() and not path.is_symlink() and path.stat().st_ino not in forced:
                    path.write_bytes(b"")
        if kind == "unforced entries":
            # links only: a folder whose files are gone is the kind before this one
            for folder, was in kept.items():
                if not Path(folder).is_dir():
                    continue
                now = entries(folder)
                for name, (sort, told) in now.items():
                    if sort == "link" and was.get(name) != (sort, told):
                        (Path(folder) / name).unlink()
                        if was.get(name, ("",))[0] == "link":
                            (Path(folder) / name).symlink_to(was[name][1])
        os._exit(status)

    def tick():
        nonlocal count
        count += 1
        if count == n:
            cut()

    def hook(event, arguments):
        if not on or event not in EVENTS or not arguments:
            return
        if event == "open" and not (isinstance(arguments[2], int) and arguments[2] & WRITES):
            return
        if str(root) in str(arguments[0]) or str(root) in str(arguments[-1]) + str(arguments[1]):
            tick()

    really = os.fsync
    def fsync(descriptor):
        tick()
        really(descriptor)
        path = os.readlink(f"/proc/self/fd/{descriptor}")
        if os.path.isdir(path):
            kept[path] = entries(path)
        else:
            forced.add(os.fstat(descriptor).st_ino)

    for path in root.rglob("*"):   # what was there has long been on the disk
        if path.is_dir() and not path.is_symlink():
            kept[str(path)] = entries(path)
        elif path.is_file():
            forced.add(path.stat().st_ino)
    kept[str(root)] = entries(root)
    sys.addaudithook(hook)
    os.fsync = fsync
    folders = SetFolders(root)
    on = True
    if what == "switch":
        folders.write_next(new, {})
        folders.switch()
        folders.note({"at": 1.0})
        folders.discard_next()
    elif what == "first":
        folders.write_next(new, {"a.comp": "0 0 0\n"})
        folders.switch()
    elif what == "clear":
        folders.discard_next()
    cut(0)  # what was done has to stay done

for n in range(1, 1000):
    root = home / f"{n:03d}"
    if what == "first":
        root.mkdir()
    else:
        shutil.copytree(home / "start", root, symlinks=True)
    pid = os.fork()
    if pid == 0:
        try:
            child(root, n)
        except BaseException:
            traceback.print_exc()
        os._exit(1)
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    if status != 9:
        break
print(json.dumps({"status": status, "cuts": n - 1}))
"""
KINDS = ("killed", "unforced files", "unforced entries")


def cut_everywhere(home: Path, kind: str, what: str) -> list[Path]:
    """The roots that are left, one for each place of the cut; the last one came through."""
    done = subprocess.run(
        [sys.executable, "-c", CHILD, str(home), kind, what, json.dumps(OLD), json.dumps(NEW)],
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert answer["status"] == 0, done.stderr
    return [home / f"{n:03d}" for n in range(1, answer["cuts"] + 2)]


def started(home: Path) -> None:
    """The old set is current, and has been written before."""
    root = home / "start"
    folders = SetFolders(root)
    folders.write_next(OLD, {})
    folders.switch()
    folders.note({"at": 0.0})
    folders.discard_next()
    assert folders.read_current(NAMES) == OLD


@pytest.mark.integration
@pytest.mark.parametrize("kind", KINDS)
def test_a_cut_leaves_the_old_set_or_the_new_one_whole(tmp_path: Path, kind: str) -> None:
    started(tmp_path)
    roots = cut_everywhere(tmp_path, kind, "switch")
    assert len(roots) > 20
    seen = []
    for root in roots:
        folders = SetFolders(root)
        read = {n: (root / "current" / n).read_bytes().decode() for n in NAMES}
        assert read in (OLD, NEW)
        assert folders.read_current(NAMES) == read
        assert folders.read_next() in (None, OLD, NEW)
        seen.append(read == NEW)
        # and from there all goes on as if nothing had been
        for again in (NEW, OLD):
            folders.write_next(again, {})
            assert folders.read_next() == again
            folders.switch()
            assert folders.read_current(NAMES) == again
        folders.discard_next()
        assert len(list((root / "sets").iterdir())) == 1
    assert seen == sorted(seen)
    assert not seen[0]
    assert seen[-1]


@pytest.mark.integration
@pytest.mark.parametrize("kind", KINDS)
def test_a_cut_in_the_very_first_upload_leaves_none_or_all(tmp_path: Path, kind: str) -> None:
    roots = cut_everywhere(tmp_path, kind, "first")
    assert SetFolders(roots[-1]).read_current(NAMES) == NEW
    for root in roots:
        folders = SetFolders(root)
        assert folders.read_current(NAMES) in ({}, NEW)
        if (root / "current").exists():
            assert (root / "current" / "a.comp").read_text() == "0 0 0\n"
        folders.write_next(NEW, {"a.comp": "0 0 0\n"})
        folders.switch()
        assert folders.read_current(NAMES) == NEW


@pytest.mark.integration
def test_a_cut_while_the_rest_is_removed_never_touches_what_is_current(tmp_path: Path) -> None:
    started(tmp_path)
    SetFolders(tmp_path / "start").write_next(NEW, {})
    for root in cut_everywhere(tmp_path, "unforced files", "clear"):
        folders = SetFolders(root)
        assert folders.read_current(NAMES) == OLD
        assert folders.read_next() in (None, NEW)


def test_a_damaged_folder_is_never_taken_for_a_set(tmp_path: Path) -> None:
    folders = SetFolders(tmp_path)
    folders.write_next(NEW, {})
    file = (tmp_path / "next" / "y.comp").resolve()
    file.write_text("0 0 0\n")
    assert folders.read_next() is None
    folders.write_next(NEW, {})
    assert folders.read_next() == NEW
    folders.switch()
    file.write_text("0 0 0\n")
    with pytest.raises(ValueError, match="y.comp is not the file that set.sha256 lists"):
        folders.read_current(NAMES)
    with pytest.raises(OSError, match="is current and was damaged"):
        folders.write_next(NEW, {})
    folders.write_next(OLD, {})
    folders.switch()
    assert folders.read_current(NAMES) == OLD


def test_sha256sum_agrees(tmp_path: Path) -> None:
    folders = SetFolders(tmp_path)
    folders.write_next(NEW, {})
    folders.switch()
    done = subprocess.run(
        ["sha256sum", "-c", "set.sha256"],
        cwd=folders.current,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.count(": OK") == len(NAMES)


def test_facts_belong_to_the_set_that_is_current(tmp_path: Path) -> None:
    folders = SetFolders(tmp_path)
    assert folders.switched() is None
    folders.write_next(OLD, {})
    folders.switch()
    assert folders.switched() is None
    folders.note({"at": 3.5})
    assert folders.switched() == {"set": str(folders.current.readlink()), "at": 3.5}
    folders.write_next(NEW, {})
    assert folders.switched() is not None
    folders.switch()
    assert folders.switched() is None


def test_a_set_by_hand_is_read_and_a_plain_folder_refused(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "x.comp").write_bytes(b"0 0 0\r\n")
    (tmp_path / "current").symlink_to("mine")
    folders = SetFolders(tmp_path)
    folders.check()
    assert not folders.is_own()
    assert folders.read_current(NAMES) == {"x.comp": "0 0 0\r\n"}
    folders.write_next(NEW, {})
    folders.switch()
    folders.discard_next()
    assert folders.is_own()
    assert (mine / "x.comp").exists()
    folders.current.unlink()
    mine.rename(folders.current)
    with pytest.raises(ValueError, match="mv current mine && ln -s mine current"):
        folders.check()
