"""What a command prints, in a language: every line that is a sentence, and why it failed."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO, cast

from abbe.compcore.errors import AbbeError
from abbe.compcore.sentences import Sentence, remembered

if TYPE_CHECKING:
    from abbe.daemon.report.language import PageLanguage


class LinesInLanguage:
    """Standard output on which each line that is a sentence is said in a language.

    Parameters
    ----------
    out
        Where the lines go.
    made
        The sentences that were made, by their text.
    language
        The language.
    """

    def __init__(self, out: TextIO, made: Mapping[str, Sentence], language: PageLanguage) -> None:
        self._out, self._made, self._language = out, made, language
        self._begun = ""

    def write(self, text: str) -> int:
        """Take text; a line goes on when it is whole, or with the next `flush`."""
        *lines, self._begun = (self._begun + text).split("\n")
        for line in lines:
            self._out.write(self._said(line) + "\n")
        return len(text)

    def _said(self, line: str) -> str:
        bare = line.strip()
        sentence = self._made.get(line)
        if sentence is not None:
            return self._language.say(sentence)
        sentence = self._made.get(bare)
        return line if sentence is None else line.replace(bare, self._language.say(sentence))

    def flush(self) -> None:
        """Have what was written go on, also a question that waits for its answer."""
        self._out.write(self._begun)
        self._begun = ""
        self._out.flush()

    def __getattr__(self, name: str) -> Any:
        """What else a stream has: that of where the lines go."""
        return getattr(self._out, name)


@contextmanager
def printed_in(language: PageLanguage | None) -> Iterator[None]:
    """While it lasts lines are printed in a language; None, and English: as they are."""
    from abbe.daemon.report.language import ENGLISH

    if language is None or language.code == ENGLISH:
        yield
        return
    before = sys.stdout
    with remembered() as made:
        sys.stdout = cast("TextIO", LinesInLanguage(before, made, language))
        try:
            yield
        finally:
            sys.stdout.flush()
            sys.stdout = before


@contextmanager
def failing_in(language: PageLanguage) -> Iterator[None]:
    """While it lasts why something cannot be done is said in a language."""
    try:
        yield
    except AbbeError as error:
        if language.say(error.sentence) == str(error):
            raise
        raise AbbeError(language.say(error.sentence)) from error
