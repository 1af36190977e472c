"""The bridge process as Abbe sees it: started, asked, and noticed when it ends."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

from abbe.drivers.link import LinkDownError, LinkProtocolError, LinkTimeoutError, TooLateError

BRIDGE = Path(__file__).with_name("bridge.py")
_START = 10.0
"""s for the bridge to be ready."""
_GRACE = 1.0
"""s on top of the ramp for it to end by itself, before it is told to, and then killed."""


class BridgeProcess:
    """One bridge process; one request at a time.

    Parameters
    ----------
    python
        The interpreter that has LinuxCNC's modules.
    settings
        As `abbe.drivers.linuxcnc.bridge` describes.
    on_lost
        Called with the reason when it ends by itself.
    script
        What runs: `BRIDGE`, or one that answers more.
    """

    def __init__(
        self,
        python: str,
        settings: dict[str, Any],
        on_lost: Callable[[str], None],
        script: Path = BRIDGE,
    ) -> None:
        self._command = (python, str(script), json.dumps(settings))
        self._ramp: float = settings["ramp"]
        self._on_lost = on_lost
        self._process: asyncio.subprocess.Process | None = None
        self._answer: asyncio.Future[dict[str, Any]] | None = None
        self._number = 0
        self._reader: asyncio.Task[None] | None = None
        self._complaint = ""
        self._closing = False

    async def start(self) -> dict[str, Any]:
        """Start it; hands back what it tells of LinuxCNC.

        Raises
        ------
        LinkDownError
            When LinuxCNC is not running, or the bridge cannot run; says why.
        """
        loop = asyncio.get_running_loop()
        answer = self._answer = loop.create_future()
        try:
            self._process = await asyncio.create_subprocess_exec(
                *self._command,
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.PIPE,
            )
        except OSError as error:
            raise LinkDownError(f"cannot start {self._command[0]}: {error.strerror}") from error
        self._reader = asyncio.create_task(self._read(self._process), name="linuxcnc bridge")
        try:
            said = await asyncio.wait_for(answer, _START)
        except TimeoutError:
            raise LinkDownError(f"the bridge to LinuxCNC is not ready in {_START:g} s") from None
        finally:
            self._answer = None
        ready: dict[str, Any] = said["ready"]
        return ready

    async def ask(self, order: dict[str, Any], within: float) -> dict[str, Any]:
        """Send an order and wait for its answer, at most `within` s.

        Raises
        ------
        LinkTimeoutError
            When it does not answer; the process is of no use any more.
        LinkDownError
            When it ends, or has ended.
        LinkProtocolError
            When the order cannot be carried out; says why.
        TooLateError
            When its `until` was over before it was carried out.
        """
        process = self._process
        if process is None or process.stdin is None or process.returncode is not None:
            raise LinkDownError("the bridge to LinuxCNC has ended")
        answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._answer = answer
        give_up = asyncio.get_running_loop().call_later(within, _expire, answer)
        try:
            self._number += 1
            said = json.dumps({"id": self._number} | order)
            process.stdin.write(said.encode() + b"\n")
            found = await answer
        except TimeoutError:
            raise LinkTimeoutError(
                f"the bridge to LinuxCNC did not answer in {within:g} s"
            ) from None
        finally:
            give_up.cancel()
            self._answer = None
        if "late" in found:
            raise TooLateError("too old before it reached LinuxCNC, so not set")
        if "failed" in found:
            raise LinkProtocolError(found["failed"])
        return found

    def abandon(self) -> None:
        """Let it go without waiting: it takes the offsets back and ends."""
        self._closing = True
        self._fail("the bridge to LinuxCNC was closed")
        if self._process is not None and self._process.stdin is not None:
            self._process.stdin.close()

    async def close(self) -> None:
        """End it and wait (bounded)."""
        self.abandon()
        process = self._process
        if process is not None:
            for number in (None, signal.SIGTERM, signal.SIGKILL):
                if number is not None:
                    with contextlib.suppress(ProcessLookupError):
                        process.send_signal(number)
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(process.wait(), self._ramp + _GRACE)
                    break
        if self._reader is not None:
            await asyncio.wait([self._reader], timeout=_GRACE)

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None and process.stderr is not None  # noqa: S101, PT018
        complaints = asyncio.create_task(self._listen(process.stderr))
        why = ""
        try:
            while line := await process.stdout.readline():
                said = json.loads(line)
                if "error" in said:
                    why = said["error"]
                elif said.get("id", self._number) != self._number:
                    continue  # of an order that was given up
                elif self._answer is not None and not self._answer.done():
                    self._answer.set_result(said)
        except ValueError as error:
            why = f"the bridge to LinuxCNC says something else: {error}"
        await asyncio.wait([complaints], timeout=_GRACE)
        complaints.cancel()
        if not self._closing:
            why = why or f"the bridge to LinuxCNC ended: {self._complaint}"
            self._fail(why)
            self._on_lost(why)

    async def _listen(self, stream: asyncio.StreamReader) -> None:
        """Keep the last line of standard error: LinuxCNC's libraries are talkative."""
        with contextlib.suppress(ValueError):
            while line := await stream.readline():
                self._complaint = line.decode(errors="replace").strip()

    def _fail(self, why: str) -> None:
        if self._answer is not None and not self._answer.done():
            self._answer.set_exception(LinkDownError(why))


def _expire(answer: asyncio.Future[dict[str, Any]]) -> None:
    if not answer.done():
        answer.set_exception(TimeoutError())
