"""The role that a request of the workbench has: by a token of the configuration's ``[http]``."""

from __future__ import annotations

import logging
from pathlib import Path

from fastapi import HTTPException, Request

from abbe.compcore.errors import AbbeError
from abbe.daemon.arguments.live.tokens import token_file
from abbe.daemon.config.tokens import TokenFile
from abbe.daemon.http.gate import Gate

_LOG = logging.getLogger(__name__)


def operating(config: Path, request: Request, by: str) -> str:
    """Who asks for what takes the role ``operate``, for the journal.

    Parameters
    ----------
    config
        The configuration; its tokens count.
    request
        The request, with its token as Bearer.
    by
        The name that was typed; may be empty.

    Raises
    ------
    HTTPException
        Where the token is none, or of another role.
    """
    try:
        tokens = TokenFile(token_file(config))
    except AbbeError as error:
        raise HTTPException(403, f"this takes a token of the role operate: {error}") from None
    visitor = Gate(tokens, (), _LOG.log).visitor(request.scope)
    if not (visitor.role == "operate" and visitor.bearer):
        raise HTTPException(
            403,
            f"this takes a token of the role operate: abbe token add {config} NAME --role operate",
        )
    said = " ".join(by.split())
    return f"{said}, {visitor.who}" if said else visitor.who
