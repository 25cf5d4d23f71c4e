"""XPBD on a triangle mesh in slow, plain NumPy float64, one constraint at a time: the reference of both backends.

From the papers, without model/formulas or a backend; from the model it takes the mesh and the order of constraints.
Macklin et al., XPBD, 2016, eq. 17 and 18; bending as in E. Grinspun et al., Discrete Shells, 2003, and M. Bergou et
al., A Quadratic Bending Model for Inextensible Surfaces, 2006, written here with heights and feet of the wings instead
of cotangents, and with angles from an arc tangent. Multipliers in kg m, as in bench/reference/xpbd.py.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from softlab.bench.reference import cloth
from softlab.bench.reference.philox import random_directions
from softlab.bench.reference.steps import Motion, Poke, alone
from softlab.model.geometry.topology import mesh_of, pinned_vertices
from softlab.model.position_based.mesh_constraints import constraint_sets
from softlab.model.scene.scene import Scene


@dataclass(frozen=True)
class Hinge:
    """Triangles (a, b, c) and (b, a, d), described by the vectors e, f, g from a to b, c and d.

    `theta` [rad]: rotates the second out of the first's plane, toward its normal; `feet`: of c and d on the edge, 0 at
    a; `heights` [m] over the edge.
    """

    theta: float
    edge: float
    feet: tuple[float, float]
    heights: tuple[float, float]
    normals: tuple[np.ndarray, np.ndarray]

    @property
    def gradient(self) -> np.ndarray:
        """Gradient of theta by a, b, c, d: (4, 3) [1/m].

        A wing rotates by its rise over its height; the edge's ends rotate it back.
        """
        c, d = (n / h for n, h in zip(self.normals, self.heights, strict=True))
        s, t = self.feet
        return np.stack([-(1 - s) * c - (1 - t) * d, -s * c - t * d, c, d])

    @property
    def coefficients(self) -> np.ndarray:
        """Coefficients (4,) of a, b, c, d: their sum is |e| times the wings' directions towards the edge."""
        c, d = (self.edge / h for h in self.heights)
        s, t = self.feet
        return np.array([(1 - s) * c + (1 - t) * d, s * c + t * d, -c, -d])


def hinge(corners: np.ndarray) -> Hinge:
    """Return the hinge of `corners` (4, 3) [m]."""
    a, b, c, d = corners
    e = b - a
    edge = float(np.linalg.norm(e))
    along, feet, heights, outward = e / edge, [], [], []
    for wing in (c, d):
        foot = float((wing - a) @ along)
        away = wing - a - foot * along
        feet.append(foot / edge)
        heights.append(float(np.linalg.norm(away)))
        outward.append(away / heights[-1])
    normals = np.cross(along, outward[0]), np.cross(outward[1], along)
    theta = float(np.arctan2(outward[1] @ normals[0], normals[0] @ normals[1]))
    return Hinge(theta, edge, (feet[0], feet[1]), (heights[0], heights[1]), normals)


# corners -> values (n,) [m], gradients (n, corners, 3)
Constraint = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Item:
    """A constraint of vertices `corners`, with its compliance [m/N] and damper [N s/m]."""

    corners: np.ndarray
    of: Constraint
    compliance: float
    damping: float = 0.0


