"""The largest frequency of a spring net, computed before a run: it limits the step sizes of explicit integrators.

In any state a spring's stiffness matrix has no eigenvalue above its stiffness k. So the net's largest w^2 is at most
the largest eigenvalue of its weighted graph Laplacian over the masses, M^(-1/2) L M^(-1/2) with (L x)_i = sum k_ij (x_i
- x_j) and x = 0 at pinned masses; a net without rest lengths (or stretched far beyond them) has exactly that one.

Grids pinned at the top row or at all edges, and free ones, have a closed form: the sum of the path graphs' eigenvalues.
Elsewhere it is computed without a matrix by power iteration, accelerated by adding the last direction and taking the
best vector of the span (Knyazev 2001, "Toward the optimal preconditioned eigensolver", SIAM J. Sci. Comput. 23(2),
algorithm 4.1). That estimate is from below. A rigorous upper bound is the smaller of Gershgorin's (1931) and Collatz's
(1942), max_i (|A| u)_i / u_i for any u > 0, which equals the estimate where springs form no odd cycles. A cloth, pinned
or not, is a part of an infinite one, whose eigenvalues have a closed form (model/core/stability/cloth_bounds.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, inf, isfinite, pi, sin, sqrt

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.core.build import build, pinned_indices, sheet_name
from softlab.model.core.families import family_of, stability_limit
from softlab.model.core.integrators import frequency_bound, lightest_mass
from softlab.model.core.stability.springs import spring_ends, spring_stiffness
from softlab.model.scene.scene import Scene
from softlab.model.tables.parts import Grid

TOLERANCE = 1e-6  # of the residual |A x - lambda x| over lambda: at most half of it in the frequency
MAX_ITERATIONS = 5000
MAX_MASSES = 2**14  # of a grid with power iteration, about a second; larger ones are bounded by the closed form
COLLATZ_OFFSET = 1e-12  # added to Collatz's vector, so that it is positive everywhere


@dataclass(frozen=True)
class Frequency:
    """The largest angular frequency [1/s] of a net: `estimate`, and `upper`, a rigorous bound.

    `how`: `closed form`, `iterated`, or `bounded` (too large to iterate; the estimate is the bound). `iterations`;
    `residual`: |A x - lambda x| / lambda at the end; `converged`: under TOLERANCE. `mode` (particles,): the shape of
    the fastest vibration along an axis, with largest entry 1, 0 where pinned; None for `bounded`.
    """

    estimate: float
    upper: float
    how: str
    iterations: int = 0
    residual: float = 0.0
    converged: bool = True
    mode: np.ndarray | None = None


@dataclass(frozen=True)
class Net:
    """Springs as a weighted graph.

    `ends`: (springs, 2) indices; `stiffness`: (springs,) [N/m]; `inverse_mass`: (particles,) [1/kg], 0 where pinned.
    """

    ends: np.ndarray
    stiffness: np.ndarray
    inverse_mass: np.ndarray

    def apply(self, x: np.ndarray, sign: float = -1.0) -> np.ndarray:
        """Return A x = M^(-1/2) L M^(-1/2) x [1/s^2] for x (particles,); `sign` 1: |A| x, with all entries positive."""
        root = np.sqrt(self.inverse_mass)
        y = root * x
        i, j = self.ends.T
        at_i = self.stiffness * (y[i] + sign * y[j])
        at_j = self.stiffness * (y[j] + sign * y[i])
        count = len(x)
        return root * (np.bincount(i, at_i, count) + np.bincount(j, at_j, count))

    def gershgorin(self) -> float:
        """Return max_i (A_ii + sum_j |A_ij|) of M^(-1) L, the similar matrix: no eigenvalue [1/s^2] exceeds it."""
        i, j = self.ends.T
        count = len(self.inverse_mass)
        stiffness = self.stiffness
        free = self.inverse_mass > 0
        row = np.bincount(i, stiffness * (1.0 + free[j]), count) + np.bincount(j, stiffness * (1.0 + free[i]), count)
        return float((self.inverse_mass * row).max(initial=0.0))


def largest_frequency(net: Net, tolerance: float = TOLERANCE, most: int = MAX_ITERATIONS) -> Frequency:
    """Return the largest frequency of any net by accelerated power iteration from a fixed start.

    It ends when the residual is under `tolerance` (then an eigenvalue is that near), or after `most` iterations, not
    converged. Raises SceneError for stiffnesses or masses that are negative or not finite.
    """
    for name, values in (("stiffness", net.stiffness), ("inverse_mass", net.inverse_mass)):
        if not (np.isfinite(values).all() and (np.asarray(values) >= 0).all()):
            raise SceneError(name, float(np.min(values)), "must be finite and not negative")
    free = net.inverse_mass > 0
    gershgorin = net.gershgorin()
    if gershgorin == 0:
        return Frequency(0.0, 0.0, "closed form", mode=np.zeros(len(free)))
    # no net is likely to have a symmetry that makes this start orthogonal to its fastest mode, which alternates
    x = np.where(free, np.sin(1.0 + 2.399963 * np.arange(len(free)) ** 1.5), 0.0)
    x /= np.linalg.norm(x)
    moved = net.apply(x)
    value = float(x @ moved)
    direction, iterations, residual = np.zeros_like(x), 0, np.inf
    while iterations < most:
        rest = moved - value * x
        residual = float(np.linalg.norm(rest)) / gershgorin
        if residual * gershgorin <= tolerance * value:
            break
        basis, _ = np.linalg.qr(np.stack([x, rest, direction] if iterations else [x, rest], axis=1))
        images = np.stack([net.apply(column) for column in basis.T], axis=1)
        projected = basis.T @ images
        _, vectors = np.linalg.eigh((projected + projected.T) / 2)
        best = vectors[:, -1]
        new = basis @ best
        direction = new - x * (x @ new)
        x = new / np.linalg.norm(new)
        moved = images @ best / np.linalg.norm(new)
        value = float(x @ moved)
        iterations += 1
    positive = np.where(free, np.abs(x) + COLLATZ_OFFSET, 0.0)
    collatz = float((net.apply(positive, 1.0)[free] / positive[free]).max())
    upper = sqrt(max(min(gershgorin, collatz), value))
    shape = np.sqrt(net.inverse_mass) * x
    relative = residual * gershgorin / value if value > 0 else 0.0
    mode = shape / shape[np.argmax(np.abs(shape))]
    return Frequency(sqrt(value), upper, "iterated", iterations, relative, relative <= tolerance, mode)


def _path_eigenvalue(count: int, tied: int) -> float:
    """Return the largest eigenvalue of the Laplacian of a path of `count` free vertices, `tied` of whose ends (0, 1:
    the start, 2) are tied to a fixed vertex beyond."""
    if tied == 0:
        return 4 * cos(pi / (2 * count)) ** 2
    return 4 * sin(_path_angle(count, tied) / 2) ** 2


def _path_angle(count: int, tied: int) -> float:
    return (2 * count - 1) * pi / (2 * count + 1) if tied == 1 else count * pi / (count + 1)


def _path_shape(count: int, tied: int) -> np.ndarray:
    """Return the eigenvector (count,) of `_path_eigenvalue`."""
    k = np.arange(count)
    if tied == 0:
        return np.cos(pi * (count - 1) * (k + 0.5) / count)
    return np.sin(_path_angle(count, tied) * (k + 1))


def grid_eigenvalue(grid: Grid, shaped: bool = True) -> tuple[float, np.ndarray | None] | None:
    """Return the largest eigenvalue of a grid's Laplacian (unit stiffness and mass) and its shape (particles,), in
    closed form.

    Without `shaped` the shape is None and nothing is allocated. Known for `pinned` none, top and edges; None for
    others. Free N x M: 4 cos^2(pi / 2N) + 4 cos^2(pi / 2M); top row fixed, n = N - 1: 4 sin^2((2n-1) pi / (2 (2n+1))) +
    4 cos^2(pi / 2M); all edges: 4 sin^2((N-2) pi / (2 (N-1))) and the same in M.
    """
    if grid.pinned not in ("none", "top", "edges"):
        return None
    tied = {"none": 0, "top": 1, "edges": 2}[str(grid.pinned)]
    margins = {0: (0, 0), 1: (1, 0), 2: (2, 2)}[tied]
    free = grid.rows - margins[0], grid.columns - margins[1]
    if min(free) < 1:
        return 0.0, np.zeros(grid.particle_count) if shaped else None
    sides = (free[0], tied), (free[1], 2 if tied == 2 else 0)
    down, across = (_path_eigenvalue(*side) for side in sides)
    if not shaped:
        return down + across, None
    tall, wide = (_path_shape(*side) for side in sides)
    shape = np.zeros((grid.rows, grid.columns))
    top, left = (1, 1) if tied == 2 else (tied, 0)
    shape[top : top + free[0], left : left + free[1]] = np.outer(tall, wide)
    return down + across, (shape / np.abs(shape).max()).ravel()


def _edges(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return (ends (springs, 2), stiffness (springs,) [N/m]) of all springs of a cloth."""
    rows, columns = scene.grid.rows, scene.grid.columns
    ends = {kind: spring_ends(rows, columns, kind) for kind in scene.cloth_springs}
    stiffness = [np.full(len(ends[kind]), part.stiffness) for kind, part in scene.cloth_springs.items()]
    return np.concatenate([np.zeros((0, 2), np.int32), *ends.values()]), np.concatenate([np.zeros(0), *stiffness])


