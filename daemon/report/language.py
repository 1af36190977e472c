"""A page in the language of who reads it: the words of the workbench, by one file for each."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable

from abbe.compcore.errors import InputError
from abbe.compcore.sentences import Sentence

ENGLISH = "en"
_PLACE = re.compile(r"{(\w+)}")


class PageLanguage:
    """What texts are in a language; one that it does not know stays as it is.

    Attributes
    ----------
    code
        As HTML has it: ``en``, ``de``.
    """

    def __init__(self, code: str, labels: Mapping[str, str], sentences: Mapping[str, str]) -> None:
        self.code = code
        self._labels, self._sentences = labels, sentences
        # what says the most comes first: '{a}: {b}' would fit nearly everything
        order = sorted((k for k in labels if "{" in k), key=lambda k: -len(_fixed(k)))
        self._patterns = [(_pattern(text), labels[text]) for text in order]

    def say(self, text: str) -> str:
        """A text in this language, also what stands within it."""
        if self.code == ENGLISH or not re.search(r"[^\W\d_]", text):
            return text
        if text.endswith(" "):  # a cell of a column stays as wide
            bare = text.rewritten(str.rstrip) if isinstance(text, Sentence) else text.rstrip()
            return self.say(bare).ljust(len(text))
        if isinstance(text, Sentence):
            own = self._sentences.get(text.template)
            if own is None and not re.search(r"\w", _fixed(text.template)):
                own = text.template
            if own is not None:
                values = {k: v if v == text else self.say(v) for k, v in text.values.items()}
                return _PLACE.sub(lambda m: str(values.get(m[1], m[0])), own)
        known = self._sentences.get(text) or self._labels.get(text)
        if known is not None:
            return known
        for pattern, own in self._patterns:
            if found := pattern.fullmatch(text):
                parts = found.groupdict()
                return _PLACE.sub(lambda m: self.say(parts[m[1]]), own)  # noqa: B023
        return text


def _fixed(text: str) -> str:
    return _PLACE.sub("", text)


def _pattern(text: str) -> re.Pattern[str]:
    """The first place of a name takes anything, the others the same."""
    seen: set[str] = set()
    parts = []
    for i, part in enumerate(_PLACE.split(text)):
        if i % 2 == 0:
            parts.append(re.escape(part))
        else:
            parts.append(f"(?P={part})" if part in seen else f"(?P<{part}>.+?)")
            seen.add(part)
    return re.compile("".join(parts), re.DOTALL)


def languages() -> tuple[str, ...]:
    """The codes of all languages that there are, English first."""
    names = sorted(f.name.removesuffix(".json") for f in _room().iterdir())
    return (ENGLISH, *names)


@cache
def language(code: str) -> PageLanguage:
    """A language by its code.

    Raises
    ------
    InputError
        Where there is no such language.
    """
    if code not in languages():
        raise InputError(
            "no such language", field="language", found=code, expected=", ".join(languages())
        )
    if code == ENGLISH:
        return PageLanguage(ENGLISH, {}, {})
    words = json.loads(_room().joinpath(f"{code}.json").read_text("utf-8"))
    return PageLanguage(code, words["_labels"], words["_sentences"])


def _room() -> Traversable:
    # the workbench's files: its words and those of pages are the same
    return files("abbe.daemon.workbench").joinpath("static").joinpath("words")
