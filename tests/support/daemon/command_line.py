"""Running the command line inside the tests' own process, as a shell would."""

from __future__ import annotations

import contextlib
import io
import sys
from dataclasses import dataclass
from unittest import mock

from abbe.daemon.cli import main


@dataclass(frozen=True)
class Done:
    """Exit status and what was written."""

    status: int
    out: str
    err: str


def abbe(*arguments: object) -> Done:
    """Run ``abbe ARGUMENTS``."""
    out, err = io.StringIO(), io.StringIO()
    status = 0
    with (
        mock.patch.object(sys, "argv", ["abbe", *map(str, arguments)]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            main()
        except SystemExit as done:
            status = done.code if isinstance(done.code, int) else 1
    return Done(status, out.getvalue(), err.getvalue())