def distance(rest: float) -> Constraint:
    """Make the constraint |b - a| - rest."""

    def of(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        d = p[1] - p[0]
        length = float(np.linalg.norm(d))
        if length == 0:
            return np.zeros(1), np.zeros((1, 2, 3))
        return np.array([length - rest]), np.stack([-d, d])[None] / length

    return of


def isometric(rest_corners: np.ndarray, flat: float = 1e-9) -> Constraint:
    """Make the constraint on the three components of k, minus its length at rest.

    `flat`: a rest length below this fraction of the edge counts as 0.
    """
    at_rest = hinge(rest_corners)
    coefficients = at_rest.coefficients
    rest = float(np.linalg.norm(coefficients @ rest_corners))
    rest = 0.0 if rest < flat * at_rest.edge else rest

    def of(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        k = coefficients @ (p - p[0])
        length = float(np.linalg.norm(k))
        left = k * (1 - rest / length) if length > 0 else k
        return left, np.einsum("ij,c->icj", np.eye(3), coefficients)

    return of


def dihedral(rest_corners: np.ndarray, flat: float = 1e-9) -> Constraint:
    """Make the constraint |e| at rest times 4 (tan(theta/4) - tan(theta_0/4))."""
    at_rest = hinge(rest_corners)
    tangent = np.tan(at_rest.theta / 4)
    tangent = 0.0 if abs(tangent) < flat else tangent

    def of(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        now = hinge(p)
        t = np.tan(now.theta / 4)
        return np.array([at_rest.edge * 4 * (t - tangent)]), (at_rest.edge * (1 + t * t) * now.gradient)[None]

    return of


def volume(rest_corners: np.ndarray) -> Constraint:
    """Make the constraint of six times the volume minus that at rest; gradients by the areas of the opposite faces."""

    def sixfold(p: np.ndarray) -> float:
        return float(np.linalg.det(p[1:] - p[0]))

    rest = sixfold(rest_corners)

    def of(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        faces = ((1, 3, 2), (0, 2, 3), (0, 3, 1), (0, 1, 2))  # opposite to each corner, seen from it
        gradients = [-np.cross(p[j] - p[i], p[k] - p[i]) for i, j, k in faces]
        inwards = np.array(gradients) * np.sign(rest) if rest else np.array(gradients)
        return np.array([sixfold(p) - rest]), -inwards[None]

    return of


def items_of(scene: Scene, inextensible: bool = False) -> list[Item]:
    """Return the scene's constraints in the order of their projection."""
    assert scene.mesh is not None
    rest = mesh_of(scene.mesh).position
    items = []
    for constraint_set in constraint_sets(scene):
        part = scene.constraints[constraint_set.kind]
        softness = 0.0 if inextensible or part.inextensible else 1 / part.stiffness
        for corners in constraint_set.corners:
            at_rest = rest[corners]
            if constraint_set.model == "distance":
                length = float(np.linalg.norm(at_rest[1] - at_rest[0]))
                items.append(Item(corners, distance(length), softness, getattr(part, "damping", 0.0)))
                continue
            if constraint_set.model == "volume":
                sixth = abs(float(np.linalg.det(at_rest[1:] - at_rest[0])))
                items.append(Item(corners, volume(at_rest), softness * 6 * sixth))
                continue
            one = hinge(at_rest)
            area = one.edge * sum(one.heights) / 2
            make = isometric if constraint_set.model == "isometric" else dihedral
            items.append(Item(corners, make(at_rest), softness * area / 3))
    return items


def project(
    item: Item, position: np.ndarray, before: np.ndarray, multiplier: np.ndarray, inverse_mass: np.ndarray, h: float,
    pbd_stiffness: float = 1.0,
) -> None:  # fmt: skip
    """Project one item in place (eq. 17 and 18; with a damper eq. 26, C - C_before for its grad C . (x - x_before)).

    `multiplier` (n,) [kg m] of the item's n components.
    """
    w = inverse_mass[item.corners]
    values, gradients = item.of(position[item.corners])
    earlier, _ = item.of(before[item.corners]) if item.damping else (values, None)
    compliance, gamma = item.compliance / h**2, item.compliance * item.damping / h
    change = np.zeros(len(values))
    for n, (value, gradient) in enumerate(zip(values, gradients, strict=True)):
        weight = float(w @ (gradient**2).sum(axis=1))
        if weight > 0:
            change[n] = -value - compliance * multiplier[n] - gamma * (value - earlier[n])
            change[n] /= (1 + gamma) * weight / pbd_stiffness + compliance
    multiplier += change
    position[item.corners] += w[:, None] * np.einsum("n,ncj->cj", change, gradients)


def wind_on(scene: Scene, p: np.ndarray, v: np.ndarray, time: float, triangles: np.ndarray | None = None) -> np.ndarray:
    """Return a flat plate's drag and lift on every triangle, or on those given (n, 3): (vertices, 3) [N].

    A third for each corner, as in cloth.wind_forces.
    """
    wind = scene.wind
    assert wind is not None
    force, air = np.zeros_like(p), cloth.air(scene, time)
    for corners in (scene.grid.triangles() if triangles is None else triangles).astype(int):
        a, b, c = p[corners]
        u, twice = air - v[corners].mean(axis=0), np.cross(b - a, c - a)
        size, speed = float(np.linalg.norm(twice)), float(np.linalg.norm(u))
        if size == 0 or speed == 0:
            continue
        normal = twice / size
        through = float(u @ normal)
        pressure = wind.drag * abs(through) * u + wind.lift * through * (speed * normal - through * u / speed)
        force[corners] += wind.density / 2 * size / 2 * pressure / 3
    return force


def simulate(
    scene: Scene,
    steps: int,
    position: np.ndarray,
    velocity: np.ndarray,
    mass: np.ndarray,
    first_step: int = 0,
    poke: Poke | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position [m], velocity [m/s]), (vertices, 3) float64, after `steps` steps from the given ones.

    `mass` (vertices,) [kg]. With the method's substeps and iterations, Gauss-Seidel; without long-range attachments.
    """
    return alone(motion(scene, steps, position, velocity, mass, first_step, poke))


def motion(
    scene: Scene,
    steps: int,
    position: np.ndarray,
    velocity: np.ndarray,
    mass: np.ndarray,
    first_step: int = 0,
    poke: Poke | None = None,
) -> Motion:
    """Return `simulate` as a generator in which other references can intervene (`Motion`)."""
    assert scene.mesh is not None and not scene.attachments
    method, gravity = scene.method, scene.gravity
    items, h = items_of(scene, method.solver == "pbd"), method.dt / method.substeps
    p, v = np.array(position, dtype=np.float64), np.array(velocity, dtype=np.float64)
    inverse_mass = 1 / np.asarray(mass, dtype=np.float64)
    inverse_mass[pinned_of(scene)] = 0
    free = (inverse_mass > 0)[:, None]
    fine = scene.replace({"method.dt": h, f"{scene.name_of('mesh')}.pinned": "none"})  # fixed masses are reset
    drag = (scene.damping.coefficient if scene.damping else 0.0) * inverse_mass[:, None]
    for number in range(first_step * method.substeps, (first_step + steps) * method.substeps):
        force = wind_on(scene, p, v, number * h) if scene.wind else np.zeros_like(p)
        if scene.external and scene.external.magnitude > 0:
            directions = random_directions(scene.external.seed, number // method.substeps, len(p), axes=3)
            force += scene.external.magnitude * directions.reshape(p.shape)
        if poke is not None and poke[0] is not None:
            force[poke[0]] += poke[1]
        a = force * inverse_mass[:, None]
        if gravity and gravity.enabled:
            a[:, 1] -= gravity.acceleration
        before = p.copy()
        v = np.where(free, v * (1 - h * drag) + h * a, 0.0)
        p = before + h * v
        multipliers = [np.zeros(3 if "isometric" in item.of.__qualname__ else 1) for item in items]
        p = yield before, p
        for _ in range(method.iterations):
            for item, multiplier in zip(items, multipliers, strict=True):
                project(item, p, before, multiplier, inverse_mass, h, method.pbd_stiffness)
            p = yield before, p
        v = (p - before) / h
        shape = (fine.grid.rows, fine.grid.columns, 3)
        old, new, speed = (a.reshape(shape) for a in (before, p, v))
        new, speed = cloth.collide(fine, old, new, speed, number, in_place=True)
        p, v = np.where(free, new.reshape(p.shape), p), np.where(free, speed.reshape(p.shape), 0.0)
    return p, v


def pinned_of(scene: Scene) -> np.ndarray:
    """Return the pinned vertices: (pins,)."""
    from softlab.model.core.build import pinned_indices

    assert scene.mesh is not None
    return pinned_vertices(scene.mesh) if scene.mesh.file is not None else pinned_indices(scene.mesh)
