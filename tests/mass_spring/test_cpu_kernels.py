"""The CPU's ladder of kernels: the same bits on every rung in `exact` math, on every grid, and which is taken when."""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softlab.app.driver import open_simulation
from softlab.cpu_backend.core import layout
from softlab.cpu_backend.mass_spring.grid import choice
from softlab.cpu_backend.mass_spring.grid import tiled as tiled_kernel
from softlab.cpu_backend.mass_spring.grid.choice import LEVELS, choose_kernel, tiling
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.scene.scene import load_scene

MOST = numba.config.NUMBA_NUM_THREADS
EXACT32 = {"math": "exact", "precision": "float32"}


def scene_of(rows, columns, integrator="lab", **changes):
    shape = {"grid.rows": rows, "grid.columns": columns, "method.integrator": integrator}
    return load_scene("lab-hammock").replace(shape | changes)


def stepped(scene, batches, **options):
    with open_simulation(scene, allow_unstable=True, **options) as simulation:
        for steps in batches:
            simulation.advance(steps)
        state = simulation.state()
        return np.concatenate([state.position, state.velocity])


@cache
def expected(rows, columns, integrator, batches):
    return stepped(scene_of(rows, columns, integrator), batches, kernel="fused", threads=1, **EXACT32)


@pytest.mark.parametrize("kernel", ["team", "tiled"])
@pytest.mark.parametrize("integrator", ["lab", "velocity-verlet"])
@pytest.mark.parametrize(
    ("rows", "columns"),
    [(1, 1), (2, 2), (1, 33), (33, 1), (3, 1000), (1000, 3), (37, 1000), (64, 64), (16, 15), (40, 1013)],
)
def test_odd_shapes_give_the_bits_of_fused(kernel, integrator, rows, columns):
    """Fewer rows than threads or levels, fewer columns than a vector, several tiles; steps: 1, fewer than LEVELS, more."""
    batches = (1, LEVELS - 2, 2 * LEVELS + 3)
    want = expected(rows, columns, integrator, batches)
    assert np.isfinite(want).all()
    scene = scene_of(rows, columns, integrator)
    for threads in {1, min(2, MOST), MOST}:
        assert np.array_equal(stepped(scene, batches, kernel=kernel, threads=threads, **EXACT32), want), threads


@settings(deadline=None, max_examples=40)
@given(
    rows=st.integers(1, 70),
    columns=st.integers(1, 140),
    steps=st.integers(1, 40),
    threads=st.integers(1, MOST),
    levels=st.integers(1, 17),
    blocks=st.integers(1, 5),
    kernel=st.sampled_from(["team", "tiled"]),
)
def test_any_grid_levels_and_tiles_give_the_bits_of_fused(rows, columns, steps, threads, levels, blocks, kernel):
    scene = scene_of(rows, columns, **{"grid.pinned": "every:3"})
    want = stepped(scene, (steps,), kernel="fused", threads=1, **EXACT32)
    with open_simulation(scene, kernel=kernel, threads=threads, **EXACT32) as simulation:
        if kernel == "tiled":
            simulation._tiling = tiling(np.float32, columns, levels, 64 * blocks)
            bands = len(simulation._scratch)
            simulation._scratch = np.zeros((bands, simulation._tiling.scratch), np.float32)
        simulation.advance(steps)
        state = simulation.state()
    assert np.array_equal(np.concatenate([state.position, state.velocity]), want)


def test_parts_that_know_their_place_do_so_in_every_tile():
    """Random forces and a poke depend on particle and step: over several tiles, bands and ways."""
    changes = {"external.magnitude": 0.05, "external.seed": 3}
    scene = scene_of(19, 1100, **changes, **{"method.dt": 0.002, "grid.pinned": "none"})
    states = []
    for kernel, threads in (("fused", 1), ("tiled", min(3, MOST))):
        with open_simulation(
            scene, kernel=kernel, threads=threads, math="exact", precision="float64", live=("poke",)
        ) as simulation:
            for particle in (0, 18 * 1100 + 600, 7 * 1100 + 1099):
                simulation.poke(particle, (0.3, -0.2))
                simulation.advance(LEVELS + 4)
            state = simulation.state()
            states.append(np.concatenate([state.position, state.velocity]))
    assert np.array_equal(states[1], states[0])


