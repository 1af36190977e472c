"""A user's command by which LinuxCNC is ended and started again, run to its end."""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Sequence
from pathlib import Path

from abbe.drivers.link import LinkError, LinkTimeoutError


async def run_command(command: Sequence[str], folder: Path, limit: float) -> None:
    """Run a command; what it leaves running in the background goes on.

    Parameters
    ----------
    command
        Programme and arguments; no shell.
    folder
        Where it runs.
    limit
        s for it to end.

    Raises
    ------
    LinkTimeoutError
        When it does not end; it is killed then.
    LinkError
        When it cannot be run or its status is not 0.
    """
    text = " ".join(command)
    # a file, not a pipe: what goes on in the background would keep a pipe open
    with tempfile.TemporaryFile() as output:
        try:
            process = await asyncio.create_subprocess_exec(
                *command,
                cwd=folder,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )
        except OSError as error:
            raise LinkError(f"{command[0]}: {error.strerror}") from error
        try:
            status = await asyncio.wait_for(process.wait(), limit)
        except TimeoutError:
            process.kill()
            await process.wait()
            raise LinkTimeoutError(f"{text} did not end in {limit:.0f} s") from None
        if status:
            output.seek(0)
            said = output.read().decode(errors="replace").strip().splitlines()
            raise LinkError(
                f"{text} ended with status {status}" + (f": {said[-1]}" if said else "")
            )
