"""Order in which Gauss-Seidel goes down the rows: the steps of a thread in an iteration, one row at a time.

Colours are ordered so that rows are linked two at a time: as soon as the constraints between a row and its neighbours
above and below are projected, those along it can be, then those to the second next rows, and the row is done. So a row
is predicted, projected and given its velocity while it is in the cache, and every number passes through memory once per
iteration.

Each thread has a band of rows that begins where no first colour leads across. Constraints across the border belong to
the lower band, in a phase after that in which the upper one does its last rows first; later phases finish them. In a
phase no two bands touch the same row.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

# operations on row i, or between it and one of the next two
BEGIN, DOWN, ALONG, FAR_DOWN, FAR_ALONG, END = range(6)
PHASES = 5  # parts of a band's iteration that can run at once when all bands have done the previous ones


def group_of(has_bending: bool) -> int:
    """Return the number of rows between which first colours lead: bands begin at a multiple of it."""
    return 4 if has_bending else 2


@dataclass
class _Band:
    """The steps of one band, from row `begin` to before `end` of `rows`."""

    begin: int
    end: int
    rows: int
    has_bending: bool
    steps: list[tuple[int, int, int]] = field(default_factory=list)  # (what, row, phase)
    phase: int = 0

    @property
    def has_upper(self) -> bool:
        return self.begin > 0

    @property
    def has_lower(self) -> bool:
        return self.end < self.rows

    def do(self, what: int, *rows: int) -> None:
        self.steps += [(what, row, self.phase) for row in rows]

    def open_pair(self, i: int) -> None:
        """Open rows `i` and i + 1, between which the first colours lead."""
        self.do(BEGIN, *range(i, min(i + 2, self.end)))
        if i + 1 < self.end:
            self.do(DOWN, i)

    def pass_row(self, i: int) -> None:
        """Continue with row `i` after its neighbouring rows; called in the order of rows."""
        self.do(ALONG, i)
        if not self.has_bending:
            self.do(END, i)
        elif i % 4 == 3 or i == self.rows - 1:
            self.close_group(i // 4 * 4, i)

    def close_group(self, first: int, last: int) -> None:
        """Continue with rows `first` to `last`, between which bending's first colour leads, after their neighbouring
        rows."""
        self.far_down(first)
        if first > self.begin:
            self.far_down(first - 2)
            self.leave(first - 2)
        if first > self.begin or not self.has_upper:
            self.leave(first, last)
        if last == self.rows - 1:
            self.leave(first + 2, last)

    def far_down(self, first: int) -> None:
        self.do(FAR_DOWN, *(k for k in (first, first + 1) if k + 2 < self.rows))

    def leave(self, first: int, last: int | None = None) -> None:
        """Finish both rows from `first` on (to `last` at most), after those two below and above."""
        for k in range(first, first + 2):
            if last is None or k <= last:
                self.do(FAR_ALONG, k)
                self.do(END, k)

    def run(self) -> list[tuple[int, int, int]]:
        """Return all steps of an iteration."""
        if self.has_lower:
            self.open_pair(self.end - 2)
        self.phase = 1
        for i in range(self.begin, self.end, 2):
            is_last_pair = i >= self.end - 2
            if not (self.has_lower and is_last_pair):
                self.open_pair(i)
            if i > self.begin:
                self.do(DOWN, i - 1)
                self.pass_row(i - 1)
            elif self.has_upper:
                self.do(DOWN, i - 1)
            self.pass_row(i)
            if is_last_pair and not self.has_lower and i + 1 < self.end:
                self.pass_row(i + 1)
        self.phase = 2
        if self.has_lower:
            self.pass_row(self.end - 1)
        if self.has_bending:
            self.bend_across()
        return self.steps

    def bend_across(self) -> None:
        """Do bending between bands, and the rest of their rows."""
        self.phase = 3
        if self.has_upper:
            self.far_down(self.begin - 2)
            self.leave(self.begin, self.end - 1)
        self.phase = 4
        if self.has_lower:
            self.leave(self.end - 2)


def schedule(rows: int, bands: int, has_bending: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (steps (n, 2) [operation, row], starts (bands, PHASES + 1), bounds (bands + 1,)).

    The steps of band b from starts[b, 0] to before starts[b, PHASES] are an iteration, those from starts[b, p] on its
    phase p; its rows begin at bounds[b].
    """
    group = group_of(has_bending)
    groups = -(-rows // group)
    bounds = [min(groups * k // bands * group, rows) for k in range(bands + 1)]
    steps: list[tuple[int, int, int]] = []
    starts = np.zeros((bands, PHASES + 1), np.int64)
    for band in range(bands):
        schedule_of_band = _Band(bounds[band], bounds[band + 1], rows, has_bending).run()
        phases = [phase for _, _, phase in schedule_of_band]
        starts[band] = len(steps) + np.searchsorted(phases, np.arange(PHASES + 1))
        steps += schedule_of_band
    return np.array(steps, np.int64).reshape(-1, 3)[:, :2].copy(), starts, np.array(bounds, np.int64)


def most_bands(rows: int, has_bending: bool) -> int:
    """Return the largest number of bands of a sheet."""
    return -(-rows // group_of(has_bending))
