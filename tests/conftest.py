"""Shared by the tests: how to open a scene on each backend.

Tests of physics run in `exact` math and, unless they say otherwise, in float64, so that their tolerances follow from
the equations alone.
"""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before numba: spinning idle threads starve a small machine

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

import cpu_backend.threads  # noqa: F401  # before numba: it asks for four times the cores


@pytest.fixture(params=["cpu", pytest.param("gpu", marks=pytest.mark.gpu)])
def backend(request: pytest.FixtureRequest) -> str:
    """`cpu`, and `gpu` where there is one (kernels under the CUDA simulator have their own tests, on small grids)."""
    if request.param == "gpu":
        from gpu_backend.device import gpu_available, simulated

        available, reason = gpu_available()
        if not available or simulated():
            pytest.skip(reason if not available else "the CUDA simulator is no GPU: too slow for this test")
    return request.param


@pytest.fixture(params=["fused", "stages"])
def kernel(request: pytest.FixtureRequest) -> str:
    """Both executions of a plan: many steps in one kernel, and stage by stage."""
    return request.param


@pytest.fixture(params=["float64", "float32"])
def precision(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def opened(backend: str) -> Callable[..., Any]:
    """opened(scene, kernel=..., precision=..., ...) -> a simulation on `backend`; dt over the limit is allowed."""
    from app.driver import open_simulation

    def open_it(
        scene: Any, *, kernel: str = "fused", precision: str = "float64", math: str = "exact", **options: Any
    ) -> Any:
        if backend == "cpu":
            options.setdefault("threads", 1)
        else:
            options.pop("threads", None)
            kernel = {"fused": None}.get(kernel, kernel)  # type: ignore[assignment]  # the fused ones have names there
        options.setdefault("allow_unstable", True)
        return open_simulation(scene, backend, kernel=kernel, precision=precision, math=math, **options)

    return open_it


@pytest.fixture
def run(opened: Callable[..., Any]) -> Callable[..., Any]:
    """run(scene, steps, ...) -> the State after `steps` steps; `initial`: where to start, see `start_at`."""

    def run_it(scene: Any, steps: int, **options: Any) -> Any:
        with opened(scene, **options) as simulation:
            simulation.advance(steps)
            return simulation.state()

    return run_it


@pytest.fixture
def start_at() -> Callable[..., Any]:
    """start_at(scene, position, velocity=0) -> a State at time 0 to open the scene with."""
    import numpy as np

    from model.build import build
    from model.simulation import State

    def state(scene: Any, position: Any, velocity: Any = None) -> State:
        position = np.asarray(position, dtype=np.float64).reshape(-1, 2)
        velocity = (
            np.zeros_like(position) if velocity is None else np.asarray(velocity, dtype=np.float64).reshape(-1, 2)
        )
        return State(position, velocity, build(scene).inverse_mass, 0.0, 0)

    return state


@pytest.fixture
def ptx_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """CUDA kernels can be compiled without a GPU. Needs NVVM and NVRTC: pip install -e ".[ptx]"."""
    cuda = pytest.importorskip("numba.cuda", reason="needs numba-cuda")
    import numba.cuda.dispatcher as dispatcher
    from numba import types

    monkeypatch.setattr(dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=(9, 0)))
    try:
        cuda.compile_ptx(lambda a: None, (types.float32[::1],), cc=(9, 0))
    except Exception as error:
        pytest.skip(f'the CUDA compiler is not installed (pip install -e ".[ptx]"): {type(error).__name__}')


# Of the parametrised tests in these files, which compile long for each variant, every n-th variant runs by default.
THINNED = {
    "test_simulated_xpbd.py": 8, "test_simulated_cloth_tiles.py": 6, "test_simulated_mesh.py": 4,
    "test_simulated_contacts.py": 4, "test_simulated_motion.py": 4, "test_simulated_matching.py": 3,
    "test_simulated_bodies.py": 3, "test_simulated_cloth.py": 3, "test_simulated_hard.py": 3, "test_simulated_implicit.py": 3,
    "test_simulated_tiles.py": 3, "test_simulated_alternating.py": 2, "test_simulated_gpu.py": 2,
    "test_motion.py": 5, "test_implicit.py": 6, "test_xpbd_cpu.py": 4, "test_xpbd_cpu_reference.py": 4,
    "test_xpbd_laws.py": 3,
    "test_xpbd_mesh_cpu.py": 4, "test_xpbd_assembly.py": 2, "test_cloth_reference.py": 3, "test_cloth_cpu.py": 3,
    "test_cloth_orders.py": 3, "test_cloth_colliders.py": 2, "test_cloth_assembly.py": 2, "test_cpu_bits.py": 2,
    "test_cpu_reference.py": 2, "test_b1.py": 2, "test_contacts.py": 3, "test_contacts_scenes.py": 2, "test_hard_cloth.py": 2,
    "test_hard_xpbd.py": 2, "test_hard_bodies.py": 2, "test_accuracy_xpbd.py": 2, "test_accuracy_s6.py": 2,
    "test_matching.py": 3, "test_lattice_ptx.py": 3,
    "test_bodies_solver.py": 2, "test_simulated_particle_contacts.py": 4, "test_links.py": 2, "test_spare.py": 6,
    "test_contact_restitution.py": 2, "test_rebound.py": 4, "test_simulated_contact_restitution.py": 6,
    "test_simulated_rebound.py": 4, "test_simulated_lattice.py": 3, "test_rebound_ptx.py": 2,
    "test_particle_contacts.py": 2, "test_particle_contacts_ptx.py": 4,
    "test_simulated_bodies_material.py": 6, "test_bodies_material_ptx.py": 2,
    "test_cloth_tiles_ptx.py": 3, "test_xpbd_ptx.py": 3, "test_xpbd_mesh_ptx.py": 3,
    "test_distance_field_cloths.py": 5, "test_simulated_distance_field.py": 7,
    "test_simulated_mesh_collider.py": 2, "test_contacts_ptx.py": 3, "test_cloth_ptx.py": 2, "test_bodies_ptx.py": 2,
}  # fmt: skip


def pytest_addoption(parser):
    parser.addoption(
        "--thorough", action="store_true", help="every variant of every test, half an hour more on two cores"
    )


def pytest_collection_modifyitems(config, items):
    """Skip what THINNED leaves out, but nothing that is for a real GPU, unless --thorough."""
    if config.getoption("--thorough"):
        return
    seen = {}
    for item in items:
        every = THINNED.get(item.path.name)
        if every is None or not hasattr(item, "callspec") or item.get_closest_marker("gpu"):
            continue
        place = seen[item.path, item.originalname] = seen.get((item.path, item.originalname), -1) + 1
        if place % every:
            item.add_marker(pytest.mark.skip(reason="one of many variants: pytest --thorough runs them all"))
