"""Delivery of an answer: at once, late, in pieces, twice, swapped, in part, or not at all."""

from __future__ import annotations

import dataclasses
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

from abbe.drivers.simulated.torment.judge.evidence import ShownPicture, WireLog
from abbe.drivers.simulated.torment.loop import Loop
from abbe.drivers.simulated.torment.machine import TormentMachine

Send = Callable[[bytes], bool]
"""Puts bytes on the wire; False when there is none any more."""

FAMILIAR = (
    "late",
    "split",
    "partial",
    "wrong_id",
    "duplicated",
    "swapped",
    "refused",
    "refused_long",
    "flood",
    "silent",
)
"""Torments that are the same on every wire of questions and answers."""


class Delivery:
    """Sends answers as the script wants them.

    Parameters
    ----------
    loop, machine, log
        Of the trial.
    whole_only
        Part of an answer never goes out: where answers are frames, they are lost as a whole.
    """

    def __init__(
        self, loop: Loop, machine: TormentMachine, log: WireLog, *, whole_only: bool = False
    ) -> None:
        self._whole_only = whole_only
        self._loop = loop
        self._machine = machine
        self._script = machine.script
        self._log = log
        self._kept: list[tuple[Send, bytes, ShownPicture | None]] = []
        self._under_way = False
        self._waiting: deque[Callable[[], object]] = deque()

    def answer(
        self,
        send: Send,
        data: bytes,
        shown: ShownPicture | None = None,
        *,
        foreign: Sequence[bytes] = (),
        refusal: bytes = b"",
    ) -> None:
        """Answer a question.

        Parameters
        ----------
        send
            The connection.
        data
            The honest answer.
        shown
            The picture of the machine in it.
        foreign
            Answers that Abbe must not believe, for `wrong_id`.
        refusal
            How this wire says no; empty: it cannot.
        """
        now = time.monotonic()
        active = self._script.active
        if active("silent", now):
            return
        if refusal and (active("refused", now) or active("refused_long", now)):
            data, shown = refusal, None
        if (wrong := active("wrong_id", now)) and foreign:
            for other in foreign:
                self.aside(send, other)
            if wrong.amount < 0.5:
                return
        if late := active("late", now):
            self._loop.at(now + late.amount, lambda: self._pieces(send, data, shown))
            return
        if active("swapped", now) and not self._kept:
            self._kept.append((send, data, shown))
            return
        cut = bool(active("partial", now)) and not self._whole_only
        self._pieces(send, data, shown)
        kept, self._kept = self._kept, []
        for item in kept:
            self._pieces(*item)
        if twice := active("duplicated", now):
            # of an answer that was cut, the second one is the first that shows anything
            again = shown if cut else None
            self._loop.at(now + twice.amount, lambda: self.aside(send, data, again))

    def send_own(
        self, send: Send, data: bytes, shown: ShownPicture, covers: frozenset[str], foreign: bytes
    ) -> None:
        """Send a frame: not at all, with foreign ones, in pieces or twice."""
        now = time.monotonic()
        active = self._script.active
        if active("silent", now):
            return
        if wrong := active("wrong_id", now):
            self.aside(send, foreign)
            if wrong.amount < 0.5:
                return
        self._pieces(send, data, dataclasses.replace(shown, covers=covers), cuttable=False)
        if active("duplicated", now):
            self.aside(send, data)

    def in_pieces(self, send: Send, data: bytes, shown: ShownPicture) -> None:
        """Send several messages as one text in pieces; each counts from its beginning."""
        self._machine.judge.sent(dataclasses.replace(shown, sent=time.monotonic()))
        self._pieces(send, data, None, cuttable=False)

    def later(self, seconds: float, send: Send, data: bytes) -> None:
        """An answer without a picture, so many s later."""
        self._loop.after(seconds, lambda: self.aside(send, data))

    @property
    def busy(self) -> bool:
        """Whether an answer is under way in pieces: nothing else goes out in between."""
        return self._under_way

    def _pieces(
        self, send: Send, data: bytes, shown: ShownPicture | None, cuttable: bool = True
    ) -> None:
        now = time.monotonic()
        if self._under_way:
            self._waiting.append(partial(self._pieces, send, data, shown, cuttable))
            return
        if cuttable and (part := self._script.active("partial", now)):
            if self._whole_only:
                return
            self.aside(send, data[: max(1, int(len(data) * part.amount))])
            return
        pause = self._script.active("split", now)
        if pause is None:
            self._whole(send, data, shown)
            return
        cut = max(1, len(data) // 3)
        chunks = [data[i : i + cut] for i in range(0, len(data), cut)]
        for i, chunk in enumerate(chunks[:-1]):
            self._loop.at(now + i * pause.amount, partial(self._put, send, chunk))
        last = now + (len(chunks) - 1) * pause.amount
        self._under_way = True
        self._loop.at(last, lambda: self._last(send, chunks[-1], shown))

    def _last(self, send: Send, data: bytes, shown: ShownPicture | None) -> None:
        """The last piece; what waited for it goes out."""
        self._whole(send, data, shown)
        self._under_way = False
        while self._waiting and not self._under_way:
            self._waiting.popleft()()

    def _put(self, send: Send, data: bytes) -> bool:
        self._log.say(">", data)
        return send(data)

    def _whole(self, send: Send, data: bytes, shown: ShownPicture | None) -> None:
        before = time.monotonic()
        if self._put(send, data) and shown is not None:
            self._machine.judge.sent(dataclasses.replace(shown, sent=before))

    def aside(self, send: Send, data: bytes, shown: ShownPicture | None = None) -> None:
        """Send something whole, but never into the middle of an answer; judged where `shown`."""
        if self._under_way:
            self._waiting.append(partial(self.aside, send, data, shown))
        else:
            self._whole(send, data, shown)
