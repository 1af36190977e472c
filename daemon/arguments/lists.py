"""Options that take several values: ``--campaign A.csv B.csv`` as well as one flag for each."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

_SEVERAL = frozenset({"--campaign", "--holdout"})


class ListOptions(TyperCommand):
    """A command whose `--campaign` and `--holdout` go on until the next option.

    A word with ``=`` in it that is no file is a KEY=VALUE argument and ends the list.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Write a flag before every value of such an option, then parse as usual."""
        return super().parse_args(ctx, spread(args))


def spread(args: list[str]) -> list[str]:
    """``["--campaign", "a", "b"]`` → ``["--campaign", "a", "--campaign", "b"]``.

    >>> spread(["M", "--campaign", "a.csv", "b.csv", "-o", "OUT"])
    ['M', '--campaign', 'a.csv', '--campaign', 'b.csv', '-o', 'OUT']
    """
    out: list[str] = []
    option: str | None = None
    first = False
    for word in args:
        if word.startswith("-"):
            option, first = (word, True) if word in _SEVERAL else (None, False)
            if option is None or word not in _SEVERAL:
                out.append(word)
            continue
        if option is not None and (first or "=" not in word):
            out += [option, word]
            first = False
            continue
        option = None
        out.append(word)
    return out
