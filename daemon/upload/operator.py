"""The operator at the terminal: messages, questions and progress of an upload."""

from __future__ import annotations

import asyncio
import logging
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import TracebackType
from typing import Self

import typer

from abbe.daemon.progress import shown
from abbe.daemon.upload.operator_port import OperatorPort


def can_ask() -> bool:
    """Whether somebody sits at a terminal."""
    return sys.stdin.isatty() and sys.stdout.isatty()


class TerminalOperator:
    """The operator at the terminal; a context, so that its progress bar ends with it.

    Parameters
    ----------
    quiet
        Tell everything on standard error: standard output is for one JSON object.
    yes
        Do not ask.
    """

    def __init__(self, *, quiet: bool, yes: bool) -> None:
        self._quiet = quiet
        self._yes = yes
        self._bar = ExitStack()
        self._log_discarded = logging.NullHandler()
        self._describe: Callable[[str], None] = lambda _: None
        self._doing = ""

    def __enter__(self) -> Self:
        """Nothing is shown yet."""
        # a link's log would stand between the lines, which say the same
        logging.getLogger("abbe").addHandler(self._log_discarded)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Take the bar away."""
        self._bar.close()
        logging.getLogger("abbe").removeHandler(self._log_discarded)

    def port(self) -> OperatorPort:
        """For the upload."""
        return OperatorPort(self.tell, self.progress, self.ask, self.restarted)

    def begin(self, doing: str) -> None:
        """Show a bar from now on, once it takes long."""
        self._bar.close()
        self._doing = doing
        self._describe = self._bar.enter_context(shown(doing))

    def tell(self, line: str) -> None:
        """A line for people; what the bar names from now on."""
        typer.echo(line, err=self._quiet)
        self._doing = line
        self._describe(line)

    def progress(self, part: float) -> None:
        """How much of a transfer is done."""
        self._describe(f"{self._doing}: {part:.0%}")

    def ask(self, lines: list[str]) -> bool:
        """Show what would change and ask; Ctrl-C is a no."""
        for line in lines:
            self.tell(line)
        if not self._yes:
            with _interruptible():
                try:
                    agreed = typer.confirm("write this to the controller?")
                except (KeyboardInterrupt, typer.Abort):
                    agreed = False
            if not agreed:
                return False
        self.begin("uploading")
        return True

    async def restarted(self) -> bool:
        """Ask for a restart and wait for the word that it was done; False when nobody is there."""
        if self._yes or not can_ask():
            return False
        self._bar.close()
        done = await asyncio.to_thread(
            typer.confirm, "restart the controller now; is it up again?", default=True
        )
        self.begin("after the restart")
        return done


@contextmanager
def _interruptible() -> Iterator[None]:
    """Let Ctrl-C end a question: asyncio's own handler would wait for the answer."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