def scene_net(scene: Scene) -> Net:
    """Return the scene's springs as a graph. A scene without springs is a net without edges."""
    grid = scene.grid
    for name, mass in [(sheet_name(scene), grid.mass), *((name, load.mass) for name, load in scene.loads.items())]:
        if 1 / mass == inf:
            raise SceneError(f"{name}.mass", mass, "is too small: nothing so light has a finite acceleration")
    if scene.loads:
        inverse_mass = build(scene).inverse_mass
    else:
        inverse_mass = np.full(grid.particle_count, 1 / grid.mass)
        inverse_mass[pinned_indices(grid)] = 0
    if scene.cloth:
        return _finite(Net(*_edges(scene), inverse_mass), scene)
    ends = spring_ends(grid.rows, grid.columns) if scene.springs else np.zeros((0, 2), np.int32)
    across, down = spring_stiffness(scene)
    along_rows = np.broadcast_to(across, (grid.rows, grid.columns - 1))
    stiffness = np.concatenate([along_rows.ravel(), np.broadcast_to(down, (grid.rows - 1, grid.columns)).ravel()])
    stiffness = stiffness[: len(ends)]  # none in a scene without springs
    return _finite(Net(ends, stiffness, inverse_mass), scene)


def _finite(net: Net, scene: Scene) -> Net:
    """Return the net if its frequencies are finite. Raises SceneError for the stiffest of its springs."""
    with np.errstate(over="ignore"):
        bound = net.gershgorin()
    if isfinite(bound):
        return net
    tables = {"springs": scene.springs} if scene.springs else scene.cloth_springs
    name, stiffest = max(tables.items(), key=lambda item: item[1].stiffness)
    ratio = getattr(stiffest, "stiffness_ratio", 1.0)
    field, value = ("stiffness_ratio", ratio) if ratio > stiffest.stiffness else ("stiffness", stiffest.stiffness)
    raise SceneError(f"{name}.{field}", value, "is too large for these masses: no frequency so high is a finite number")


