"""Tokens of the HTTP interface: who may look, who may operate; kept as SHA-256 only.

A token is 256 random bits, so that its plain SHA-256 tells nothing of it; the token itself is shown
once, when it is made.
"""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import os
import re
import secrets
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Literal

import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.files.text.toml_source import TomlSource

Role = Literal["view", "operate"]
"""What a token is good for: to look, or to change what runs besides."""
_BYTES = 32
_MODE = 0o640
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_HEAD = "# Written by `abbe token`. Holds no token, only what each is recognised by.\n"


class Token(BaseModel):
    """What is kept of one token."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    role: Role
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    created: datetime
    expires: datetime | None = None

    @property
    def expired(self) -> bool:
        """Whether its time is over."""
        return self.expires is not None and datetime.now(UTC) >= _aware(self.expires)


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["abbe-tokens/1"]
    tokens: dict[str, Token] = Field(default_factory=dict)


def read_tokens(path: Path) -> dict[str, Token]:
    """Name → token; none where the file is not there.

    Raises
    ------
    InputError
        When the file is not in order.
    """
    if not path.exists():
        return {}
    source = TomlSource.read(path)
    try:
        return dict(_File.model_validate(source.data).tokens)
    except ValidationError as error:
        raise source.invalid(error) from None


def add_token(path: Path, name: str, role: Role, days: float | None = None) -> str:
    """Make a token; it is returned here and kept nowhere.

    Parameters
    ----------
    path
        File of tokens; made where it is not there.
    name
        Of who will use it, for the journal.
    role
        What it is good for.
    days
        For which it is; None: until it is removed.

    Raises
    ------
    InputError
        For a name that there is already, or that cannot be one; when the file is not in order.
    """
    tokens = read_tokens(path)
    if not _NAME.fullmatch(name):
        raise InputError(
            "cannot name a token",
            found=repr(name),
            expected="letters, digits, _ . -, at most 64, beginning with a letter or digit",
        )
    if name in tokens:
        raise InputError(
            "there is a token of that name", file=path, found=name, expected="remove it first"
        )
    secret = secrets.token_urlsafe(_BYTES)
    now = datetime.now(UTC).replace(microsecond=0)
    expires = None if days is None else now + timedelta(days=days)
    token = Token(role=role, sha256=_digest(secret), created=now, expires=expires)
    _write(path, {**tokens, name: token})
    return secret


def remove_token(path: Path, name: str) -> None:
    """Have a token count no more, also in what runs.

    Raises
    ------
    InputError
        When there is none of that name.
    """
    tokens = read_tokens(path)
    if name not in tokens:
        raise InputError(
            "no such token",
            file=path,
            found=name,
            expected=f"one of {', '.join(tokens)}" if tokens else "a token",
        )
    del tokens[name]
    _write(path, tokens)


def token_of(secret: str, tokens: Mapping[str, Token]) -> tuple[str, Token] | None:
    """Name and token that a secret is of; None for a foreign or expired one.

    Takes the same time for all of them.
    """
    digest = _digest(secret)
    found = None
    for name, token in tokens.items():
        if hmac.compare_digest(digest, token.sha256) and not token.expired:
            found = name, token
    return found


class TokenFile:
    """A file of tokens that is read anew when it has changed.

    Parameters
    ----------
    path
        The file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stamp: tuple[int, int, int] | None = None
        self._tokens: dict[str, Token] = {}

    def tokens(self) -> Mapping[str, Token]:
        """The tokens that count now; none while the file is not in order.

        Raises
        ------
        InputError
            Once, when the file has become one that is not in order.
        """
        try:
            found = self._path.stat()
            stamp = found.st_mtime_ns, found.st_size, found.st_ino
        except OSError:
            stamp = 0, 0, 0
        if stamp != self._stamp:
            self._stamp, self._tokens = stamp, {}
            self._tokens = read_tokens(self._path)
        return self._tokens


def _write(path: Path, tokens: Mapping[str, Token]) -> None:
    content = {
        "format": "abbe-tokens/1",
        "tokens": {n: t.model_dump(exclude_none=True) for n, t in tokens.items()},
    }
    write_atomically(path, _HEAD + tomli_w.dumps(content))
    # the service reads it by its group, as the configuration beside it
    with contextlib.suppress(OSError):
        os.chown(path, -1, path.parent.stat().st_gid)
    with contextlib.suppress(OSError):
        path.chmod(_MODE)


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode("utf-8", "surrogateescape")).hexdigest()


def _aware(moment: datetime) -> datetime:
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)
