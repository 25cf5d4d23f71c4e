"""Constraints as data for a backend's executor of position-based constraints.

A constraint has corners, values, a colour and a projection function (model/formulas/constraints). Constraints come in
runs, often of one. Those of a run are projected one after the other. No two runs of a colour move the same particle, so
that all runs of a colour are projected at once, in any order, with the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np

from softlab.model.base.types import Feature
from softlab.model.geometry.colouring import colour


@dataclass(frozen=True)
class Projection:
    """Projection of a constraint set, for which a kernel is compiled.

    `formulas`, `flags`: the module in model/formulas/constraints and the features of its variant. Per constraint:
    `corners`, of which the first `moves` are moved (None: all); `values`; `multipliers`, stored through a substep's
    iterations if `soft`.
    `damped`: the projection reads its corners at the substep's start. `constants`: names of compliance, damping and
    stiffening in the solver's record; None: it uses none of them. `run`: constraints that one thread projects one after
    the other.
    """

    name: str
    formulas: ModuleType
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
        """True if each constraint of a run shares all but one corner with its last one.

        The last one has the corners c0, c1, ...; constraint m has a corner of its own in place of cm, then c(m + 1),
        c(m + 2), ... cyclically.
        """
        return self.run == self.corners + 1

    @property
    def moved(self) -> int:
        """Number of corners that it moves."""
        return self.corners if self.moves is None else self.moves

    @property
    def features(self) -> dict[str, Feature]:
        """Features of the executor's variant (model/base/variant.py), and of the projection's formulas."""
        words = ("name_of_compliance", "name_of_damping", "name_of_stiffening")
        names: tuple[Feature, ...] = self.constants or (False, False, False)
        return dict(zip(words, names, strict=True)) | {
            "corners": self.corners, "values": self.values, "multipliers": self.multipliers, "moved": self.moved,
            "soft": self.soft, "damped": self.damped, "run": self.run, "around": self.around,
            "per_constraint": False, **dict(self.flags),
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class ConstraintSet:
    """Constraints of one kind: colour c contains those from `starts[c]` to before `starts[c + 1]`, `run` after `run`.

    `kind`: of the scene's part; `model`: a name in MODELS (model/position_based/mesh_constraints.py); `corners`:
    (constraints, corners) int32 particles; `values`: (constraints, values) float64, as the projection takes them.
    """

    kind: str
    model: str
    corners: np.ndarray
    values: np.ndarray
    starts: np.ndarray
    run: int = 1

    @property
    def colours(self) -> int:
        """Number of colours."""
        return len(self.starts) - 1

    def some(self, chosen: np.ndarray, particles: np.ndarray) -> ConstraintSet:
        """Return the `chosen` constraints, (constraints,) bool, whole runs, in their colours and order.

        `particles`: (n,), ascending; they are renumbered from 0. Empty colours are removed.
        """
        before = np.concatenate([[0], np.cumsum(chosen)])
        starts = np.unique(before[self.starts]).astype(self.starts.dtype)
        corners = np.searchsorted(particles, self.corners[chosen]).astype(np.int32)
        return replace(self, corners=corners, values=self.values[chosen], starts=starts)

    @property
    def sweep(self) -> list[np.ndarray]:
        """Sets of constraints of which no two move the same particle, in the order of an iteration."""
        colours = (np.arange(*self.starts[c : c + 2]).reshape(-1, self.run) for c in range(self.colours))
        return [members for colour in colours for members in colour.T]


def coloured(kind: str, model: str, corners: np.ndarray, values: np.ndarray, particles: int) -> ConstraintSet:
    """Return the constraints as a set sorted by colours."""
    colouring = colour(corners, particles)
    return ConstraintSet(
        kind, model, np.ascontiguousarray(corners[colouring.order]), values[colouring.order], colouring.starts
    )
