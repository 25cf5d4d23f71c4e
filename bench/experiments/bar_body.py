"""Bars of bodies with the material of the strip of bench/experiments/bar_strip.py: one of jelly, one of tetrahedra.

A soft body's `cluster_stiffness` w^2 is not a material. Stretched by e, a cluster stores w^2 m x^2 e^2 / 2 for each of
its shares m at x from its centre, so the body resists like a rod of E / rho = w^2 <x^2>, with the mean over all shares:
larger clusters make it stiffer. Here w^2 = c^2 / <x^2>, so that bars of every spacing and overlap have the same
material and only the method differs. Closed forms of a rod, free at both ends or standing: c / (2 L), and g L (L - d) /
(2 c^2) from the first to the last layer of particles, which are d apart.

The bar of tetrahedra has the material that its fields state: E = rho c^2, and Poisson's ratio 0, so that it does not
shrink across, like clusters, and E = 2 G. It hangs, swings and is loaded across like the strip, is WIDTH wide and deep,
and has the closed forms of bench/experiments/bar_strip.py.
"""

from __future__ import annotations

from functools import lru_cache
from math import pi

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.experiments.bar_strip import (
    ACROSS,
    DECAY,
    FRAME,
    FRAMES,
    FREQUENCY,
    GRAVITY,
    LENGTH,
    OPTIONS,
    REST_FRAMES,
    REST_RATE,
    SAG,
    SHARED,
    SPEED,
    SWING,
    WEIGHT,
    WIDTH,
    beam_tip,
    follow,
    returns_measures,
    rod_frequency,
    rod_sag,
    swing_of,
)
from softlab.bench.measure.costs_timing import Measures
from softlab.model.assets.soft_body import DENSITY, SoftBody
from softlab.model.base.table import Table
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.geometry.shapes import Shape
from softlab.model.scene.scene import Scene

LEVER_ARM = "bar_reach"  # m: the root of <x^2>; times w it is the speed of waves
CLUSTERS = "bar_clusters"  # mean number of clusters per particle
ACROSS_RATE, BENDING_FRAMES = 2.0, 1200  # 1/s, and frames until a bending beam is at rest
HANGING_FRAMES = 300  # frames until tetrahedra are at rest: by e^-15
SPACINGS = 2.0  # distance of the clusters' centres, in spacings of particles


def rod_swing() -> float:
    """Frequency [1/s] of the first longitudinal vibration of a rod that is free at both ends."""
    return SPEED / (2 * LENGTH)


def standing_sag(layers: int) -> float:
    """Shortening [m] of a standing rod, between its first and its last layer."""
    return WEIGHT * LENGTH * (LENGTH - LENGTH / layers) / (2 * SPEED**2)


def sampled(layers: int, overlap: float) -> Table:
    """Return the sampling fields of a soft body: a lattice of so many layers, clusters with a radius of `overlap`
    spacings.
    """
    spacing = LENGTH / layers
    return {
        "particle_spacing": spacing, "volume_sampling": 1.0, "surface_sampling": 0.0,
        "cluster_spacing": SPACINGS * spacing, "cluster_radius": overlap * SPACINGS * spacing,
    }  # fmt: skip


@lru_cache(maxsize=64)
def lever_arm(layers: int, overlap: float) -> tuple[float, float]:
    """Return (REACH, CLUSTERS) of the bar along its length, computed from its clusters."""
    body = SoftBody(**sampled(layers, overlap)).bake(Shape(name="beam").mesh())
    clusters = body.clusters
    square = np.sum(clusters.masses * clusters.rest[:, 0] ** 2) / np.sum(clusters.masses)
    return float(np.sqrt(square)), len(clusters.indices) / len(body.mass)


def bar(layers: int, overlap: float, substeps: int, stand: bool = False) -> Scene:
    """Return the bar: lying along x without weight, or standing on a plane with a damper and WEIGHT for gravity."""
    stiffness = (SPEED / lever_arm(layers, overlap)[0]) ** 2
    spacing = LENGTH / layers
    rotation = {"angle": 90.0, "axis": [0.0, 0.0, 1.0], "origin": [0.0, LENGTH / 2, 0.0]} if stand else {}
    away = 0.0 if stand else -1e3  # the same parts (see SHARED), so that both scenes share compiled kernels
    return Scene(
        {
            "title": "Jelly bar",
            "bar": {
                "kind": "soft_body", "shape": {"name": "beam"}, "cluster_stiffness": stiffness,
                **sampled(layers, overlap), **rotation,
            },
            "plane": {"point": [0.0, away, 0.0], "normal": [0.0, 1.0, 0.0], "thickness": spacing / 2},
            "damping": {"coefficient": REST_RATE * DENSITY * spacing**3 if stand else 0.0},
            "gravity": {"acceleration": WEIGHT if stand else 0.0},
            "method": {"solver": "shape-matching", "dt": FRAME, "substeps": substeps, "iterations": 1},
        },
        "jelly-bar",
    )  # fmt: skip


@returns_measures(SAG)
def stand(scene: Scene, backend: str) -> Measures:
    """Measure SAG: the shortening of the bar at rest, between the means of its first and its last layer."""
    height = scene.body_set.position[:, 1]
    with open_simulation(scene, backend, **OPTIONS) as simulation:
        simulation.advance(REST_FRAMES)
        now = simulation.state().position[:, 1]
    top, bottom = (np.isclose(height, end) for end in (height.max(), height.min()))
    length = now[top].mean() - now[bottom].mean()
    return {SAG: (float(np.ptp(height) - length), "m", "standing")}


