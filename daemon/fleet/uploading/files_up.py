"""A machine's files uploaded: models, campaigns and rows of check measurements."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from abbe.daemon.fleet.store.connecting import Store, one_line
from abbe.daemon.fleet.store.plain import plain, plain_json
from abbe.daemon.fleet.uploading.inserting import AT, Columns, Say, insert_rows
from abbe.daemon.fleet.uploading.machine_files import (
    FolderFiles,
    StoredFile,
    check_readings,
    fitted_at,
    is_campaign,
    sha256_of,
)

_CHECKS: Columns = {
    "machine": "int", "key": "text", "number": "int", "time": "time", "reading": "jsonb"
}  # fmt: skip


class FilesUpload:
    """What is uploaded of a machine's files over one connection, each a transaction of its own.

    Parameters
    ----------
    store
        Connected as the machine's writer.
    machine
        Its number in the store.
    task
        As `Uploader` has it.
    say
        Takes a level and a sentence for the journal.
    """

    def __init__(self, store: Store, machine: int, task: Mapping[str, Any], say: Say) -> None:
        self._store, self._machine, self._task, self._say = store, machine, task, say
        folder = Path(task["folder"])
        self._campaign_files = FolderFiles(folder, task["campaigns"], self._warn)
        self._model_files = FolderFiles(folder, [task["model"], *task["models"]], self._warn)
        self._checked = ""

    def _warn(self, text: str) -> None:
        self._say(logging.WARNING, text)

    def models(self) -> None:
        """Upload the model files that have changed, and say which one runs."""
        running = Path(self._task["folder"]) / self._task["model"]
        for file in self._model_files.changed(settled=False):
            try:
                fitted = fitted_at(file.content)
            except (ValueError, UnicodeDecodeError):
                continue
            with self._store.transaction():
                if not self._has("models", file):
                    self._store.execute(
                        "INSERT INTO abbe.models (machine, sha256, path, fitted, content) "
                        "VALUES (%s, %s, %s, %s, %s) ON CONFLICT DO NOTHING",
                        (self._machine, file.sha256, plain(file.path), fitted, file.content),
                    )
                if Path(self._task["folder"]) / file.path == running:
                    self._store.execute(
                        "UPDATE abbe.machines SET model = %s WHERE machine = %s",
                        (file.sha256, self._machine),
                    )

    def campaigns(self) -> None:
        """Upload the campaign files that have changed."""
        for file in self._campaign_files.changed(settled=True):
            if is_campaign(file.content):
                self._put_campaign(file)

    def _put_campaign(self, file: StoredFile) -> None:
        path = plain(file.path)
        with self._store.transaction():
            if not self._has("campaigns", file):
                self._store.execute(
                    "INSERT INTO abbe.campaigns (machine, sha256, path, changed, content) "
                    f"VALUES (%s, %s, %s, {AT}, %s) ON CONFLICT DO NOTHING",
                    (self._machine, file.sha256, path, file.changed, file.content),
                )
            self._store.execute(
                "UPDATE abbe.campaigns SET current = true, path = %s "
                "WHERE machine = %s AND sha256 = %s AND (NOT current OR path <> %s)",
                (path, self._machine, file.sha256, path),
            )
            self._store.execute(
                "UPDATE abbe.campaigns SET current = false "
                "WHERE machine = %s AND path = %s AND sha256 <> %s AND current",
                (self._machine, path, file.sha256),
            )

    def _has(self, table: str, file: StoredFile) -> bool:
        """Whether the store has a content: it may be large, and is not sent for nothing."""
        found = self._store.execute(
            f"SELECT 1 FROM abbe.{table} WHERE machine = %s AND sha256 = %s".encode(),
            (self._machine, file.sha256),
        )
        return found.fetchone() is not None

    def checks(self) -> None:
        """Upload the rows of check measurements."""
        path = Path(self._task["checks"])
        if not path.is_file():
            return
        content = path.read_bytes()
        digest = sha256_of(content)
        if digest == self._checked:
            return
        try:
            head, readings = check_readings(content)
        except (ValueError, KeyError) as error:
            self._say(logging.WARNING, f"{path} is not uploaded: {one_line(error)}")
            self._checked = digest
            return
        with self._store.transaction():
            insert_rows(
                self._store,
                self._say,
                "abbe.checks",
                _CHECKS,
                [(self._machine, r.key, r.number, r.time, plain_json(r.reading)) for r in readings],
            )
            self._store.execute(
                "UPDATE abbe.machines SET checks_head = %s WHERE machine = %s",
                (plain(head), self._machine),
            )
        self._checked = digest
