"""A bar of jelly: the soft body whose material is that of the strip of bench/experiments/bar_strip.py, and what it makes of
it.

A soft body's `cluster_stiffness` w^2 is no material. Drawn out by e, a cluster stores w^2 m x^2 e^2 / 2 for each of its
shares m at x from its centre, so that the body resists as a rod of E / rho = w^2 <x^2>, with the mean over all shares: the
larger its clusters, the stiffer. Here w^2 = c^2 / <x^2>, so that bars of every spacing and overlap are one material; what
they still differ in is the method. The closed forms are a rod's, free at both ends or standing: c / (2 L), and
g L (L - d) / (2 c^2) from the first to the last layer of particles, d apart.
"""

from __future__ import annotations

from functools import lru_cache
from math import pi
from typing import Any

import numpy as np

from app.driver import open_simulation
from bench.experiments.bar_strip import (
    DECAY,
    FRAME,
    FRAMES,
    FREQUENCY,
    LENGTH,
    OPTIONS,
    REST_FRAMES,
    REST_RATE,
    SAG,
    SHARED,
    SPEED,
    SWING,
    WEIGHT,
    follow,
    swing_of,
    told,
)
from bench.measure.experiment import Measures
from model.assets.soft_body import DENSITY, SoftBody
from model.core.simulation import State
from model.geometry.shapes import Shape
from model.scene.scene import Scene

REACH = "bar_reach"  # m: the root of <x^2>, which times w is the speed of waves
CLUSTERS = "bar_clusters"  # of a particle, in the mean
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
