"""Lists of different lengths, end to end in one array."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Lists:
    """Lists of different lengths, end to end: list i is `indices[offsets[i]:offsets[i + 1]]`.

    int32; `offsets` (lists + 1,), `indices` (all entries,).
    """

    offsets: np.ndarray
    indices: np.ndarray

    def __getitem__(self, i: int) -> np.ndarray:
        return self.indices[self.offsets[i] : self.offsets[i + 1]]

    @property
    def lengths(self) -> np.ndarray:
        """Return the number of entries of each list, (lists,) int32."""
        return np.diff(self.offsets)


def grouped(keys: np.ndarray, values: np.ndarray, count: int) -> Lists:
    """Return for each key 0 ... count - 1 the `values` (n,) whose entry in `keys` (n,) is that key, in their order."""
    return Lists(
        offsets_of(np.bincount(keys, minlength=count)), values[np.argsort(keys, kind="stable")].astype(np.int32)
    )


def offsets_of(lengths: np.ndarray) -> np.ndarray:
    """Return (lists + 1,) int32, from 0: where lists of `lengths` (lists,) begin, and where the last one ends."""
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)


def ranges(first: np.ndarray, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (list, number) int64 (all entries,): of each list in turn whole numbers, from `first` (lists,) on,
    `lengths` (lists,) of them."""
    owner = np.repeat(np.arange(len(lengths)), lengths)
    return owner, np.arange(len(owner)) + np.repeat(first - (np.cumsum(lengths) - lengths), lengths)
