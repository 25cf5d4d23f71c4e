"""Energies and strain of a grid, a cloth or bodies, in float64 on the host; for judging and showing, not for stepping."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from model.core.build import masses
from model.scene.scene import Scene
from model.shape_matching.lattice import matching_axis
from model.shape_matching.matching import matching_stiffness
from model.shape_matching.spare import absent
from model.xpbd.mesh_constraints import edges_of, mesh_energy

WAYS = {  # (rows, columns) from one end of a spring to the other, by kind; a grid's are the structural ones
    "structural": ((0, 1), (1, 0)),
    "shear": ((1, 1), (1, -1)),
    "bending": ((0, 2), (2, 0)),
}


def _both_ends(sheet: np.ndarray, way: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Views of `sheet` (rows, columns, ...) at the first and at the other ends of the springs that go one way."""
    down, across = way
    rows, columns = max(0, sheet.shape[0] - down), max(0, sheet.shape[1] - abs(across))
    first, other = max(0, -across), max(0, across)
    return sheet[:rows, first : first + columns], sheet[down : down + rows, other : other + columns]


def cloth_lengths(scene: Scene, position: np.ndarray, kind: str) -> tuple[np.ndarray, float | np.ndarray]:
    """(lengths (springs,) [m] of a cloth's springs of a kind, in the order of `spring_ends`; their rest length [m]). Of a
    mesh in the order of `edges_of`, with a rest length for each."""
    if scene.mesh:
        pairs, rest = edges_of(scene, kind)
        p = np.asarray(position, dtype=np.float64)
        return np.linalg.norm(p[pairs[:, 1]] - p[pairs[:, 0]], axis=1), rest
    sheet = np.asarray(position, dtype=np.float64).reshape(scene.grid.rows, scene.grid.columns, 3)
    ends = [_both_ends(sheet, way) for way in WAYS[kind]]
    lengths = [np.linalg.norm(other - first, axis=-1).ravel() for first, other in ends]
    return np.concatenate(lengths), scene.grid.spacing * float(np.hypot(*WAYS[kind][0]))


