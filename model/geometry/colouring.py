"""Colours for constraints, such that no two of one colour share a vertex and all of a colour can be solved at once.

Constraints have a random but fixed order of priority. Colour by colour, as many uncoloured constraints as possible get
the colour: in rounds each that comes first at all its vertices takes it, and those that share a vertex with it wait for
the next colour (M. Luby, "A simple parallel algorithm for the maximal independent set problem", SIAM J. Comput. 15
(1986); M. T. Jones, P. E. Plassmann, "A parallel graph coloring heuristic", SIAM J. Sci. Comput. 14 (1993)). That is
the greedy colouring in that order. Then greedy colouring is repeated with whole colours in another order, which never
takes more colours (J. C. Culberson, "Iterated greedy graph coloring and the difficulty landscape" (1992)).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.base.waiting import work
from softlab.model.geometry.lists import offsets_of

MAX_COLOURS = 1 << 14  # each is a launch or a barrier per sweep
RINGS = "to avoid it, divide the triangles around it into rings, so that fewer edges end there"
PASSES = 32  # of repeated colouring; later ones did not save any colour in tests
WORD = 63  # colours in one signed word of used colours


@dataclass(frozen=True)
class Colouring:
    """`order` (n,) int32: constraints by colour, ascending in each; colour c is `order[starts[c]:starts[c + 1]]`,
    `starts` (colours + 1,) int32, larger colours first. `least`: the largest number of constraints at a vertex, a lower
    bound of colours."""

    order: np.ndarray
    starts: np.ndarray
    least: int

    @property
    def colours(self) -> int:
        """Number of colours."""
        return len(self.starts) - 1


@work("colouring constraints")
def colour(constraints: np.ndarray, vertex_count: int, seed: int = 0) -> Colouring:
    """Return colours for `constraints` (n, k): the k different vertices 0 ... vertex_count - 1 of each.

    The same for the same arguments. Raises SceneError where a vertex has more than MAX_COLOURS constraints.
    """
    vertices = np.asarray(constraints, dtype=np.int64)
    valence = np.bincount(vertices.ravel(), minlength=vertex_count)
    least = int(valence.max(initial=0))
    if least > MAX_COLOURS:
        raise SceneError(
            "constraints",
            least,
            f"meet at vertex {int(np.argmax(valence))} (counted from 0), and at most {MAX_COLOURS} can; {RINGS}",
        )
    generator = np.random.default_rng(seed)
    colours = _greedy(vertices, vertex_count, generator.permutation(len(vertices)))
    for turn in range(PASSES):
        sizes = np.bincount(colours)
        if not least < len(sizes) <= WORD:
            break
        order = generator.permutation(len(sizes)) if turn % 2 else np.arange(len(sizes))[::-1]
        colours = _again(vertices, vertex_count, colours, order)
    sizes = np.bincount(colours)
    rank = np.empty(len(sizes), dtype=np.int64)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
    order = np.argsort(rank[colours], kind="stable").astype(np.int32)
    return Colouring(order, offsets_of(np.sort(sizes)[::-1]), least)


def _greedy(vertices: np.ndarray, vertex_count: int, priority: np.ndarray) -> np.ndarray:
    """Return the colours of the greedy colouring by ascending `priority` (n,), a permutation, (n,) int64."""
    colours = np.full(len(vertices), -1, dtype=np.int64)
    earliest = np.empty(vertex_count, dtype=np.int64)
    waiting, number = np.arange(len(vertices)), 0
    while len(waiting):
        blocked = np.zeros(vertex_count, dtype=bool)
        able = waiting
        while len(able):
            at, ranks = vertices[able], priority[able][:, None]
            earliest[at] = len(vertices)
            np.minimum.at(earliest, at, ranks)
            takes = (earliest[at] == ranks).all(axis=1)
            colours[able[takes]] = number
            blocked[at[takes]] = True
            able = able[~blocked[at].any(axis=1)]
        waiting = waiting[colours[waiting] < 0]
        number += 1
        if len(waiting) and (vertices[waiting] == np.bincount(vertices[waiting].ravel()).argmax()).any(axis=1).all():
            colours[waiting[np.argsort(priority[waiting])]] = number + np.arange(len(waiting))
            break
    return colours


def _again(vertices: np.ndarray, vertex_count: int, colours: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Return the lowest free colour of each constraint, all of a colour at once, colours in `order`, (n,) int64."""
    members = np.split(np.argsort(colours, kind="stable"), np.cumsum(np.bincount(colours))[:-1])
    used = np.zeros(vertex_count, dtype=np.int64)  # a bit for each colour at the vertex
    new = np.empty_like(colours)
    for old in order:
        at = vertices[members[old]]
        taken = np.bitwise_or.reduce(used[at], axis=1)
        lowest = ~taken & (taken + 1)
        used[at] |= lowest[:, None]
        new[members[old]] = np.frexp(lowest.astype(np.float64))[1] - 1
    return new
