"""Columns that grow: numbers in place, names as codes, so that a million rows stay compact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

F64 = NDArray[np.float64]
T = TypeVar("T")


class Growing:
    """A column of float64 that rows are added to."""

    def __init__(self) -> None:
        self._data = np.empty(0)
        self._n = 0

    def extend(self, values: F64) -> None:
        """Add values, shape (m,)."""
        n = self._n + len(values)
        if n > len(self._data):
            self._data.resize(max(n, len(self._data) * 3 // 2), refcheck=False)
        self._data[self._n : n] = values
        self._n = n

    def take(self) -> F64:
        """The whole column, shape (n,); the store is empty afterwards."""
        data, self._data = self._data, np.empty(0)
        data.resize(self._n, refcheck=False)
        self._n = 0
        return data


@dataclass(frozen=True, eq=False)
class Names:
    """Names of n rows, each kept once: `unique` and, shape (n,), places in it."""

    unique: list[str]
    codes: NDArray[np.int32]

    @classmethod
    def of(cls, cells: Sequence[bytes]) -> Names:
        """The names in cells of UTF-8 text, blanks around them taken off."""
        index = {cell: i for i, cell in enumerate(dict.fromkeys(cells))}
        codes = np.fromiter(map(index.__getitem__, cells), np.int32, len(cells))
        return cls([cell.decode("utf-8").strip() for cell in index], codes)

    def where(self, test: Callable[[str], bool]) -> NDArray[np.bool_]:
        """Which rows have a name that passes a test, shape (n,)."""
        return self.each([test(name) for name in self.unique], np.bool_)

    def each(self, values: Sequence[T], dtype: DTypeLike) -> NDArray[Any]:
        """Values given for the unique names, for each row, shape (n,)."""
        return np.asarray(values, dtype=dtype)[self.codes]


class GrowingNames:
    """A column of names that rows are added to, each name kept once."""

    def __init__(self) -> None:
        self.names: dict[str, int] = {}
        self._codes: list[NDArray[np.int32]] = []

    def extend(self, names: Names) -> None:
        """Add names."""
        for name in names.unique:
            self.names.setdefault(name, len(self.names))
        self._codes.append(names.each([self.names[name] for name in names.unique], np.int32))

    def blank(self, count: int) -> None:
        """Add rows without a name."""
        code = self.names.setdefault("", len(self.names))
        self._codes.append(np.full(count, code, dtype=np.int32))

    def codes(self) -> NDArray[np.int32]:
        """Codes of all rows, shape (n,)."""
        return np.concatenate(self._codes) if self._codes else np.empty(0, np.int32)

    def take(self) -> NDArray[np.str_]:
        """The whole column, shape (n,)."""
        return np.array(list(self.names) or [""], dtype=np.str_)[self.codes()]
