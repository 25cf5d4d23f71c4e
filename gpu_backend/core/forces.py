"""Forces that look at one particle alone, for all solvers of quads: gravity, the external force, a poke.

What acts on a particle by itself is added here, once; kernels call `add_own` and do not know which forces there are.
Accelerations are [m/s^2]; a force is divided by the sheet's mass, and counted by a particle's `weight`, that mass over its
own, where the scene has a `load`.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.compile import inlined, kernel_options, make_kernel, variant_name
from gpu_backend.core.formulas import device_formulas
from gpu_backend.core.integers import EXTERNAL_SEED, POKED
from gpu_backend.core.quads import SIZE, load_quad, store_quad
from model.core.plan import StageRun
from model.formulas import distance, random

OWN = frozenset({"gravity", "external", "poke", "load"})  # the parts that these functions ask for


@cache
def make_forces(real: Any, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Device functions, each (ax, ay, az, ...) -> (ax, ay, az): `add_force(..., fx, fy, fz, weight)`; `add_gravity(...,
    parameters)`; `add_external(..., k, weight, parameters, integers, step)`, `add_poke` of the same arguments; `add_own`,
    both of these, in this order."""
    added = device_formulas(distance.make, real, math).added
    external = device_formulas(random.make, real, math).add_external
    inline = inlined(math)
    philox = random.make_philox(inline)
    has_gravity, has_external = "gravity" in parts, "external" in parts
    has_poke, has_load, zero = "poke" in parts, "load" in parts, real(0)

    @inline
    def add_force(ax, ay, az, fx, fy, fz, weight):
        if has_load:
            return added(ax, weight, fx), added(ay, weight, fy), added(az, weight, fz)
        return ax + fx, ay + fy, az + fz

    @inline
    def add_gravity(ax, ay, az, parameters):
        if has_gravity:
            ay = ay + parameters.gravity
        return ax, ay, az

    @inline
    def add_external(ax, ay, az, k, weight, parameters, integers, step):
        if has_external:
            word_x, word_y, word_z, _ = philox(integers[EXTERNAL_SEED], np.uint64(step), np.uint64(k))
            magnitude = parameters.external
            fx, fy = external(zero, magnitude, word_x), external(zero, magnitude, word_y)
            fz = external(zero, magnitude, word_z)
            ax, ay, az = add_force(ax, ay, az, fx, fy, fz, weight)
        return ax, ay, az

    @inline
    def add_poke(ax, ay, az, k, weight, parameters, integers, step):
        if has_poke:
            if np.int64(integers[POKED]) == k + 1:  # as they are, the two kinds of integer would meet as doubles
                fx, fy, fz = parameters.poke_x, parameters.poke_y, parameters.poke_z
                ax, ay, az = add_force(ax, ay, az, fx, fy, fz, weight)
        return ax, ay, az

    @inline
    def add_own(ax, ay, az, k, weight, parameters, integers, step):
        ax, ay, az = add_external(ax, ay, az, k, weight, parameters, integers, step)
        return add_poke(ax, ay, az, k, weight, parameters, integers, step)

    return SimpleNamespace(
        add_force=add_force, add_gravity=add_gravity, add_external=add_external, add_poke=add_poke, add_own=add_own
    )


@cache
def make_force_stages(real: Any, math: str, parts: frozenset[str]) -> dict[str, Any]:
    """The stages of these forces, by name: kernels (position, parameters, integers, step, a), which add to the accelerations
    `a` (quads); the weights lie in `position`."""
    forces, zero = make_forces(real, math, parts), real(0)
    add_gravity = forces.add_gravity

    def gravity(position, record, integers, step, a):
        parameters = record[0]
        k = np.int32(cuda.grid(1))  # type: ignore[call-arg]
        if k < a.size // SIZE:
            b = load_quad(a, k)
            ax, ay, az = add_gravity(b[0], b[1], b[2], parameters)
            store_quad(a, k, ax, ay, az, zero)

    def stage_of(add: Any) -> Any:
        def force(position, record, integers, step, a):
            parameters = record[0]
            k = np.int32(cuda.grid(1))  # type: ignore[call-arg]
            if k < a.size // SIZE:
                b, p = load_quad(a, k), load_quad(position, k)
                ax, ay, az = add(b[0], b[1], b[2], k, p[3], parameters, integers, step)
                store_quad(a, k, ax, ay, az, zero)

        return force

    stages = {"gravity": gravity, "external force": stage_of(forces.add_external), "poke": stage_of(forces.add_poke)}
    variant = variant_name(real, math, parts & OWN)
    return {name: make_kernel(stage, f"forces_{variant}", **kernel_options(math)) for name, stage in stages.items()}


def bind_forces(sim: Any, parts: frozenset[str], position: Any, a: Any) -> dict[str, StageRun]:
    """What runs those stages for `sim`, whose stages find particles at `position` and add accelerations up in `a`."""

    def bound(kernel: Any) -> StageRun:
        return lambda moment: kernel[sim._flat](position, sim.record, sim.integers, np.int64(moment.step), a)

    made = make_force_stages(sim.real, sim.options.math, parts)
    return {name: bound(kernel) for name, kernel in made.items()}
