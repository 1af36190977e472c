"""Text, short line, HTML for a notebook and pictures, as every result has them for people."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from html import escape
from typing import TYPE_CHECKING

from abbe.compcore.errors import InputError
from abbe.compcore.figures.figure import Figure

if TYPE_CHECKING:
    from plotly.graph_objects import Figure as PlotlyFigure


class Shown(ABC):
    """A result that can be read, drawn, and looked at in a notebook."""

    @abstractmethod
    def words(self) -> Iterable[str]:
        """The lines of `report`."""

    @abstractmethod
    def summary(self) -> str:
        """The result in one line."""

    @abstractmethod
    def table(self) -> str:
        """What matters most, as a table in HTML."""

    @abstractmethod
    def figures(self) -> Mapping[str, Callable[[], Figure]]:
        """Every picture by name, in the order of the page; made, as plain data, when called."""

    def report(self) -> str:
        """The text that Abbe's command prints of this result."""
        return "\n".join(self.words())

    @property
    def pictures(self) -> tuple[str, ...]:
        """The names that `plot` takes."""
        return tuple(self.figures())

    def plot(self, which: str | None = None) -> PlotlyFigure:
        """One of the pictures of the command's page (``--report``), as a figure of Plotly.

        Parameters
        ----------
        which
            One of `pictures`; the first where not given.

        Raises
        ------
        InputError
            When there is no such picture; lists those that there are.
        """
        import plotly.graph_objects as go

        figures = self.figures()
        name = next(iter(figures), "") if which is None else which
        if name not in figures:
            known = ", ".join(figures) or "nothing: there is nothing to draw"
            raise InputError("no such picture", field="which", found=which, expected=known)
        return go.Figure(figures[name]())

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.summary()}>"

    def _repr_html_(self) -> str:
        title = escape(f"{type(self).__name__}: {self.summary()}")
        return f"<p><b>{title}</b></p>{self.table()}"
