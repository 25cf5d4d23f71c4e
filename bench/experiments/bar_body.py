"""Bars of bodies: one of jelly, the soft body whose material is that of the strip of bench/experiments/bar_strip.py, and what
it makes of it.

A soft body's `cluster_stiffness` w^2 is no material. Drawn out by e, a cluster stores w^2 m x^2 e^2 / 2 for each of its
shares m at x from its centre, so that the body resists as a rod of E / rho = w^2 <x^2>, with the mean over all shares: the
larger its clusters, the stiffer. Here w^2 = c^2 / <x^2>, so that bars of every spacing and overlap are one material; what
they still differ in is the method. The closed forms are a rod's, free at both ends or standing: c / (2 L), and
g L (L - d) / (2 c^2) from the first to the last layer of particles, d apart.

And one of tetrahedra, for which the material is what it is told: E = rho c^2, and a Poisson's ratio of 0, so that it does not
shrink across, as clusters do not, and E = 2 G. It hangs, swings and is loaded across as the strip does and is, WIDTH wide and
deep, with the closed forms of bench/experiments/bar_strip.py.
"""

from __future__ import annotations

from functools import lru_cache
from math import pi
from typing import Any

import numpy as np

from app.driver import open_simulation
from bench.experiments.bar_strip import (
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
    rod_frequency,
    rod_sag,
    swing_of,
    told,
)
from bench.measure.costs_timing import Measures
from model.assets.soft_body import DENSITY, SoftBody
from model.core.build import build
from model.core.simulation import State
from model.geometry.shapes import Shape
from model.scene.scene import Scene

REACH = "bar_reach"  # m: the root of <x^2>, which times w is the speed of waves
CLUSTERS = "bar_clusters"  # of a particle, in the mean
ACROSS_RATE, BENDING_FRAMES = 2.0, 1200  # 1/s, and to rest under it: a beam that bends is no pendulum
HANGING_FRAMES = 300  # of tetrahedra, to rest: by e^-15
SPACINGS = 2.0  # of the clusters' centres, in spacings of particles


def rod_swing() -> float:
    """[1/s]: of the first longitudinal swing of a rod that is free at both ends."""
    return SPEED / (2 * LENGTH)


def standing_sag(layers: int) -> float:
    """[m]: by how much a standing rod is shortened, between its first and its last layer."""
    return WEIGHT * LENGTH * (LENGTH - LENGTH / layers) / (2 * SPEED**2)


def sampled(layers: int, overlap: float) -> dict[str, Any]:
    """What a soft body of so many layers of particles is told: a lattice, and clusters of a radius of `overlap` spacings."""
    spacing = LENGTH / layers
    return {
        "particle_spacing": spacing, "volume_sampling": 1.0, "surface_sampling": 0.0,
        "cluster_spacing": SPACINGS * spacing, "cluster_radius": overlap * SPACINGS * spacing,
    }  # fmt: skip


@lru_cache(maxsize=64)
def reach(layers: int, overlap: float) -> tuple[float, float]:
    """(REACH, CLUSTERS) of the bar along its length, from its clusters alone."""
    body = SoftBody(**sampled(layers, overlap)).bake(Shape(name="beam").mesh())
    clusters = body.clusters
    square = np.sum(clusters.masses * clusters.rest[:, 0] ** 2) / np.sum(clusters.masses)
    return float(np.sqrt(square)), len(clusters.indices) / len(body.mass)


def bar(layers: int, overlap: float, substeps: int, stand: bool = False) -> Scene:
    """The bar, lying along x without weight, or standing on a plane with a damper and WEIGHT for gravity."""
    stiffness = (SPEED / reach(layers, overlap)[0]) ** 2
    spacing = LENGTH / layers
    turned = {"angle": 90.0, "axis": [0.0, 0.0, 1.0], "origin": [0.0, LENGTH / 2, 0.0]} if stand else {}
    away = 0.0 if stand else -1e3  # the same parts (see SHARED), so that nothing is compiled twice
    return Scene(
        {
            "title": "Jelly bar",
            "bar": {
                "kind": "soft_body", "shape": {"name": "beam"}, "cluster_stiffness": stiffness,
                **sampled(layers, overlap), **turned,
            },
            "plane": {"point": [0.0, away, 0.0], "normal": [0.0, 1.0, 0.0], "thickness": spacing / 2},
            "damping": {"coefficient": REST_RATE * DENSITY * spacing**3 if stand else 0.0},
            "gravity": {"acceleration": WEIGHT if stand else 0.0},
            "method": {"solver": "shape-matching", "dt": FRAME, "substeps": substeps, "iterations": 1},
        },
        "jelly-bar",
    )  # fmt: skip


