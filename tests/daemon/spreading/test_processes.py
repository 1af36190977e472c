"""Work spread over processes here: the same to the bit, killed workers, what is kept."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path

import pytest

from abbe.compcore.errors import AbbeError, InputError
from abbe.daemon.spreading.engine import ATTEMPTS, InThisProcess, Numbered, WorkLostError
from abbe.daemon.spreading.kept_answers import KeptAnswers
from abbe.daemon.spreading.process_pool import ProcessPool
from abbe.daemon.spreading.spread import SpreadPlace, in_order, spread
from abbe.daemon.spreading.spread_work import SpreadTask, TaskAnswer, TaskPayload, perform
from tests.support.daemon.spread_functions import NAME


def noted(folder: Path, count: int) -> list[partial[SpreadTask]]:
    asked = [json.dumps({"folder": str(folder), "task": i}) for i in range(count)]
    return [partial(SpreadTask, NAME + "once_noted", argument) for argument in asked]


def done(folder: Path) -> Counter[str]:
    """Task → how often it was carried out."""
    return Counter(f.name.split("-")[0] for f in folder.glob("*-*-*"))


class EndsEarly:
    """An engine that is lost after some answers."""

    def __init__(self, after: int) -> None:
        self.after = after

    def carry_out(self, tasks: Iterable[Numbered]) -> Iterator[tuple[int, TaskAnswer]]:
        for i, (number, task) in enumerate(tasks):
            if i == self.after:
                raise WorkLostError("the scheduler is lost")
            yield number, perform(TaskPayload.of(task))


@pytest.mark.integration
def test_a_killed_process_costs_nothing_but_its_own_task(tmp_path: Path) -> None:
    tasks = [
        partial(SpreadTask, NAME + "dying",
                json.dumps({"folder": str(tmp_path), "task": i, "times": 2 if i == 3 else 0}))
        for i in range(8)
    ]  # fmt: skip
    answers = list(spread(tasks, SpreadPlace(ProcessPool(2))))
    assert sorted(answers) == [(i, str(i).encode()) for i in range(8)]  # each once
    assert (tmp_path / "died-3").read_text() == "xx"


@pytest.mark.integration
def test_a_task_that_kills_every_process_is_said(tmp_path: Path) -> None:
    asked = json.dumps({"folder": str(tmp_path), "task": 0, "times": 99})
    tasks = [partial(SpreadTask, NAME + "dying", asked, {}, "machine 4711")]
    with pytest.raises(WorkLostError, match=f"machine 4711 died {ATTEMPTS} times"):
        list(spread(tasks, SpreadPlace(ProcessPool(2))))


def test_a_lost_run_is_gone_on_with_by_the_same_command(tmp_path: Path) -> None:
    notes, keep = tmp_path / "notes", tmp_path / "work.sqlite"
    notes.mkdir()
    tasks = noted(notes, 6)
    with pytest.raises(WorkLostError, match=r"after 4 of 6 tasks, kept in .*the same command"):
        list(spread(tasks, SpreadPlace(EndsEarly(4), keep, lasting=False)))
    assert sum(done(notes).values()) == 4
    found = in_order(spread(tasks, SpreadPlace(InThisProcess(), keep, lasting=False)), 6)
    assert found == [str(i).encode() for i in range(6)]
    assert set(done(notes).values()) == {1}  # nothing was done twice
    assert not keep.exists()  # all were answered


def test_kept_answers_last_when_asked_and_damage_is_no_answer(tmp_path: Path) -> None:
    notes, keep = tmp_path / "notes", tmp_path / "work.sqlite"
    notes.mkdir()
    place = SpreadPlace(InThisProcess(), keep)
    for _ in range(2):
        assert len(list(spread(noted(notes, 3), place))) == 3
    assert set(done(notes).values()) == {1}
    kept = KeptAnswers(keep)
    kept._base.execute("UPDATE answers SET body = x'00'")
    kept.close()
    assert in_order(spread(noted(notes, 3), place), 3) == [b"0", b"1", b"2"]
    assert set(done(notes).values()) == {2}


def test_another_content_is_another_question() -> None:
    one, two = (SpreadTask(NAME + "reversed_text", "a", {"file": body}) for body in (b"x", b"y"))
    assert one.identity != two.identity
    payload = TaskPayload.of(one)
    payload.contents["file"] = b"y"
    assert "did not arrive as it was sent" in perform(payload).problem


def test_another_version_is_refused_by_the_task_itself() -> None:
    payload = TaskPayload.of(SpreadTask(NAME + "reversed_text", "a"))
    payload.versions["Abbe"] = "0.0.9 (deadbeef)"
    assert "other versions: Abbe 0.1.0" in perform(payload).problem


def test_what_a_task_refuses_is_said_with_its_name() -> None:
    tasks = [partial(SpreadTask, NAME + "refusing", "", {}, "machine 4711")]
    with pytest.raises(AbbeError, match=r"machine 4711: part.toml, line 7, field 'at': no such"):
        list(spread(tasks))


def test_another_program_s_file_is_not_written_to(tmp_path: Path) -> None:
    import sqlite3

    for name, body in (("text", b"not a database, but somebody's"), ("base", None)):
        path = tmp_path / name
        if body is None:
            base = sqlite3.connect(path)
            base.execute("CREATE TABLE mine (x)")
            base.commit()
            base.close()
        else:
            path.write_bytes(body)
        before = path.read_bytes()
        with pytest.raises(InputError, match="--keep"):
            KeptAnswers(path)
        assert path.read_bytes() == before
