"""Answers kept on disk as they come, so that a run that ends early is gone on with.

One SQLite file; an answer is found by its task's identity, so that it is counted once, whoever
gave it and how often.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterable
from pathlib import Path

from abbe.compcore.errors import InputError

_APPLICATION = 0x41626265
"""``Abbe`` in the file's head: no other program's database is written to."""
_SCHEMA = """
CREATE TABLE IF NOT EXISTS answers (
    identity TEXT PRIMARY KEY, digest TEXT NOT NULL, body BLOB NOT NULL, seconds REAL NOT NULL
) WITHOUT ROWID;
"""


class KeptAnswers:
    """A file of answers.

    Parameters
    ----------
    path
        The file; made where it is not there.

    Raises
    ------
    InputError
        When it is another program's, or cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        fresh = not path.exists() or path.stat().st_size == 0
        try:
            self._base = sqlite3.connect(path, isolation_level=None, timeout=10.0)
            found = self._base.execute("PRAGMA application_id").fetchone()[0]
            if not fresh and found != _APPLICATION:
                raise InputError(
                    "is not a file of answers that Abbe keeps", file=path,
                    expected="another name (--keep)",
                )  # fmt: skip
            self._base.execute(f"PRAGMA application_id = {_APPLICATION}")
            self._base.execute("PRAGMA journal_mode = WAL")
            self._base.execute("PRAGMA synchronous = NORMAL")
            self._base.executescript(_SCHEMA)
        except sqlite3.DatabaseError as error:
            raise InputError(f"cannot be kept: {error}", file=path,
                             expected="another name (--keep)") from None  # fmt: skip

    def answer(self, identity: str) -> bytes | None:
        """The answer of a task; None where there is none, or a damaged one."""
        row = self._base.execute(
            "SELECT digest, body FROM answers WHERE identity = ?", (identity,)
        ).fetchone()
        if row is None or hashlib.sha256(row[1]).hexdigest() != row[0]:
            return None
        return bytes(row[1])

    def keep(self, identity: str, body: bytes, seconds: float) -> None:
        """Keep an answer; a second one of the same task changes nothing."""
        digest = hashlib.sha256(body).hexdigest()
        try:
            self._base.execute(
                "INSERT OR REPLACE INTO answers VALUES (?, ?, ?, ?)",
                (identity, digest, body, seconds),
            )
        except sqlite3.DatabaseError as error:
            raise InputError(f"cannot be kept: {error}", file=self.path) from None

    def forget(self, identities: Iterable[str]) -> None:
        """Forget answers that are not needed any more, and the file where nothing is left."""
        self._base.executemany("DELETE FROM answers WHERE identity = ?", ((i,) for i in identities))
        left = self._base.execute("SELECT count(*) FROM answers").fetchone()[0]
        self.close()
        if not left:
            self.path.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the file."""
        self._base.close()
