"""Arrays of equal length that grow together, one row at a time."""

from typing import Any

import numpy as np

FIRST_ROWS = 64
"""Rows of new arrays."""


class Columns:
    """Named arrays that double when they are full: ``columns["poses"]`` has a row for each that was appended.

    Args:
        types: Of the entries of new arrays, where they aren't float64.
        shapes: Of a row of each array.
    """

    def __init__(self, types: dict[str, Any] | None = None, **shapes: tuple[int, ...]) -> None:
        self._length = 0
        self._capacity = FIRST_ROWS
        types = types or {}
        self._arrays: dict[str, np.ndarray] = {}
        for name, shape in shapes.items():
            kind = types.get(name, np.float64)
            self._arrays[name] = np.zeros((FIRST_ROWS, *shape), kind)

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, name: str) -> np.ndarray:
        """An array's rows; they may be written to."""
        return self._arrays[name][: self._length]

    @property
    def num_bytes(self) -> int:
        """Memory of all arrays."""
        return sum(array.nbytes for array in self._arrays.values())

    def append(self, **values: Any) -> None:
        """Add a row; an array that is not named gets zeros."""
        if self._length == self._capacity:
            for name, array in self._arrays.items():
                self._arrays[name] = np.concatenate([array, np.zeros_like(array)])
            self._capacity *= 2
        for name, value in values.items():
            self._arrays[name][self._length] = value
        self._length += 1