def _lengths(scene: Scene, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lengths [m] of the horizontal (rows, columns - 1) and vertical (rows - 1, columns) springs."""
    grid = scene.grid
    p = np.asarray(position, dtype=np.float64).reshape(grid.rows, grid.columns, 2)
    across, down = p[:, 1:] - p[:, :-1], p[1:] - p[:-1]
    return np.hypot(across[..., 0], across[..., 1]), np.hypot(down[..., 0], down[..., 1])


def spring_strain(
    scene: Scene, position: np.ndarray, kind: str = "structural", plastic: np.ndarray | None = None
) -> np.ndarray:
    """(springs,) float64: (length - rest) / rest of the horizontal springs row by row, then of the vertical ones.

    For a rest length of zero: length / spacing. In the order of `spring_ends`. Of a cloth: of its springs of that `kind`,
    or, where it has none, what they would be strained. Of bodies: (entries,), see `goal_strain`.
    """
    if scene.bodies:
        return goal_strain(scene, position, plastic)
    if scene.cloth:
        length, rest = cloth_lengths(scene, position, kind)
        return (length - rest) / rest
    across, down = _lengths(scene, position)
    length = np.concatenate([across.ravel(), down.ravel()])
    rest = scene.springs.rest_length if scene.springs else scene.grid.spacing
    return length / scene.grid.spacing if rest == 0 else (length - rest) / rest


def lattice_energy(scene: Scene, position: np.ndarray) -> float:
    """[J]: of the clusters of a grid that is solved by shape matching, the `Clusters.energy` of
    model/shape_matching/matching.py's
    `lattice_clusters`, window by window and without their indices, which are many."""
    grid, n = scene.grid, scene.method.region
    down, across = matching_axis(grid.rows, n), matching_axis(grid.columns, n)
    rest = scene.springs.rest_length if scene.springs else grid.spacing
    here = np.asarray(position, dtype=np.float64).reshape(grid.rows, grid.columns, 2).transpose(2, 0, 1)
    placed = np.pad(here, ((0, 0), (n, n), (n, n)))
    weight = np.pad(grid.mass * down.share[:, None] * across.share, n)  # nothing weighs anything outside

    def members() -> Iterator[tuple[np.ndarray, ...]]:
        """(mass, x and y from the window's middle, rest offset along x and y) of a member of every window."""
        for i, j in np.ndindex(2 * n + 1, 2 * n + 1):
            window = slice(i, i + grid.rows), slice(j, j + grid.columns)
            x, y = placed[:, *window] - here
            yield weight[window], x, y, (j - n - across.centre)[None, :] * rest, -(i - n - down.centre)[:, None] * rest

    centre_x, centre_y, along, turned = (np.zeros((grid.rows, grid.columns)) for _ in range(4))
    for mass, x, y, rest_x, rest_y in members():
        centre_x += mass * x
        centre_y += mass * y
        along += mass * (x * rest_x + y * rest_y)
        turned += mass * (y * rest_x - x * rest_y)
    inverse = down.inverse_mass[:, None] * across.inverse_mass / grid.mass
    centre_x, centre_y = centre_x * inverse, centre_y * inverse
    angle = np.arctan2(turned, along)
    cosine, sine = np.cos(angle), np.sin(angle)
    total = 0.0
    for mass, x, y, rest_x, rest_y in members():
        away_x = centre_x + cosine * rest_x - sine * rest_y - x
        away_y = centre_y + sine * rest_x + cosine * rest_y - y
        total += float(np.sum(mass * (away_x * away_x + away_y * away_y)))
    return 0.5 * matching_stiffness(scene) * total


def goal_strain(scene: Scene, position: np.ndarray, plastic: np.ndarray | None = None) -> np.ndarray:
    """(entries,) float64: how far each particle of `position` (particles, 3) [m] is from where each of its clusters wants it,
    over its body's particle spacing; `plastic` as in State. NaN where positions are not finite."""
    crowd, clusters = scene.crowd, scene.crowd.clusters
    p = np.asarray(position, dtype=np.float64)
    if not np.isfinite(p).all():
        return np.full(len(clusters.indices), np.nan)
    spacing = np.array([copy.baked.spacing for copy in crowd.copies])[crowd.body[clusters.indices]]
    return np.linalg.norm(clusters.goals(p, plastic) - p[clusters.indices], axis=1) / spacing


def spring_ends(rows: int, columns: int, kind: str = "structural") -> np.ndarray:
    """(springs, 2) int32: the particles at the ends of every spring, horizontal ones row by row, then vertical ones.

    `kind` of a cloth's: `bending` in that order too; `shear`: those to the lower right, then those to the lower left.
    """
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    ends = [np.stack([end.ravel() for end in _both_ends(index, way)], axis=1) for way in WAYS[kind]]
    return np.ascontiguousarray(np.concatenate(ends))


def spring_count(rows: int, columns: int, kind: str = "structural") -> int:
    """How many springs `spring_ends` gives the ends of."""
    return sum(max(0, rows - down) * max(0, columns - abs(across)) for down, across in WAYS[kind])


def spring_stiffness(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness [N/m], float64: (1, columns - 1) of the horizontal springs, the same in every row, and (rows - 1, 1) of the
    vertical ones; 0 in a scene without springs.

    Where springs alternate, those from an odd column to the next, or an odd row, are the stiffer.
    """
    grid, springs = scene.grid, scene.springs
    soft, stiff = (springs.stiffness, springs.largest_stiffness) if springs else (0.0, 0.0)
    across, down = (np.where(np.arange(n - 1) % 2 == 1, stiff, soft) for n in (grid.columns, grid.rows))
    return across[None, :], down[:, None]


def energies(
    scene: Scene,
    position: np.ndarray,
    velocity: np.ndarray,
    plastic: np.ndarray | None = None,
    inverse_mass: np.ndarray | None = None,
) -> dict[str, float]:
    """Energies in joules: `kinetic`, `spring`, `gravity`, `potential` (both), `total`, `conserved`; of a cloth also that of
    its springs by kind. Where clusters take the place of springs, `spring` is theirs; `plastic`, `inverse_mass` as in State:
    what waits by it (None: at the scene's start) has none.

    With the true mass. Gravity's zero is at y = 0. `conserved` is what the scheme itself keeps (up to a bounded
    wobble) without damping: the total, except for the hand-out's step `lab`, which moves exactly like semi-implicit
    Euler with doubled masses under the same forces, and so keeps 2 * kinetic + potential.
    """
    springs, gravity = scene.springs, scene.gravity
    v = np.asarray(velocity, dtype=np.float64)
    mass = masses(scene, absent(scene, inverse_mass))  # what waits is at rest, and stores nothing
    kinetic = 0.5 * float(np.sum(mass * v * v))
    spring = 0.0
    if scene.method.matches_shapes:
        spring = scene.crowd.clusters.energy(position, plastic) if scene.bodies else lattice_energy(scene, position)
    elif springs and not springs.inextensible:
        for stiffness, length in zip(spring_stiffness(scene), _lengths(scene, position), strict=True):
            spring += 0.5 * float(np.sum(stiffness * (length - springs.rest_length) ** 2))
    by_kind = {}
    for kind, part in scene.cloth_springs.items():
        if scene.mesh:
            by_kind[kind] = mesh_energy(scene, position, kind)
            continue
        lengths, rest = cloth_lengths(scene, position, kind)
        by_kind[kind] = 0.5 * part.storing_stiffness * float(np.sum((lengths - rest) ** 2))
    spring += sum(by_kind.values())
    height = 0.0
    if gravity and gravity.enabled:
        y = np.asarray(position, dtype=np.float64)[:, 1:2]
        height = gravity.acceleration * float(np.sum(mass * y))
    potential = spring + height
    lab = scene.method.solver == "mass-spring" and scene.method.integrator == "lab"
    inertia = 2.0 if lab else 1.0
    return {
        "kinetic": kinetic,
        "spring": spring,
        "gravity": height,
        "potential": potential,
        "total": kinetic + potential,
        "conserved": inertia * kinetic + potential,
        **by_kind,
    }
