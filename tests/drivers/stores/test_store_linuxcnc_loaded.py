"""Which set a LinuxCNC has loaded, by when it was started; each task here is a made-up process."""

from __future__ import annotations

import json
from pathlib import Path

from abbe.drivers.linuxcnc.running import Task, since_boot
from abbe.drivers.stores.linuxcnc.loaded import loaded, note_switch, restart_needed
from abbe.drivers.stores.set_folders import SetFolders

A, B = {"x.comp": "0 0 0\n"}, {"x.comp": "1 1 1\n"}


def switch(folders: SetFolders, files: dict[str, str], task: Task | None) -> str:
    """As the store does it; the name of the set."""
    before = loaded(folders, task)
    folders.write_next(files, {})
    folders.switch()
    note_switch(folders, task, before)
    return str(folders.current.readlink())


def test_what_runs_keeps_what_it_loaded(tmp_path: Path) -> None:
    folders = SetFolders(tmp_path)
    assert not restart_needed(folders, None)
    a = switch(folders, A, None)
    assert not restart_needed(folders, None)
    task = Task(100, since_boot() + 1.0)
    assert not restart_needed(folders, task)
    assert loaded(folders, task) == a
    b = switch(folders, B, task)
    assert restart_needed(folders, task)
    assert loaded(folders, task) == a
    assert not restart_needed(folders, None)
    # back again before any restart, and forth
    assert switch(folders, A, task) == a
    assert not restart_needed(folders, task)
    assert switch(folders, B, task) == b
    assert restart_needed(folders, task)
    # a new process, even of the same number
    assert not restart_needed(folders, Task(100, since_boot() + 2.0))


def test_what_started_before_or_during_the_switch_is_not_trusted(tmp_path: Path) -> None:
    folders = SetFolders(tmp_path)
    started = since_boot()
    switch(folders, A, None)
    assert restart_needed(folders, Task(100, started))
    assert loaded(folders, Task(100, started)) == ""
    before = loaded(folders, None)
    folders.write_next(B, {})
    folders.switch()
    note_switch(folders, Task(101, since_boot()), before)
    assert restart_needed(
        folders, Task(101, json.loads((tmp_path / "switched.json").read_text())["task"][1])
    )


def test_killed_between_the_switch_and_the_note(tmp_path: Path) -> None:
    folders = SetFolders(tmp_path)
    switch(folders, A, None)
    task = Task(100, since_boot() + 1.0)
    folders.write_next(B, {})
    folders.switch()
    assert restart_needed(folders, task)
    assert restart_needed(folders, task)
    assert not restart_needed(folders, Task(101, since_boot() + 2.0))


def test_since_another_boot_everything_has_started_anew(tmp_path: Path) -> None:
    folders = SetFolders(tmp_path)
    task = Task(100, since_boot() + 1.0)
    switch(folders, A, task)
    switch(folders, B, task)
    assert restart_needed(folders, task)
    file = tmp_path / "switched.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"boot": "another"}))
    assert not restart_needed(folders, task)


def test_a_link_made_by_hand_counts_as_loaded(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "current").symlink_to("mine")
    folders = SetFolders(tmp_path)
    task = Task(100, since_boot())
    assert not restart_needed(folders, task)
    assert loaded(folders, task) == "mine"