@told(SAG)
def stand(scene: Scene, backend: str) -> Measures:
    """SAG: by how much the bar at rest is shorter than made, between the means of its first and its last layer."""
    height = scene.body_set.position[:, 1]
    with open_simulation(scene, backend, **OPTIONS) as simulation:
        simulation.advance(REST_FRAMES)
        now = simulation.state().position[:, 1]
    top, bottom = (np.isclose(height, end) for end in (height.max(), height.min()))
    length = now[top].mean() - now[bottom].mean()
    return {SAG: (float(np.ptp(height) - length), "m", "standing")}


@told(FREQUENCY, DECAY, REACH, CLUSTERS)
def sway(scene: Scene, backend: str, layers: int, overlap: float) -> Measures:
    """FREQUENCY and DECAY of the first longitudinal mode, let go at rest, drawn out as a free rod's; REACH and CLUSTERS."""
    at = scene.body_set.position
    shape = np.zeros_like(at)
    shape[:, 0] = np.sin(pi * at[:, 0] / LENGTH)
    begin = State(at + SWING * shape, np.zeros_like(at), 1 / scene.body_set.clusters.mass, 0.0, 0)
    with open_simulation(scene, backend, initial=begin, live=SHARED, **OPTIONS) as simulation:
        frequency, decay = swing_of(follow(simulation, shape, FRAMES // 2), FRAME)
    arm, held = reach(layers, overlap)
    return {
        FREQUENCY: (frequency, "1/s", f"rod: {rod_swing():.6g}"), DECAY: (decay, "1/s", None),
        REACH: (arm, "m", None), CLUSTERS: (held, "", "of a particle"),
    }  # fmt: skip


# ---------------------------------------------------------------------- tetrahedra


def tetrahedra(layers: int, solver: str, iterations: int, substeps: int, load: str) -> Scene:
    """The bar of tetrahedra with so many voxels along it: hanging with a damper (SAG), without weight or damper (FREQUENCY),
    or held at its left side (ACROSS)."""
    beside = load == ACROSS
    rates, weights = {SAG: REST_RATE, ACROSS: ACROSS_RATE}, {SAG: GRAVITY, ACROSS: WEIGHT}
    sides = [LENGTH, WIDTH, WIDTH] if beside else [WIDTH, LENGTH, WIDTH]
    edge = LENGTH / layers
    made = Scene(
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
    return made.replace({"damping.coefficient": rates.get(load, 0.0) * made.grid.mass})


def measured_tetrahedra(scene: Scene, backend: str, load: str) -> Measures:
    """What the bar comes to: SAG, ACROSS, or FREQUENCY with DECAY."""
    return {SAG: hang_tetrahedra, ACROSS: bend_tetrahedra, FREQUENCY: swing_tetrahedra}[load](scene, backend)


def _end(scene: Scene, backend: str, frames: int, axis: int) -> float:
    """[m]: how far down the end that is not held has come, which lies furthest from the pins along an `axis`."""
    rest = scene.tetrahedra_set.position
    away = np.abs(rest[:, axis] - rest[scene.tetrahedra_set.pinned_vertices[0], axis])
    with open_simulation(scene, backend, **OPTIONS) as simulation:
        simulation.advance(frames)
        moved = simulation.state().position - rest
    return float(-moved[np.isclose(away, away.max()), 1].mean())


@told(SAG)
def hang_tetrahedra(scene: Scene, backend: str) -> Measures:
    """SAG: how far its lower end comes to hang under where it was made."""
    return {SAG: (_end(scene, backend, HANGING_FRAMES, 1), "m", f"rod: {rod_sag():.6g}")}


@told(ACROSS)
def bend_tetrahedra(scene: Scene, backend: str) -> Measures:
    """ACROSS: how far the end comes to hang under its place, of a bar that is held at its left side."""
    return {ACROSS: (_end(scene, backend, BENDING_FRAMES, 0), "m", f"beam: {beam_tip():.6g}")}


@told(FREQUENCY, DECAY)
def swing_tetrahedra(scene: Scene, backend: str) -> Measures:
    """FREQUENCY and DECAY of the first longitudinal mode, let go at rest, drawn out as a rod's."""
    rest = scene.tetrahedra_set.position
    shape = np.zeros_like(rest)
    shape[:, 1] = -np.sin(pi / 2 * (rest[:, 1].max() - rest[:, 1]) / LENGTH)
    begin = State(rest + SWING * shape, np.zeros_like(rest), build(scene).inverse_mass, 0.0, 0)
    with open_simulation(scene, backend, initial=begin, live=SHARED, **OPTIONS) as simulation:
        frequency, decay = swing_of(follow(simulation, shape, FRAMES), FRAME)
    return {FREQUENCY: (frequency, "1/s", f"rod: {rod_frequency():.6g}"), DECAY: (decay, "1/s", None)}
