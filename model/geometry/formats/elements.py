"""Files of finite elements: named vertices, triangles, quadrilaterals and tetrahedra, and the surface of all that."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.geometry.formats.faces import Faces

SIDES = np.array([(1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1)])  # of a tetrahedron, outer side outwards


def _none(corners: int) -> np.ndarray:
    return np.zeros((0, corners), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Elements:
    """`name` (vertices,) int64; `position` (vertices, 3) float64; `triangles` (n, 3), `quads` (n, 4), `tetrahedra` (n, 4)
    int64, by names."""

    name: np.ndarray
    position: np.ndarray
    triangles: np.ndarray = field(default_factory=lambda: _none(3))
    quads: np.ndarray = field(default_factory=lambda: _none(4))
    tetrahedra: np.ndarray = field(default_factory=lambda: _none(4))

    def places(self, named: np.ndarray, what: str) -> np.ndarray:
        """Return the indices of the vertices with the numbers `named`. Raises InputError for an unknown number and for
        a number that occurs twice."""
        order = np.argsort(self.name, kind="stable")
        ordered = self.name[order]
        twice = ordered[:-1][np.diff(ordered) == 0]
        if len(twice):
            raise InputError(f"two vertices have the number {twice[0]}; export it again")
        place = np.minimum(np.searchsorted(ordered, named), len(ordered) - 1)
        missing = ordered[place] != named if len(ordered) else np.ones(named.shape, dtype=bool)
        if missing.any():
            raise InputError(
                f"a {what} names vertex {named[missing][0]}, and there is none of that number; the file is damaged or cut "
                "short: export it again"
            )
        return order[place]

    def surface(self) -> Faces:
        """Return the surface of the tetrahedra, or where there are none, the triangles and quadrilaterals."""
        if len(self.tetrahedra):
            tetrahedra = self.places(self.tetrahedra, "tetrahedron")
            sides = tetrahedra[:, SIDES].reshape(-1, 3)
            _, number, count = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True)
            outer = sides[count[number.reshape(-1)] == 1]
            note = f"the surface of its {len(tetrahedra)} tetrahedra was taken: {len(outer)} triangles"
            return Faces(self.position, outer.ravel(), np.full(len(outer), 3), notes=(note,))
        faces = [self.places(corners, "face") for corners in (self.triangles, self.quads)]
        sizes = np.repeat([3, 4], [len(corners) for corners in faces])
        return Faces(self.position, np.concatenate([corners.ravel() for corners in faces]), sizes)
