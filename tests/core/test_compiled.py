"""Compiled kernels against their own source run as plain Python: the same bits in `exact` math, for 1, 2 and 3 threads.

Each solver and kernel once, with all parts live; precisions take turns. All other tests hold the plain kernels against
closed forms, the NumPy reference and each other; what typing, vectorisation and threads may add to that shows here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest
from bodies_scenes import blocks, hung, of_all_materials
from cloth_scenes import POKE, cloth_scene
from contact_scenes import folded
from field_scenes import falling_bar
from fluid_scenes import flat, free, two_fluids
from kinematic_scenes import CUBE, ENDS, HOOK, kinematic_scene
from meeting_bodies import meeting
from mesh_scenes import mesh_scene
from rebound_scenes import among_soft_ones
from surface_scenes import three
from vbd_scenes import BODY, vbd_scene
from xpbd_scenes import xpbd_scene

from softlab.app.driver import open_simulation
from softlab.cpu_backend.core.plain import plain_python
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene

STEPS = (1, 2, 3)  # batches
THREADS = sorted({1, min(2, numba.config.NUMBA_NUM_THREADS), min(3, numba.config.NUMBA_NUM_THREADS)})


def hammock(integrator: str, **changes: Any) -> Scene:
    fields = {"grid.rows": 11, "grid.columns": 13, "external.magnitude": 0.05, "external.seed": 2**40 + 7}
    return load_scene("lab-hammock").replace(fields | {"method.integrator": integrator} | changes)


def jelly() -> Scene:
    fields = {"grid.rows": 11, "grid.columns": 9, "perturbation.amplitude": 0.1, "external.magnitude": 0.02}
    return load_scene("jelly-grid").replace(fields | {"method.substeps": 2, "method.iterations": 2})


def bars() -> Scene:
    sides = {"name": "box", "sides": [0.3, 0.1, 0.1]}
    fields = {
        f"{name}.{field}": value for name in ("stiff", "soft") for field, value in (("shape", sides), ("edge", 0.1))
    }
    return load_scene("fem-newton").replace(fields | {"stiff.origin": [0.0, 0.0, 0.4]})


LIVE = ("gravity", "poke", "dt", "stiffness", "damping")


def held() -> Scene:
    """Moving pins, soft attachments to the world and to another body, a rate of damping: position-based."""
    clamp = {"kind": "attachment", "body": "cube", "vertices": "left", "compliance": 1e-4}
    return kinematic_scene("xpbd", cube=CUBE | {"mass_damping": 2.0}, hook=HOOK, clamp=clamp, **ENDS)


CASES: dict[str, tuple[Callable[[], Scene], str, str]] = {
    "grid": (lambda: hammock("lab"), "fused", "float32"),
    "grid in teams": (lambda: hammock("velocity-verlet"), "team", "float32"),
    "grid in tiles": (lambda: hammock("semi-implicit-euler"), "tiled", "float64"),
    "grid in stages": (lambda: hammock("velocity-verlet"), "stages", "float32"),
    "grid, rk4": (lambda: hammock("rk4"), "fused", "float64"),
    "grid, rk4 in stages": (lambda: hammock("rk4"), "stages", "float64"),
    "grid of two springs": (lambda: hammock("velocity-verlet", **{"springs.stiffness_ratio": 1e2}), "fused", "float64"),
    "cloth": (lambda: cloth_scene("everything moving", "velocity-verlet"), "fused", "float32"),
    "cloth, rk4": (lambda: cloth_scene("everything moving", "rk4"), "fused", "float64"),
    "cloth in stages": (lambda: cloth_scene("everything moving", "semi-implicit-euler"), "stages", "float64"),
    "cloth, implicit": (lambda: cloth_scene("everything moving", "implicit-euler"), "fused", "float64"),
    "cloth, implicit and linearised": (
        lambda: cloth_scene("damped moving", "implicit-euler-linear"),
        "fused",
        "float32",
    ),
    "xpbd": (lambda: xpbd_scene("everything"), "fused", "float32"),
    "xpbd in stages": (lambda: xpbd_scene("everything"), "stages", "float64"),
    "xpbd, jacobi": (lambda: xpbd_scene("loaded", "jacobi"), "fused", "float64"),
    "xpbd, averaged jacobi": (lambda: xpbd_scene("grid", "averaged-jacobi"), "fused", "float32"),
    "mesh": (lambda: mesh_scene("everything"), "fused", "float32"),
    "mesh in stages": (lambda: mesh_scene("dihedral"), "stages", "float64"),
    "vertex blocks": (lambda: vbd_scene(BODY | {"damping": 0.02}, substeps=2), "fused", "float32"),
    "vertex blocks in stages": (lambda: vbd_scene(BODY | {"damping": 0.02}), "stages", "float64"),
    "tetrahedra that meet": (three, "fused", "float32"),
    "tetrahedra that meet in stages": (three, "stages", "float64"),
    "bodies that are held and moved": (held, "fused", "float32"),
    "cloth that meets itself": (folded, "stages", "float32"),
    "jelly grid": (jelly, "fused", "float32"),
    "jelly grid in stages": (jelly, "stages", "float64"),
    "lattices": (blocks, "fused", "float32"),
    "lattices in stages": (blocks, "stages", "float64"),
    "bodies that give way": (of_all_materials, "fused", "float64"),
    "sheets of bodies": (hung, "stages", "float32"),
    "bodies that meet": (meeting, "fused", "float32"),
    "bodies that meet in stages": (among_soft_ones, "stages", "float64"),
    "implicit tetrahedra": (bars, "fused", "float32"),
    "body on a field": (falling_bar, "fused", "float64"),
    "fluids": (two_fluids, "fused", "float32"),
    "fluid in a plane, in stages": (flat, "stages", "float64"),
    "fluids, by velocities": (lambda: free(two_fluids()), "fused", "float32"),
    "fluid in a plane, by velocities, in stages": (lambda: free(flat()), "stages", "float64"),
}


def end_state(
    scene: Scene, kernel: str, precision: str, threads: int, plain: bool = False, math: str = "exact"
) -> State:
    plain_python(plain)
    try:
        with open_simulation(
            scene,
            kernel=kernel,
            precision=precision,
            math=math,
            threads=threads,
            live=live_of(scene),
            allow_unstable=True,
        ) as simulation:
            simulation.poke(POKE[0], POKE[1][: scene.dimensions])
            for steps in STEPS:
                simulation.advance(steps)
            assert simulation.kernel == kernel
            return simulation.state()
    finally:
        plain_python(False)


def live_of(scene: Scene) -> tuple[str, ...]:
    return (
        LIVE
        if not scene.bodies and not scene.tetrahedra and not scene.method.matches_shapes
        else ("gravity", "poke", "dt", "damping")
    )


@pytest.mark.parametrize("name", CASES)
def test_machine_code_gives_the_bits_of_its_source(name: str) -> None:
    make, kernel, precision = CASES[name]
    scene = make()
    want = end_state(scene, kernel, precision, 1, plain=True)
    assert np.isfinite(want.position).all() and np.abs(want.velocity).max() > 0
    for threads in THREADS:
        got = end_state(scene, kernel, precision, threads)
        for field in ("position", "velocity", "rotation"):
            assert np.array_equal(getattr(got, field), getattr(want, field)), (field, threads)


# What `fast` math rounds otherwise, in units of the last place of a coordinate, a step: sums of forces (four roundings and an
# approximate root, of four springs a mass or twelve), or twelve projections of a mass an iteration with four roundings each,
# or a cluster's mean of all its particles, its rotation, and the way back.
FAST = {"grid": 4 * 5, "cloth": 12 * 5, "mesh": 2 * 2 * 12 * 4, "jelly grid": 2 * 2 * 3 * 30}


@pytest.mark.parametrize("name", FAST)
def test_fast_math_stays_near_exact(name: str) -> None:
    """Differences add up over so few steps and do not grow; approximations are felt."""
    make, kernel, _ = CASES[name]
    scene = make()
    exact = end_state(scene, kernel, "float32", 1, plain=True).position
    fast = end_state(scene, kernel, "float32", THREADS[-1], math="fast").position
    bound = sum(STEPS) * FAST[name] * 2.0**-24 * np.abs(exact).max()
    assert 0 < np.abs(fast - exact).max() < bound
