"""Fluids that meet solids which nothing holds together: particles and a face that lie in their way, and who drives them."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.bench.reference.coupled.fluid_solids import FluidAmongSolids
from softlab.model.core.simulation import Options
from softlab.model.core.state import State
from softlab.model.fluid.samples import Samples, joined_samples, particle_samples, sample_volumes, triangle_samples
from softlab.model.scene.scene import Scene

D = 0.05  # m
METHOD = {"solver": "pbf", "dt": 1 / 60, "substeps": 2, "iterations": 3}


def fluid_scene(**changes: Any) -> Scene:
    """A block of water that rests on what comes first, with all that acts between two particles."""
    water = {
        "kind": "fluid", "origin": [0.0, D, 0.0], "size": [3 * D, 3 * D, 3 * D], "rest_distance": D, "viscosity": 8.0,
        "cohesion": 2.0, "vorticity_confinement": 0.01, "velocity": [0.3, -0.8, 0.1],
    }  # fmt: skip
    tables = {"water": water, "method": METHOD | {"tensile_correction": 0.001}}
    return Scene(tables | changes)


def samples_of(scene: Scene, held: bool = True) -> tuple[Samples, np.ndarray, np.ndarray]:
    """(samples, positions, velocities of the solids' particles (n, 3)): a layer of free particles below the water, one of
    which nothing moves if it is `held`, and a large triangle beside it, of which one corner is heavy."""
    found = scene.fluid_set
    layer = np.array([[i, 0, k] for k in range(3) for i in range(3)], float) * D + [D / 2, D / 4, D / 2]
    corners = np.array([[-0.01, 0.0, -0.02], [-0.02, 0.24, 0.06], [0.0, 0.0, 0.19]])
    position = np.concatenate([layer, corners])
    free, face = particle_samples(np.arange(9)), triangle_samples(position, np.array([[9, 10, 11]]), 0.75 * D)
    volumes = [
        sample_volumes((shares[:, :, None] * position[corners]).sum(axis=1), found.lattice, found.support, False)
        for corners, shares in (free, face)
    ]
    lightness = np.array([*[0.7] * 4, 0.0 if held else 0.7, *[2.0] * 4, 0.5, 0.1, 0.8])
    velocity = np.zeros_like(position)
    velocity[:, 0], velocity[4] = 0.2, 0.0
    return joined_samples([free, face], volumes, lightness), position, velocity


def stirred(scene: Scene, seed: int = 3) -> State:
    """The fluid, off its lattice."""
    found, random = scene.fluid_set, np.random.default_rng(seed)
    position = found.position + random.normal(0, 0.1 * D, found.position.shape)
    velocity = found.velocity + random.normal(0, 0.2, found.position.shape)
    return State(position, velocity, 1 / found.masses, 0.0, 0)


def judged(scene: Scene, steps: int) -> tuple[np.ndarray, ...]:
    """(positions, velocities of the fluid, those of the solids) after so many steps by the judge."""
    samples, solid, moving = samples_of(scene)
    start, judge = stirred(scene), FluidAmongSolids(scene, samples)
    x, v, h = start.position, start.velocity, judge.world.h
    for number in range(steps * scene.method.substeps):
        before, solid = solid, solid + h * moving
        judge.begin(number, x, v, before, solid)
        for _ in range(scene.method.iterations):
            solid = judge.correct(solid)
        x, v = judge.end()
        moving = (solid - before) / h
    return x, v, solid, moving


class HostPlaces:
    """Where solids are that nobody but the test moves, on CPU threads."""

    def __init__(self, position: np.ndarray):
        self.before, self.position = position.copy(), position.copy()

    def drift(self, way: np.ndarray) -> None:
        self.before[:] = self.position
        self.position += way

    def told(self) -> tuple[np.ndarray, np.ndarray]:
        return self.before, self.position

    def take(self, fresh: bool) -> None:
        """They are here already."""

    def give(self) -> None:
        """They stay here."""


class DevicePlaces(HostPlaces):
    """The same on CUDA, in quads."""

    taking = giving = 0  # launches

    def __init__(self, position: np.ndarray):
        from numba import cuda

        quads = np.zeros((len(position), 4), position.dtype)
        quads[:, :3], quads[:, 3] = position, 7.0  # which nobody looks at
        self.before, self.position = (cuda.to_device(quads.reshape(-1)) for _ in range(2))

    def drift(self, way: np.ndarray) -> None:
        quads = self.position.copy_to_host().reshape(-1, 4)
        self.before.copy_to_device(quads.reshape(-1))
        quads[:, :3] += way
        self.position.copy_to_device(quads.reshape(-1))

    def told(self) -> tuple[np.ndarray, np.ndarray]:
        before, now = (array.copy_to_host().reshape(-1, 4)[:, :3] for array in (self.before, self.position))
        return before, now


def driven(
    scene: Scene, steps: int, precision: str = "float64", threads: int = 1, held: bool = True, backend: str = "cpu"
) -> tuple[np.ndarray, ...]:
    """The same by a backend, stage by stage."""
    samples, solid, moving = samples_of(scene, held)
    real = np.dtype(precision).type
    options = Options(precision=precision, math="exact", kernel="stages")
    fluid: Any
    if backend == "cpu":
        from softlab.cpu_backend.fluid.among_solids import FluidAmongSolids as OnThreads

        places = HostPlaces(solid.astype(real))
        fluid = OnThreads(scene, options, threads, samples, places)
    else:
        from softlab.gpu_backend.fluid.among_solids import FluidAmongSolids as OnCuda

        places = DevicePlaces(solid.astype(real))
        fluid = OnCuda(scene, options, samples, places)
    with fluid:
        fluid.load(stirred(scene))
        moving, h = moving.astype(real), fluid._record[0]["dt"]
        for step in range(steps):
            for stage, moment in fluid.plan.moments(step):
                if stage.name == "predict":
                    places.drift(h * moving)
                fluid._executor.stages[stage.name](moment)
                if stage.name == "limit velocities":
                    before, now = places.told()
                    moving = (now - before) / h
        fluid.synchronize()
        found = fluid._download()
    return *found, places.told()[1].copy(), moving
