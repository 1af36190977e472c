"""The answer of ``abbe upload``: what was done, as lines and as JSON, with whole commands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from abbe.compcore.sentences import said
from abbe.daemon.answers.typed import uploading
from abbe.daemon.upload.operator_port import OperatorPort
from abbe.daemon.upload.session import Result, UploadRequest


def named(line: str, config: Path) -> str:
    """A line whose command can be typed as it stands."""
    command = "abbe upload CONFIG.toml"
    # without a command it stays the sentence that it is
    return line.replace(command, uploading(config)) if command in line else line


def naming(port: OperatorPort, config: Path) -> OperatorPort:
    """A port that tells whole commands."""
    return replace(port, tell=lambda line: port.tell(named(line, config)))


def result_lines(result: Result, request: UploadRequest) -> list[str]:
    """What became of an upload or a roll-back, for people."""
    if result.outcome is not None:
        return result.outcome.lines()
    if result.cleared is None:
        return [said("the earlier upload has to be brought to its end first; nothing was written")]
    if result.cleared.nothing_to_do:
        return [*result.cleared.lines(), said("it is active already: nothing to do")]
    if request.dry_run:
        return [*result.cleared.lines(), said("dry run: nothing was written")]
    return ["nothing was written"]


def result_json(result: Result, request: UploadRequest) -> dict[str, Any]:
    """One object for ``--json``."""
    return {
        "done": result.ok and not request.dry_run,
        "dry_run": request.dry_run,
        "preflight": None if result.cleared is None else result.cleared.as_json(),
        "nothing_to_do": result.cleared is not None and result.cleared.nothing_to_do,
        "recovered": None if result.recovered is None else result.recovered.as_json(),
        **({} if result.outcome is None else result.outcome.as_json()),
    }
