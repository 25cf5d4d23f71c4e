"""Who owns what when a sheet is cut by rows: pure arithmetic, for every way of sending.

A domain owns neighbouring rows. Its window holds these and a halo, rows that its neighbours own. A step reads as far as
forces reach, so that a window stepped by itself goes bad from its cut edges inwards, by so many rows a step; what it owns
stays right, bit for bit, until the halo is used up. Then the windows exchange: each sends its border rows, which are the
neighbours' halos. A deeper halo asks for fewer messages and computes more rows twice (J. Demmel, M. Hoemmen, M. Mohiyuddin,
K. Yelick, "Avoiding communication in sparse matrix computations", 2008). Any kernel that steps a sheet steps a window.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from model.core.errors import SceneError

MOST_STEPS = 32  # between two exchanges: beyond it their price is small beside the rows computed twice
SHARE = 64  # owned rows for each step between exchanges: the two halos are then a thirty-second of the rows


@dataclass(frozen=True)
class Reach:
    """How far a step reads along the rows. `parts`: of a step, equal, after each of which windows may exchange. `rows`: a
    force evaluation's reach; `forces`: evaluations of a part, one after another; `more`: rows that a call asks for besides,
    however many parts it does (of velocity Verlet's last half kick). `unit`: windows begin at multiples of so many
    rows, after which what they hold repeats. `numbered`: a window's solver knows the number of its first mass in the whole
    sheet (Options.first_particle)."""

    rows: int = 1
    forces: int = 1
    more: int = 0
    unit: int = 1
    numbered: bool = False
    parts: int = 1

    def halo(self, parts: int) -> int:
        """Rows that so many parts of a step in one call need beyond those that they are to leave right."""
        found = self.rows * self.forces * parts + self.more
        return -(-found // self.unit) * self.unit


@dataclass(frozen=True)
class Domain:
    """Rows `first` to before `end` of the sheet are owned, `window_first` to before `window_end` are held."""

    number: int
    first: int
    end: int
    window_first: int
    window_end: int

    @property
    def owned(self) -> slice:
        """The owned rows, counted in the window."""
        return slice(self.first - self.window_first, self.end - self.window_first)

    @property
    def window_rows(self) -> int:
        return self.window_end - self.window_first


@dataclass(frozen=True)
class Border:
    """Rows that domain `source` sends domain `target`: `rows` of them, `from_row` on in the one's window, `to_row` on in the
    other's."""

    source: int
    target: int
    from_row: int
    to_row: int
    rows: int


@dataclass(frozen=True)
class Decomposition:
    """A sheet of `rows` x `columns` masses in `count` domains with halos of `halo` rows. A step is done in `divided` equal
    steps of windows, after `steps` of which they exchange at the latest; `unit`: see Reach."""

    rows: int
    columns: int
    count: int
    halo: int
    steps: int
    unit: int = 1
    divided: int = 1

    @cached_property
    def domains(self) -> tuple[Domain, ...]:
        """From the top row down; their sizes differ by one row at most (by a unit, and what is left over)."""
        unit = self.unit
        cuts = [unit * (self.rows // unit * k // self.count) for k in range(self.count)] + [self.rows]
        return tuple(
            Domain(k, first, end, max(0, first - self.halo), min(self.rows, end + self.halo))
            for k, (first, end) in enumerate(pairwise(cuts))
        )

    @cached_property
    def borders(self) -> tuple[Border, ...]:
        """All that is sent in an exchange."""
        found = []
        for upper, lower in pairwise(self.domains):
            down, up = upper.end - lower.window_first, upper.window_end - lower.first
            found.append(Border(upper.number, lower.number, lower.window_first - upper.window_first, 0, down))
            found.append(
                Border(
                    lower.number, upper.number, lower.first - lower.window_first, lower.first - upper.window_first, up
                )
            )
        return tuple(found)

    @property
    def least_rows(self) -> int:
        """Owned by the smallest domain."""
        return min(domain.end - domain.first for domain in self.domains)

    @property
    def repeated(self) -> float:
        """Rows that are computed, over those of the sheet."""
        return sum(domain.window_rows for domain in self.domains) / self.rows

    def bytes_sent(self, mass_bytes: int) -> int:
        """Bytes of the largest message of an exchange; `mass_bytes`: of a mass's state."""
        return max((border.rows for border in self.borders), default=0) * self.columns * mass_bytes

    @property
    def interval(self) -> float:
        """Steps of the sheet between two exchanges: a whole number, or a part of one."""
        return self.steps if self.divided == 1 else self.steps / self.divided

    @property
    def told(self) -> str:
        """That in words."""
        return f"every {self.steps} steps" if self.divided == 1 else f"{self.divided} times a step"


def usual_steps(least_rows: int) -> int:
    """Steps between two exchanges where nobody said; from 4 on multiples of 4, as tiles of the GPU do at once."""
    steps = max(1, min(MOST_STEPS, least_rows // SHARE))
    return steps if steps < 4 else steps // 4 * 4


def usual_parts(least_rows: int, reach: Reach, most: int) -> int:
    """The same in parts of a step, of which a share has rows for `most`: whole steps, or a divisor of the parts of one."""
    if reach.parts == 1:
        return min(most, usual_steps(least_rows))
    wanted = 1
    while wanted < most and SHARE * reach.halo(wanted + 1) <= least_rows:
        wanted += 1
    if wanted >= reach.parts:
        return wanted // reach.parts * reach.parts
    return max(n for n in range(1, wanted + 1) if reach.parts % n == 0)


def decompose(
    rows: int, columns: int, count: int, reach: Reach, steps: int | None = None, option: str = "--gpus"
) -> Decomposition:
    """The sheet in `count` domains that exchange every `steps` steps (None: as often as usual).

    A halo lies in one neighbour. Raises SceneError, naming the `option`, where the sheet has too few rows for that.
    """
    if count < 1:
        raise SceneError(option, count, "must be at least 1")
    if steps is not None and steps < 1:
        raise SceneError("--exchange-every", steps, "must be at least 1")
    if count * reach.unit > rows:
        raise SceneError(
            option, count, f"a grid of {rows} rows can be shared by at most {max(1, rows // reach.unit)}; use fewer"
        )
    least = Decomposition(rows, columns, count, 0, 1, reach.unit).least_rows
    if count == 1:
        return Decomposition(rows, columns, 1, 0, steps or usual_steps(rows), reach.unit)
    most = 0
    while most < max(steps or 0, MOST_STEPS) * reach.parts and reach.halo(most + 1) <= least:
        most += 1
    if most == 0:
        fit = rows // reach.halo(1)
        raise SceneError(
            option, count, f"each share of {rows} rows needs {reach.halo(1)} or more; use at most {max(1, fit)}"
        )
    if steps is not None and steps * reach.parts > most:
        able = most // reach.parts
        remedy = f"use at most {able}" if able else "leave it out, to exchange several times a step"
        raise SceneError("--exchange-every", steps, f"the smallest share has {least} rows; {remedy}")
    parts = steps * reach.parts if steps else usual_parts(least, reach, most)
    whole, divided = max(1, parts // reach.parts), max(1, reach.parts // parts)
    return Decomposition(rows, columns, count, reach.halo(parts), whole, reach.unit, divided)
