"""Measures of a fluid's state: density errors, pressures, height; in float64 on the host, for accuracy checks and
display."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from softlab.model.particles.fluid_lattice import closeness_cubed, spiky_slope
from softlab.model.scene.scene import Scene

TOP = 0.01  # of a fluid's particles: the highest ones, which define its height


def differences(scene: Scene, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (pairs (n, 2), x_i - x_j (n, dimensions) [m]) of all particles within the support, wrapped in a periodic
    box."""
    there = np.flatnonzero(scene.fluid_set.there(np.asarray(position)))  # inactive particles are all in one place
    place, support = np.array(position, np.float64)[there], scene.fluid_set.support
    if not len(place):
        return np.zeros((0, 2), np.int64), np.zeros((0, place.shape[1]))
    domain, axes = scene.domain, place.shape[1]
    repeats = [domain is not None and axis in domain.repeats for axis in "xyz"[:axes]]
    sides = np.zeros(axes)
    for axis, is_wrapped in enumerate(repeats):
        if is_wrapped and domain is not None:
            sides[axis] = domain.size[axis]
            place[:, axis] = (place[:, axis] - domain.origin[axis]) % sides[axis]
        else:
            place[:, axis] -= place[:, axis].min()
    box = np.where(sides > 0, sides, np.ptp(place, axis=0) + 4 * support)
    pairs = cKDTree(np.minimum(place, np.nextafter(box, 0)), boxsize=box).query_pairs(support, output_type="ndarray")
    apart = place[pairs[:, 0]] - place[pairs[:, 1]]
    return there[pairs], apart - sides * np.round(apart / np.where(sides > 0, sides, 1))


def density_errors(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Return density over rest density - 1, (particles,), by the constraint's kernel (model/formulas/fluid/density.py).

    Walls are not included: at surfaces and walls the missing neighbours lower it.
    """
    fluids, lattice = scene.fluid_set, scene.fluid_set.lattice
    (first, second), apart = (array := differences(scene, position))[0].T, array[1]
    kernel, count = closeness_cubed(np.sqrt((apart**2).sum(axis=1)), fluids.support), len(position)
    total = np.bincount(first, kernel, count) + np.bincount(second, kernel, count)
    return np.asarray(lattice.density_scale * (total - lattice.kernel_sum))


def compression(scene: Scene, position: np.ndarray) -> tuple[float, float]:
    """Return (mean, largest) excess of density over the rest density, relative to it."""
    over = np.maximum(density_errors(scene, position), 0.0)[scene.fluid_set.there(np.asarray(position))]
    return (float(over.mean()), float(over.max())) if len(over) else (0.0, 0.0)


def pressures(scene: Scene, position: np.ndarray, multiplier: np.ndarray) -> np.ndarray:
    """Return the mean pressure of each particle's pairs, (particles,) [Pa], from its last substep's multipliers [m^2].

    A particle without neighbours has its own.
    """
    fluids = scene.fluid_set
    (first, second), apart = (array := differences(scene, position))[0].T, array[1]
    r = np.sqrt((apart**2).sum(axis=1))
    weight, count = spiky_slope(r, fluids.support, scene.dimensions) * r, len(position)
    carried = weight * (multiplier[first] + multiplier[second]) / 2
    total, over = (np.bincount(first, each, count) + np.bincount(second, each, count) for each in (carried, weight))
    mean = np.where(over > 0, total / np.where(over > 0, over, 1), multiplier)
    return np.asarray(-mean * fluids.parts[0].density * (scene.method.substeps / scene.method.dt) ** 2)


def height(scene: Scene, position: np.ndarray) -> float:
    """Return the height [m] of the highest hundredth of the particles, on average, above the scene's lowest initial
    particle plus half its rest distance."""
    fluids = scene.fluid_set
    now, start = (
        np.asarray(each, np.float64)[fluids.there(np.asarray(each)), 1] for each in (position, fluids.position)
    )
    highest = np.sort(now)[-max(1, round(TOP * len(now))) :]
    lowest = start if len(start) else now
    return float(highest.mean() + fluids.spacing - lowest.min()) if len(now) else 0.0