@pytest.mark.parametrize("kernel", ["team", "tiled"])
def test_divergence_is_found_at_the_same_step_and_particle(kernel):
    def first_diverged(**options):
        with pytest.raises(Diverged) as caught:
            stepped(scene_of(24, 40, **{"method.dt": 0.08}), (3000,), **options, **EXACT32)
        return str(caught.value)

    assert first_diverged(kernel=kernel, threads=min(4, MOST)) == first_diverged(kernel="fused", threads=1)


def test_a_team_that_does_not_come_together_is_done_by_the_first(monkeypatch):
    """One thread for four bands runs them one after the other: the first steps for all, the others find all done."""
    scene = scene_of(24, 40)
    want = stepped(scene, (30,), kernel="fused", threads=1, **EXACT32)
    set_num_threads = numba.set_num_threads
    monkeypatch.setattr(numba, "set_num_threads", lambda count: set_num_threads(1))
    with open_simulation(scene, kernel="team", threads=min(4, MOST), **EXACT32) as simulation:
        simulation.advance(30)
        state = simulation.state()
    assert np.array_equal(np.concatenate([state.position, state.velocity]), want)


def test_the_choice_follows_size_layer_and_integrator(monkeypatch):
    def chosen(side, precision=np.float32, wanted=None, **changes):
        return choose_kernel(scene_of(side, side, **changes), precision, wanted)

    monkeypatch.setattr(choice, "threading_layer", lambda: "omp")
    assert [chosen(side) for side in (1, 32, 512, 1024, 4096)] == ["team"] * 3 + ["tiled"] * 2
    assert chosen(724) == "team" and chosen(724, np.float64) == "tiled"
    assert choose_kernel(scene_of(200_000, 3), np.float32, None) == "team"  # too narrow for tiles
    assert chosen(32, integrator="rk4") == chosen(2048, integrator="rk4") == "fused"
    for name in choice.KERNELS:
        assert chosen(32, wanted=name) == name
    for name in ("team", "tiled"):
        with pytest.raises(SceneError, match="rk4"):
            chosen(32, wanted=name, integrator="rk4")
    with pytest.raises(SceneError, match="fused, team, tiled, stages"):
        chosen(32, wanted="fastest")
    monkeypatch.setattr(choice, "threading_layer", lambda: "workqueue")
    assert chosen(32) == chosen(1024) == "tiled"
    with pytest.raises(SceneError, match="omp"):
        chosen(32, wanted="team")


def test_another_threading_layer_gives_the_same_bits():
    """On `workqueue`, which can hold no team, a simulation without a wish runs, and refuses the wish for one."""
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); from test_cpu_kernels import *\n"
        "scene = scene_of(33, 70)\n"
        "want = expected(33, 70, 'lab', (30,))\n"
        "print(np.array_equal(stepped(scene, (30,), threads=2, **EXACT32), want))\n"
        "try: open_simulation(scene, kernel='team')\n"
        "except SceneError as error: print('workqueue' in str(error))\n"
    )
    environment = os.environ | {"NUMBA_THREADING_LAYER": "workqueue"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120, cwd=os.getcwd()
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["True", "True"]


@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("columns", [1, 15, 16, 17, 1008, 1023, 1024, 4096])
def test_rows_are_whole_lines_with_a_ghost(columns, real):
    """Every row begins at a cache line and has a ghost; neither rows nor planes lie a multiple of 4 KiB apart."""
    padded, item = layout.padded(64, columns, real), np.dtype(real).itemsize
    assert padded.stride > columns and padded.stride * item % layout.LINE == 0
    assert padded.plane * item % layout.PAGE == layout.SHIFT
    assert padded.stride * item % layout.PAGE != 0
    assert padded.plane >= 64 * padded.stride + layout.block_of(real)  # the last row's loop looks one further
    memory = layout.aligned_zeros(padded.size, real)
    assert memory.ctypes.data % layout.LINE == 0
    view = padded.view(memory)
    assert view.shape == (4, 64, columns) and np.shares_memory(view, memory)
    view[3, 63, columns - 1] = 1
    assert memory[3 * padded.plane + 63 * padded.stride + columns - 1] == 1


@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("levels", [1, 2, 9, 16, 17, 18])
def test_a_halo_lasts_for_every_level_but_the_last(levels, real):
    width = tiled_kernel.halo(levels, real)
    assert width >= levels - 1 and width % layout.block_of(real) == 0
