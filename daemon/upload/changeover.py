"""The sequence of an upload, every step in the journal before and behind, and where it breaks.

backup → stage → compare → ready → activate → verify → restart → effect → end

Nothing is decided by an acknowledgement: whatever breaks, and wherever, `abbe.daemon.upload.settle`
reads what is active and goes by that.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import replace

from abbe.compcore.errors import AbbeError
from abbe.daemon.upload.checks.shown_correction import WrongEffectError
from abbe.daemon.upload.history.upload_log import END
from abbe.daemon.upload.ledger import Ledger
from abbe.daemon.upload.outcome import UploadOutcome
from abbe.daemon.upload.settle import settle
from abbe.daemon.upload.steps import Step, Steps
from abbe.drivers.link import LinkError


class Changeover:
    """One changeover from the active tables to others.

    Parameters
    ----------
    steps
        What is to be done at the controller.
    ledger
        Its lines in the journal; the first is written already.
    """

    def __init__(self, steps: Steps, ledger: Ledger) -> None:
        self._steps, self._change, self._ledger = steps, steps.change, ledger

    async def run(self) -> UploadOutcome:
        """All of it; whatever breaks is put right, and said."""
        return await self._carry_out(self._steps.all(), again=True)

    async def finish(self) -> UploadOutcome:
        """What is left when the new set was found active after an interruption."""
        return await self._carry_out(self._steps.only_looking(), again=False)

    async def _carry_out(self, steps: Mapping[str, Step], *, again: bool) -> UploadOutcome:
        step = ""
        try:
            for step, do in steps.items():
                self._ledger.note(step, "begun")
                async with asyncio.timeout(self._steps.allowed.step_timeout):
                    more = await do()
                self._ledger.note(step, "done", **more)
        except asyncio.CancelledError:
            _go_on()
            return await self._put_right(step, "stopped by the operator", want_old=True)
        except WrongEffectError as error:
            return await self._put_right(step, str(error), want_old=True)
        except (AbbeError, LinkError, OSError, TimeoutError) as error:
            why = str(error) or f"not finished within {self._steps.allowed.step_timeout:g} s"
            return await self._put_right(step, why, want_old=not again)
        except Exception as error:  # noqa: BLE001 - a store's fault must not leave a machine halfway
            why = f"{type(error).__name__}: {error}"
            return await self._put_right(step, why, want_old=True)
        return self._end(UploadOutcome(True, "new", self._change.old, self._change.new))

    async def _put_right(self, step: str, why: str, *, want_old: bool) -> UploadOutcome:
        self._steps.tell(f"the step '{step}' failed: {why}")
        self._ledger.note_anyway(step, "failed", why=why)
        change, allowed = self._change, self._steps.allowed
        found = await settle(
            self._steps.store, change.old, change.new, change.identity,
            want_old=want_old, wait_limit=allowed.wait_limit,
            step_timeout=allowed.step_timeout, tell=self._steps.tell,
        )  # fmt: skip
        if found.note:
            self._steps.notes.append(found.note)
        if found.active == "new" and not want_old:
            # it was done, only its confirmation was lost
            self._ledger.note_anyway("settle", "new active", why=why)
            return await self._carry_out(self._steps.only_looking(), again=False)
        return self._end(
            UploadOutcome(
                False, found.active, change.old, change.new, step=step, why=why, last=found.why
            )
        )

    def _end(self, outcome: UploadOutcome) -> UploadOutcome:
        steps, ledger = self._steps, self._ledger
        seen = steps.seen.words() if outcome.done and steps.acts else ""
        if outcome.active == "new" and not outcome.done:
            steps.notes.append(
                f"the old table could not be put back: {outcome.last}. Mend that, and run "
                "abbe upload CONFIG.toml --recover"
            )
        reported = {"active": outcome.active, "why": outcome.why, "step_failed": outcome.step}
        if outcome.open:
            ledger.note_anyway("settle", "left open", **reported, last=outcome.last)
        else:
            ledger.note_anyway(END, "done" if outcome.done else "failed", **reported)
        if ledger.broken:
            steps.notes.append(f"the journal is not complete: {ledger.broken}")
        return replace(
            outcome,
            upload=ledger.upload,
            backup=steps.kept,
            seen=seen,
            puts_back=self._change.puts_back,
            notes=tuple(dict.fromkeys(steps.notes)),
        )


def _go_on() -> None:
    """Take back a cancellation: what is half done has to be put right first."""
    task = asyncio.current_task()
    if task is not None:
        while task.uncancel():
            pass