def _free_bound(scene: Scene) -> float:
    """Return a frequency [1/s] that no vibration of the scene's grid without its pins exceeds.

    It is the largest one where springs are equal. Where they alternate, a mass has one of each along every direction,
    and Gershgorin's bound is twice their sum. A cloth has the bound for any state. Where masses differ, all count as
    the lightest.
    """
    grid, springs, mass = scene.grid, scene.springs, lightest_mass(scene)
    if springs is None:
        return frequency_bound(scene)
    if springs.alternate:
        most = [0.0, 0.0, springs.stiffness, springs.stiffness + springs.largest_stiffness]
        return sqrt(2 * sum(most[min(count, 3)] for count in (grid.rows, grid.columns)) / mass)
    free_grid = grid_eigenvalue(scene.sheet.model_copy(update={"pinned": "none"}), shaped=False)
    assert free_grid is not None
    return sqrt(springs.stiffness / mass * free_grid[0])


def scene_frequency(scene: Scene, shaped: bool = True) -> Frequency:
    """Return the largest frequency of the scene's net in any state.

    It has a closed form (a grid's equal springs and masses), is iterated, or (large with other pins, alternating
    springs, several masses, or a cloth) bounded. A pin removes rows and columns from the matrix, which lowers its
    largest eigenvalue (Cauchy's interlacing), so that the free grid bounds every other. Without `shaped`, the mode is
    not computed unless it is needed.
    """
    grid = scene.grid
    if not (scene.springs or scene.cloth_springs):
        return Frequency(0.0, 0.0, "closed form", mode=np.zeros(grid.particle_count) if shaped else None)
    even = scene.springs and not scene.springs.alternate and not scene.loads
    closed = grid_eigenvalue(scene.sheet, shaped) if even else None
    if scene.springs and closed is not None:
        w = sqrt(scene.springs.stiffness / grid.mass * closed[0])
        return Frequency(w, w, "closed form", mode=closed[1])
    bound = _free_bound(scene)
    if grid.particle_count > MAX_MASSES:
        return Frequency(bound, bound, "bounded")
    frequency = largest_frequency(scene_net(scene))
    return replace(frequency, upper=min(frequency.upper, bound))


def frequency_lines(scene: Scene) -> list[str]:
    """Return the lines of `softlab plan` on it: the largest frequency, how it is known, and the resulting step size."""
    springs = [scene.springs] if scene.springs else [*scene.cloth_springs.values()]
    if not springs or not family_of(scene).limited_by_net:
        return []
    if scene.method.solver == "pbd" or any(one.inextensible for one in springs):  # then they have no such stiffness
        return []
    frequency = scene_frequency(scene, shaped=False)
    name, sheet = scene.method.name, "cloth" if scene.cloth else "grid"
    limit = stability_limit(scene, frequency.upper)
    how = {
        "closed form": "closed form",
        "iterated": f"{frequency.iterations} iterations, surely under {frequency.upper:.6g}",
        "bounded": f"bound: the free {sheet}'s",
    }[frequency.how]
    if not frequency.converged:
        how += f"; not converged, residual {frequency.residual:.1g}"
    step = f"{name} holds to dt {limit:.6g} s" if limit > 0 else f"{name} holds at no dt"
    if limit == inf:
        step = f"{name} holds at any dt"
    return [
        f"largest frequency {frequency.estimate:.6g} 1/s of this net ({how}), {frequency_bound(scene):.6g} 1/s of any "
        f"{sheet}; for this net {step}"
    ]