@returns_measures(FREQUENCY, DECAY, LEVER_ARM, CLUSTERS)
def sway(scene: Scene, backend: str, layers: int, overlap: float) -> Measures:
    """Measure FREQUENCY and DECAY of the first longitudinal mode, released at rest in the shape of a free rod's mode.

    REACH and CLUSTERS are reported too.
    """
    at = scene.body_set.position
    shape = np.zeros_like(at)
    shape[:, 0] = np.sin(pi * at[:, 0] / LENGTH)
    begin = State(at + SWING * shape, np.zeros_like(at), 1 / scene.body_set.clusters.mass, 0.0, 0)
    with open_simulation(scene, backend, initial=begin, live=SHARED, **OPTIONS) as simulation:
        frequency, decay = swing_of(follow(simulation, shape, FRAMES // 2), FRAME)
    arm, clusters = lever_arm(layers, overlap)
    return {
        FREQUENCY: (frequency, "1/s", f"rod: {rod_swing():.6g}"), DECAY: (decay, "1/s", None),
        LEVER_ARM: (arm, "m", None), CLUSTERS: (clusters, "", "of a particle"),
    }  # fmt: skip


# ---------------------------------------------------------------------- tetrahedra


def tetrahedra(layers: int, solver: str, iterations: int, substeps: int, load: str) -> Scene:
    """Return the bar of tetrahedra with that many voxels along it.

    It hangs with a damper (SAG), has neither weight nor damper (FREQUENCY), or is fixed at its left side (ACROSS).
    """
    beside = load == ACROSS
    rates, weights = {SAG: REST_RATE, ACROSS: ACROSS_RATE}, {SAG: GRAVITY, ACROSS: WEIGHT}
    sides = [LENGTH, WIDTH, WIDTH] if beside else [WIDTH, LENGTH, WIDTH]
    edge = LENGTH / layers
    scene = Scene(
        {
            "title": "Bar of tetrahedra",
            "bar": {
                "kind": "tetrahedral_body", "shape": {"name": "box", "sides": sides}, "edge": edge, "density": DENSITY,
                "young_modulus": DENSITY * SPEED**2, "poisson_ratio": 0.0, "pinned": ["left" if beside else "top"],
            },
            "damping": {"coefficient": 0.0},
            "gravity": {"acceleration": weights.get(load, 0.0)},
            "method": {"solver": solver, "dt": FRAME, "substeps": substeps, "iterations": iterations},
        },
        "tetrahedral-bar",
    )  # fmt: skip
    return scene.replace({"damping.coefficient": rates.get(load, 0.0) * scene.grid.mass})


def measured_tetrahedra(scene: Scene, backend: str, load: str) -> Measures:
    """Return the measures of a load: SAG, ACROSS, or FREQUENCY with DECAY."""
    return {SAG: hang_tetrahedra, ACROSS: bend_tetrahedra, FREQUENCY: swing_tetrahedra}[load](scene, backend)


def _end(scene: Scene, backend: str, frames: int, axis: int) -> float:
    """Return the downward displacement [m] of the free end, the particles furthest from the pins along `axis`."""
    rest = scene.tetrahedra_set.position
    away = np.abs(rest[:, axis] - rest[scene.tetrahedra_set.pinned_vertices[0], axis])
    with open_simulation(scene, backend, **OPTIONS) as simulation:
        simulation.advance(frames)
        moved = simulation.state().position - rest
    return float(-moved[np.isclose(away, away.max()), 1].mean())


@returns_measures(SAG)
def hang_tetrahedra(scene: Scene, backend: str) -> Measures:
    """Measure SAG: the downward displacement of the lower end at rest."""
    return {SAG: (_end(scene, backend, HANGING_FRAMES, 1), "m", f"rod: {rod_sag():.6g}")}


@returns_measures(ACROSS)
def bend_tetrahedra(scene: Scene, backend: str) -> Measures:
    """Measure ACROSS: the downward displacement of the end of a bar that is fixed at its left side."""
    return {ACROSS: (_end(scene, backend, BENDING_FRAMES, 0), "m", f"beam: {beam_tip():.6g}")}


@returns_measures(FREQUENCY, DECAY)
def swing_tetrahedra(scene: Scene, backend: str) -> Measures:
    """Measure FREQUENCY and DECAY of the first longitudinal mode, released at rest in the shape of a rod's mode."""
    rest = scene.tetrahedra_set.position
    shape = np.zeros_like(rest)
    shape[:, 1] = -np.sin(pi / 2 * (rest[:, 1].max() - rest[:, 1]) / LENGTH)
    begin = State(rest + SWING * shape, np.zeros_like(rest), build(scene).inverse_mass, 0.0, 0)
    with open_simulation(scene, backend, initial=begin, live=SHARED, **OPTIONS) as simulation:
        frequency, decay = swing_of(follow(simulation, shape, FRAMES), FRAME)
    return {FREQUENCY: (frequency, "1/s", f"rod: {rod_frequency():.6g}"), DECAY: (decay, "1/s", None)}
