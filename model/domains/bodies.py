"""Who owns what when bodies that never meet are shared, each as a whole: pure arithmetic, and the scene of a share.

A share is neighbouring bodies in the order of the file. Nothing acts from one body on another, so that a share is stepped by
the scene's own kernels, and nobody is told of anything until the state is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from model.core.errors import SceneError


@dataclass(frozen=True, eq=False)
class Apart:
    """The bodies of a scene, none of which acts on another.

    `names`: of the part of each; `weights` (bodies,) int64: how much work each is, in numbers of what is `counted`;
    `first_particle` (bodies + 1,) int64; `held`: what the scene calls its set of particles; `some(first, end)`: the set of
    those bodies alone; `clusters(first, end)`: which of all clusters theirs are, in the order in which that set has them,
    (n,) int64.
    """

    names: tuple[str, ...]
    weights: np.ndarray
    counted: str
    first_particle: np.ndarray
    held: str
    some: Callable[[int, int], Any]
    clusters: Callable[[int, int], np.ndarray]

    def scene(self, whole: Any, some: Any) -> Any:
        """`whole`, with `some` in the place of all its bodies: what else there is stays, and what masses are counted in."""
        found = copy(whole)
        vars(found).update({"grid": some, self.held: some})
        return found


def require_apart(scene: Any) -> None:
    """Raises SceneError for a scene's contacts, which let bodies meet."""
    if scene.contact is not None:
        told = "lets bodies meet, which are not shared then: leave it out, and they pass through each other, or run it as one"
        raise SceneError(f"{scene.name_of('contact')}.kind", "contact", told)


@dataclass(frozen=True)
class Share:
    """Bodies `first` to before `end`, with the particles `first_particle` to before `end_particle`; `weight`: what of theirs
    is counted; `parts`: the names of theirs."""

    number: int
    first: int
    end: int
    first_particle: int
    end_particle: int
    weight: int
    parts: tuple[str, ...]

    @property
    def particles(self) -> slice:
        """Where in the whole set they are."""
        return slice(self.first_particle, self.end_particle)


@dataclass(frozen=True)
class Division:
    """Bodies in shares; `counted`: what they are balanced by."""

    shares: tuple[Share, ...]
    counted: str

    @property
    def count(self) -> int:
        """How many shares."""
        return len(self.shares)

    @property
    def largest(self) -> int:
        """The weight of the heaviest share."""
        return max(share.weight for share in self.shares)

    @property
    def balance(self) -> float:
        """The fair part over that of the heaviest share: how much faster all are than one, over their number."""
        return sum(share.weight for share in self.shares) / (self.count * self.largest)


def divide(apart: Apart, count: int, option: str) -> Division:
    """The bodies in `count` shares: each cut at the border of two bodies that is nearest to where a fair one would be, so
    that no share is heavier than a fair one and a body. Raises SceneError, naming the `option`, for more of them than
    bodies."""
    bodies = len(apart.weights)
    if count < 1:
        raise SceneError(option, count, "must be at least 1")
    if count > bodies:
        told = (
            "1 body is never cut"
            if bodies == 1
            else f"{bodies} bodies, which are not cut, can be shared by at most {bodies}"
        )
        raise SceneError(option, count, f"{told}; use {'1' if bodies == 1 else 'fewer'}")
    ends = np.concatenate([[0], np.cumsum(apart.weights)])
    cuts = [0]
    for k in range(1, count):
        nearest = int(np.abs(ends - ends[-1] * k / count).argmin())
        cuts.append(min(max(nearest, cuts[-1] + 1), bodies - (count - k)))
    first = apart.first_particle
    return Division(
        tuple(
            Share(k, a, b, int(first[a]), int(first[b]), int(ends[b] - ends[a]), tuple(dict.fromkeys(apart.names[a:b])))
            for k, (a, b) in enumerate(pairwise([*cuts, bodies]))
        ),
        apart.counted,
    )
