"""``python -m tools.notebook``: run examples/notebook.ipynb and keep its outputs.

The figures in it are data (Plotly's MIME type), which JupyterLab and VS Code draw.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

FILE = Path(__file__).resolve().parent.parent / "examples" / "notebook.ipynb"


def executed() -> Any:
    """The notebook with fresh outputs, run where it stands; nothing is written.

    Raises
    ------
    nbclient.exceptions.CellExecutionError
        When a cell fails.
    """
    import nbformat
    from nbclient import NotebookClient

    book = nbformat.read(FILE, as_version=4)
    client = NotebookClient(book, timeout=300, resources={"metadata": {"path": str(FILE.parent)}})
    client.execute()
    for cell in book.cells:
        # when it ran is nobody's business, and would change every time
        cell.metadata.pop("execution", None)
    # the version of Python that happened to run it neither
    book.metadata["language_info"] = {"name": "python"}
    return book


def main() -> None:
    """Run it and write it."""
    import nbformat

    nbformat.write(executed(), FILE)


if __name__ == "__main__":
    main()
