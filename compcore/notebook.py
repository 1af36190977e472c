"""Results in a notebook: tables in HTML, and as data frames of pandas where that is installed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from abbe.compcore.errors import AbbeError

if TYPE_CHECKING:
    import pandas as pd


def html_table(columns: Sequence[str], rows: Sequence[Sequence[object]], caption: str = "") -> str:
    """A table; None becomes a dash.

    >>> html_table(["axis"], [["X"]], "a < b")
    '<table><caption>a &lt; b</caption><tr><th>axis</th></tr><tr><td>X</td></tr></table>'
    """
    from html import escape

    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "".join(
        f"<tr>{''.join(f'<td>{_cell(value)}</td>' for value in row)}</tr>" for row in rows
    )
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<table>{title}<tr>{head}</tr>{body}</table>"


def _cell(value: object) -> str:
    if value is None:
        return "–"
    from html import escape

    return escape(f"{value:.4g}" if isinstance(value, float) else str(value))


def data_frame(columns: Mapping[str, Any]) -> pd.DataFrame:
    """A data frame of columns of one length.

    Raises
    ------
    AbbeError
        When pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise AbbeError("to_pandas() needs pandas: pip install pandas") from None
    return pd.DataFrame(dict(columns))
