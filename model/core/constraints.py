"""Constraints as data: what a backend's executor of position-based constraints needs to know of them.

A constraint is corners, values, a colour and a projection function (model/formulas/constraints). Constraints come in runs,
often of one: those of a run are projected one after the other, and no two runs of a colour move the same particle, so that
all runs of a colour are projected at once, in any order, to the same bits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Projection:
    """How the constraints of a set are projected: what a kernel is compiled for.

    `make`, `flags`: the factory in model/formulas/constraints, and its flags. Of one constraint: how many `corners`, of which
    the first `moves` are moved (None: all); `values`; `multipliers`, which are kept through a substep's iterations where it
    is `soft`. `damped`: it asks where its corners were when the substep began. `constants`: what in the solver's record
    compliance, damping and stiffening lie; None: it takes none of them. `run`: how many constraints one thread projects one
    after the other.
    """

    name: str
    make: Callable[..., Any]
    corners: int
    values: int
    multipliers: int = 1
    moves: int | None = None
    soft: bool = True
    damped: bool = False
    flags: tuple[tuple[str, int], ...] = ()
    constants: tuple[str, str, str] | None = None
    run: int = 1

    @property
    def around(self) -> bool:
        """Whether the constraints of a run stand around its last one, whose corners are c0, c1, ...: each of the others has a
        corner of its own in place of one of these, constraint m in place of cm, then c(m + 1), c(m + 2), ... in turn."""
        return self.run == self.corners + 1

    @property
    def moved(self) -> int:
        """How many corners it moves."""
        return self.corners if self.moves is None else self.moves


@dataclass(frozen=True, eq=False)
class ConstraintSet:
    """Constraints of one kind: colour c is those from `starts[c]` to before `starts[c + 1]`, `run` after `run`.

    `kind`: of the scene's part; `model`: its name among MODELS (model/xpbd/mesh_constraints.py); `corners` (constraints,
    corners) int32: particles; `values` (constraints, values) float64, as the projection takes them.
    """

    kind: str
    model: str
    corners: np.ndarray
    values: np.ndarray
    starts: np.ndarray
    run: int = 1

    @property
    def colours(self) -> int:
        """How many."""
        return len(self.starts) - 1

    def some(self, chosen: np.ndarray, particles: np.ndarray) -> ConstraintSet:
        """The `chosen` (constraints,) bool, whole runs, in their colours and order; of the `particles` (n,), ascending, the
        first is number 0. Colours of which none is left are gone."""
        before = np.concatenate([[0], np.cumsum(chosen)])
        starts = np.unique(before[self.starts]).astype(self.starts.dtype)
        corners = np.searchsorted(particles, self.corners[chosen]).astype(np.int32)
        return replace(self, corners=corners, values=self.values[chosen], starts=starts)

    @property
    def sweep(self) -> list[np.ndarray]:
        """Constraints no two of which move the same particle, one such set after the other: an iteration."""
        colours = (np.arange(*self.starts[c : c + 2]).reshape(-1, self.run) for c in range(self.colours))
        return [members for colour in colours for members in colour.T]
