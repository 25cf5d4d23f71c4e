"""Partition of a sheet by rows: pure arithmetic, for every exchange.

A domain owns neighbouring rows. Its window contains these and a halo, rows that its neighbours own. A step reads a
limited number of rows, so that a window stepped alone becomes wrong from its cut edges inwards, by that many rows per
step; the owned rows stay right, bit for bit, until the halo is used up. Then the windows exchange: each sends its
border rows, which are the neighbours' halos. A deeper halo needs fewer messages and computes more rows twice (J.
Demmel, M. Hoemmen, M. Mohiyuddin, K. Yelick, "Avoiding communication in sparse matrix computations", 2008). Any kernel
that steps a sheet steps a window.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene

WHOLE_CLOTH = {  # kinds of tables that refer to masses by their place in it, or connect them across it
    "load": "is at a position of the whole cloth",
    "motion": "moves pins of the whole cloth",
    "fold": "folds the whole cloth",
    "external": "draws a random number for each mass of the whole cloth",
    "attachments": "attaches masses to pins anywhere in the whole cloth",
    "self_collision": "lets masses anywhere in the whole cloth collide",
}

MOST_STEPS = 32  # between two exchanges: beyond it their cost is small relative to that of the rows computed twice
ROWS_PER_STEP = 64  # owned rows for each step between exchanges: the two halos are then a thirty-second of the rows


@dataclass(frozen=True)
class Stencil:
    """Rows that a step reads.

    `parts`: equal parts of a step, after each of which windows may exchange. `rows`: rows to each side that a force
    evaluation reads; `forces`: evaluations of a part, one after another; `more`: additional rows per call, for any
    number of parts (of velocity Verlet's last half kick). `unit`: windows begin at multiples of this number of rows,
    after which their content repeats. `numbered`: a window's solver knows the number of its first mass in the whole
    sheet (Options.first_particle).
    """

    rows: int = 1
    forces: int = 1
    more: int = 0
    unit: int = 1
    numbered: bool = False
    parts: int = 1

    def halo(self, parts: int) -> int:
        """Return the halo, in rows, for this number of parts of a step in one call."""
        rows = self.rows * self.forces * parts + self.more
        return -(-rows // self.unit) * self.unit


@dataclass(frozen=True)
class Domain:
    """Rows `first` to before `end` of the sheet are owned, `window_first` to before `window_end` are in the window."""

    number: int
    first: int
    end: int
    window_first: int
    window_end: int

    @property
    def owned(self) -> slice:
        """Owned rows, counted in the window."""
        return slice(self.first - self.window_first, self.end - self.window_first)

    @property
    def window_rows(self) -> int:
        return self.window_end - self.window_first


@dataclass(frozen=True)
class Border:
    """Rows that domain `source` sends to domain `target`: `rows` of them, starting at `from_row` of its window and at
    `to_row` of the other's."""

    source: int
    target: int
    from_row: int
    to_row: int
    rows: int


@dataclass(frozen=True)
class Decomposition:
    """A sheet of `rows` x `columns` masses in `count` domains with halos of `halo` rows.

    A step is divided into `divided` equal steps of windows, which exchange after at most `steps` of these; `unit`: see
    Stencil.
    """

    rows: int
    columns: int
    count: int
    halo: int
    steps: int
    unit: int = 1
    divided: int = 1

    @cached_property
    def domains(self) -> tuple[Domain, ...]:
        """The domains from the top row down; their sizes differ by at most one row (by a unit, and the remainder)."""
        unit = self.unit
        cuts = [unit * (self.rows // unit * k // self.count) for k in range(self.count)] + [self.rows]
        return tuple(
            Domain(k, first, end, max(0, first - self.halo), min(self.rows, end + self.halo))
            for k, (first, end) in enumerate(pairwise(cuts))
        )

    @cached_property
    def borders(self) -> tuple[Border, ...]:
        """All messages of an exchange."""
        borders = []
        for upper, lower in pairwise(self.domains):
            down, up = upper.end - lower.window_first, upper.window_end - lower.first
            borders.append(Border(upper.number, lower.number, lower.window_first - upper.window_first, 0, down))
            borders.append(
                Border(
                    lower.number, upper.number, lower.first - lower.window_first, lower.first - upper.window_first, up
                )
            )
        return tuple(borders)

    @property
    def least_rows(self) -> int:
        """Rows of the smallest domain."""
        return min(domain.end - domain.first for domain in self.domains)

    @property
    def repeated(self) -> float:
        """Computed rows over those of the sheet."""
        return sum(domain.window_rows for domain in self.domains) / self.rows

    def bytes_sent(self, mass_bytes: int) -> int:
        """Return the bytes of the largest message of an exchange; `mass_bytes`: of a mass's state."""
        return max((border.rows for border in self.borders), default=0) * self.columns * mass_bytes

    @property
    def interval(self) -> float:
        """Steps of the sheet between two exchanges: an integer, or a fraction of one."""
        return self.steps if self.divided == 1 else self.steps / self.divided

    @property
    def schedule(self) -> str:
        """Description of the interval."""
        return f"every {self.steps} steps" if self.divided == 1 else f"{self.divided} times a step"


def usual_steps(least_rows: int) -> int:
    """Return the default number of steps between two exchanges; from 4 on multiples of 4, as tiles of the GPU do at
    once."""
    steps = max(1, min(MOST_STEPS, least_rows // ROWS_PER_STEP))
    return steps if steps < 4 else steps // 4 * 4


def usual_parts(least_rows: int, stencil: Stencil, most: int) -> int:
    """Return the default number of parts of a step between two exchanges: whole steps, or a divisor of the parts of
    one.

    `most`: parts for which a domain has enough rows.
    """
    if stencil.parts == 1:
        return min(most, usual_steps(least_rows))
    wanted = 1
    while wanted < most and ROWS_PER_STEP * stencil.halo(wanted + 1) <= least_rows:
        wanted += 1
    if wanted >= stencil.parts:
        return wanted // stencil.parts * stencil.parts
    return max(n for n in range(1, wanted + 1) if stencil.parts % n == 0)


def decompose(
    rows: int, columns: int, count: int, stencil: Stencil, steps: int | None = None, option: str = "--gpus"
) -> Decomposition:
    """Return the sheet in `count` domains that exchange every `steps` steps (None: the default).

    A halo lies in one neighbour. Raises SceneError, naming the `option`, where the sheet has too few rows for that.
    """
    if count < 1:
        raise SceneError(option, count, "must be at least 1")
    if steps is not None and steps < 1:
        raise SceneError("--exchange-every", steps, "must be at least 1")
    if count * stencil.unit > rows:
        raise SceneError(
            option, count, f"a grid of {rows} rows can be shared by at most {max(1, rows // stencil.unit)}; use fewer"
        )
    least = Decomposition(rows, columns, count, 0, 1, stencil.unit).least_rows
    if count == 1:
        return Decomposition(rows, columns, 1, 0, steps or usual_steps(rows), stencil.unit)
    most = 0
    while most < max(steps or 0, MOST_STEPS) * stencil.parts and stencil.halo(most + 1) <= least:
        most += 1
    if most == 0:
        fit = rows // stencil.halo(1)
        raise SceneError(
            option, count, f"each share of {rows} rows needs {stencil.halo(1)} or more; use at most {max(1, fit)}"
        )
    if steps is not None and steps * stencil.parts > most:
        able = most // stencil.parts
        remedy = f"use at most {able}" if able else "leave it out, to exchange several times a step"
        raise SceneError("--exchange-every", steps, f"the smallest share has {least} rows; {remedy}")
    parts = steps * stencil.parts if steps else usual_parts(least, stencil, most)
    whole, divided = max(1, parts // stencil.parts), max(1, stencil.parts // parts)
    return Decomposition(rows, columns, count, stencil.halo(parts), whole, stencil.unit, divided)


def require_local(scene: Scene) -> None:
    """Raise SceneError for parts that depend on a mass's number in the whole sheet."""
    idle = scene.external is not None and scene.external.magnitude == 0
    for kind, what in WHOLE_CLOTH.items():
        if scene.all_of(kind) and not (kind == "external" and idle):
            raise SceneError(scene.name_of(kind), None, f"{what}; run the scene on one GPU or process")
