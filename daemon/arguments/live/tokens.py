"""What ``abbe token`` is given on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from abbe.compcore.errors import InputError
from abbe.daemon.config.tokens import Role


def role_of(word: str) -> Role:
    """``view`` or ``operate``; raises `InputError`."""
    for role in get_args(Role):
        if word == role:
            found: Role = role
            return found
    raise InputError("not a role", found=word, expected="view or operate")


def token_file(config: Path) -> Path:
    """Where a configuration has its tokens.

    The rest of the file need not be in order: with an address to listen at it is not, before there
    is a token.

    Raises
    ------
    InputError
        When it cannot be read, or has no section ``[http]``.
    """
    from abbe.compcore.files.text.toml_source import TomlSource
    from abbe.daemon.config.sections.http import HttpSection

    source = TomlSource.read(config)
    section = source.data.get("http")
    if not isinstance(section, dict):
        raise InputError(
            "is not looked at over HTTP", file=config, field="http", expected="a section [http]"
        )
    name = section.get("tokens", HttpSection().tokens)
    if not isinstance(name, str):
        raise source.error("not a path", ("http", "tokens"), found=name)
    return config.parent.absolute() / name
