"""Who owns what when a sheet is cut by rows: pure arithmetic, for every way of sending.

A domain owns neighbouring rows. Its window holds these and a halo, rows that its neighbours own. A step reads as far as
forces reach, so that a window stepped by itself goes bad from its cut edges inwards, by so many rows a step; what it owns
stays right, bit for bit, until the halo is used up. Then the windows exchange: each sends its border rows, which are the
neighbours' halos. A deeper halo asks for fewer messages and computes more rows twice (J. Demmel, M. Hoemmen, M. Mohiyuddin,
K. Yelick, "Avoiding communication in sparse matrix computations", 2008). Any kernel that steps a sheet steps a window.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from model.core.errors import SceneError

MOST_STEPS = 16  # between two exchanges: beyond it their price is small beside the rows computed twice
SHARE = 64  # owned rows for each step between exchanges: the two halos are then a thirty-second of the rows


@dataclass(frozen=True)
class Reach:
    """How far a step reads along the rows. `rows`: a force evaluation's reach; `forces`: evaluations a step, one after
    another; `closing`: one more at the end of every call (velocity Verlet's last half kick); `even`: windows begin at even
    rows, since what they hold differs between even and odd ones. `numbered`: a window's solver knows the number of its first
    mass in the whole sheet (Options.first_particle)."""

    rows: int = 1
    forces: int = 1
    closing: bool = False
    even: bool = False
    numbered: bool = False

    def halo(self, steps: int) -> int:
        """Rows that `steps` steps in one call need beyond those that they are to leave right."""
        found = self.rows * (self.forces * steps + self.closing)
        return found + found % 2 if self.even else found


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
    """A sheet of `rows` x `columns` masses in `count` domains with halos of `halo` rows, exchanged every `steps` steps at the
    latest; `even`: see Reach."""

    rows: int
    columns: int
    count: int
    halo: int
    steps: int
    even: bool = False

    @cached_property
    def domains(self) -> tuple[Domain, ...]:
        """From the top row down; their sizes differ by one row at most (by two where they begin at even rows)."""
        unit = 2 if self.even else 1
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

    def as_dict(self) -> Mapping[str, int]:
        """What tells it apart from others of the same sheet."""
        return {"count": self.count, "halo": self.halo, "steps": self.steps}


def usual_steps(least_rows: int) -> int:
    """Steps between two exchanges where nobody said; from 4 on multiples of 4, as tiles of the GPU do at once."""
    steps = max(1, min(MOST_STEPS, least_rows // SHARE))
    return steps if steps < 4 else steps // 4 * 4


def decompose(
    rows: int, columns: int, count: int, reach: Reach, steps: int | None = None, option: str = "--gpus"
) -> Decomposition:
    """The sheet in `count` domains that exchange every `steps` steps (None: as many as usual).

    A halo lies in one neighbour. Raises SceneError, naming the `option`, where the sheet has too few rows for that.
    """
    if count < 1:
        raise SceneError(option, count, "must be at least 1")
    if steps is not None and steps < 1:
        raise SceneError("--exchange-every", steps, "must be at least 1")
    unit = 2 if reach.even else 1
    if count * unit > rows:
        raise SceneError(option, count, f"a grid of {rows} rows can be shared by at most {rows // unit}; use fewer")
    least = Decomposition(rows, columns, count, 0, 1, reach.even).least_rows
    if count == 1:
        return Decomposition(rows, columns, 1, 0, steps or usual_steps(rows), reach.even)
    most = 0
    while most < max(steps or 0, MOST_STEPS) and reach.halo(most + 1) <= least:
        most += 1
    if most == 0:
        fit = rows // reach.halo(1)
        raise SceneError(
            option, count, f"each share of {rows} rows needs {reach.halo(1)} or more; use at most {max(1, fit)}"
        )
    if steps is not None and steps > most:
        raise SceneError("--exchange-every", steps, f"the smallest share has {least} rows; use at most {most}")
    chosen = steps or min(most, usual_steps(least))
    return Decomposition(rows, columns, count, reach.halo(chosen), chosen, reach.even)
