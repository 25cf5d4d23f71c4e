"""The CUDA kernels' logic, in plain Python at 8 x 9 masses, against the CPU: the same operations in the same order."""

from __future__ import annotations

import json

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.bench.reference import mass_spring as reference
from softlab.gpu_backend.core.sheet import BLOCK
from softlab.gpu_backend.mass_spring.grid.kernels import make_tools
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.simulation import State
from softlab.model.scene.scene import load_scene

SCENES = {
    "busy": {
        "grid.rows": 8,
        "grid.columns": 9,
        "grid.pinned": "every:3",
        "external.magnitude": 0.05,
        "perturbation.amplitude": 0.05,
    },
    "bare": {
        "grid.rows": 8,
        "grid.columns": 9,
        "grid.pinned": "none",
        "gravity.enabled": False,
        "damping.coefficient": 0.0,
    },
}


def end_state(changes: dict, backend: str, **options: object) -> State:
    scene = load_scene("lab-grid").replace(changes)
    live = ("poke",) if "external.magnitude" in changes else ()
    with open_simulation(scene, backend, math="exact", live=live, allow_unstable=True, **options) as simulation:
        if live:
            simulation.poke(20, (0.05, -0.02))
        simulation.advance(5)
        simulation.advance(4)
        return simulation.state()


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("name", SCENES)
def test_passes_do_what_the_cpu_does(name: str, integrator: str, precision: str) -> None:
    changes = SCENES[name] | {"method.integrator": integrator}
    expected = end_state(changes, "cpu", precision=precision)
    state = end_state(changes, "gpu", precision=precision)
    assert np.array_equal(state.position, expected.position)
    assert np.array_equal(state.velocity, expected.velocity)


@pytest.mark.parametrize("integrator", ["lab", "velocity-verlet"])
@pytest.mark.parametrize("name", SCENES)
def test_one_block_does_what_the_cpu_does(name: str, integrator: str) -> None:
    changes = SCENES[name] | {"method.integrator": integrator}
    expected = end_state(changes, "cpu")
    state = end_state(changes, "gpu", kernel="one-block")
    assert np.array_equal(state.position, expected.position)
    assert np.array_equal(state.velocity, expected.velocity)


@pytest.mark.parametrize("integrator", ["lab", "velocity-verlet", "rk4"])
def test_stages_do_what_the_cpu_does(integrator: str) -> None:
    changes = SCENES["busy"] | {"method.integrator": integrator}
    expected = end_state(changes, "cpu", precision="float64")
    state = end_state(changes, "gpu", precision="float64", kernel="stages")
    assert np.array_equal(state.position, expected.position)
    assert np.array_equal(state.velocity, expected.velocity)


def test_a_divergence_is_named() -> None:
    scene = load_scene("lab-grid").replace(
        {"grid.rows": 4, "grid.columns": 4, "method.dt": 0.2, "perturbation.amplitude": 0.1}
    )
    found = []
    for backend in ("cpu", "gpu"):
        with open_simulation(scene, backend, math="exact", allow_unstable=True) as simulation:
            with pytest.raises(Diverged) as caught:
                simulation.advance(400)
                simulation.check()
            assert np.isfinite(simulation.state().position).all()
            found.append((caught.value.step, caught.value.particle))
    assert found[0] == found[1]


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_reference_is_met_over_the_edges_of_blocks(integrator: str) -> None:
    """Two blocks of threads each way, in turn just full and with a single row or column in the last; within rounding of
    NumPy's."""
    turn = list(INTEGRATORS).index(integrator) % 2
    rows, columns = (BLOCK[1] + 1, 2 * BLOCK[0]) if turn else (2 * BLOCK[1], BLOCK[0] + 1)
    changes = SCENES["busy"] | {"grid.rows": rows, "grid.columns": columns, "method.integrator": integrator}
    scene = load_scene("lab-grid").replace(changes)
    position, velocity = reference.simulate(scene, 2)
    with open_simulation(
        scene, "gpu", math="exact", precision="float64", kernel="launch", allow_unstable=True
    ) as simulation:
        simulation.advance(2)
        state = simulation.state()
    assert np.abs(state.position - position).max() < 200 * np.finfo(np.float64).eps * np.abs(position).max()
    assert (
        np.abs(state.velocity - velocity).max()
        < 200 * np.finfo(np.float64).eps * np.abs(position).max() / scene.method.dt
    )


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_the_first_mass_that_left_the_finite_world_is_found(real: type) -> None:
    """By its place beyond the bound, on either side of a centre, or by a place or a velocity that is no number."""
    kind = np.complex64 if real is np.float32 else np.complex128
    wrong = [(0, 1e3 + 1), (0, -1001j), (0, complex(np.nan, 0)), (1, complex(0, np.nan)), (1, complex(np.inf, 0))]
    for which, value, bad in [*((*one, True) for one in wrong), (0, 999 + 999j, False), (1, 1e30, False)]:
        state = [np.zeros(10, kind), np.zeros(10, kind)]
        state[which][[4, 7]] = value
        result = np.full(1, 99, np.int64)
        make_tools(real).first_diverged[2, 8](*state, real(1e3), real(0), real(0), real(0), result)
        assert result[0] == (4 if bad else 99)
        moved, result[0] = [state[0] + (5e6 - 1e7j), state[1]], 99
        make_tools(real).first_diverged[2, 8](*moved, real(1e3), real(5e6), real(-1e7), real(0), result)
        assert result[0] == (4 if bad else 99)


@pytest.mark.parametrize("rows,columns", [(1, 1), (1, 5), (5, 1)])
def test_the_smallest_grids(rows: int, columns: int) -> None:
    changes = {"grid.rows": rows, "grid.columns": columns, "grid.pinned": "none"}
    expected, state = end_state(changes, "cpu"), end_state(changes, "gpu")
    assert np.array_equal(state.position, expected.position)


def test_live_changes_and_a_state_that_moves_over() -> None:
    scene = load_scene("lab-grid").replace({"grid.rows": 5, "grid.columns": 5})
    live = ("gravity",)
    with (
        open_simulation(scene, "cpu", math="exact", live=live) as cpu,
        open_simulation(scene, "gpu", math="exact", live=live) as gpu,
    ):
        cpu.advance(3)
        gpu.load(cpu.state())
        for simulation in (cpu, gpu):
            simulation.set("gravity.enabled", False)
            simulation.advance(4)
        assert np.array_equal(cpu.state().position, gpu.state().position)
        assert np.array_equal(cpu.read("position"), gpu.read("position"))


def test_a_graph_is_refused_with_the_reason() -> None:
    with pytest.raises(SceneError, match="simulator"):
        open_simulation("lab-grid", "gpu", kernel="graph")


def test_run_prints_one_json_object(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    from softlab import cli

    command = "softlab run lab-grid --backend gpu --set grid.rows=8 --set grid.columns=8 --steps 20 --json"
    monkeypatch.setattr(sys, "argv", command.split())
    with pytest.raises(SystemExit) as caught:
        cli.main()
    assert caught.value.code in (0, None)
    report = json.loads(capsys.readouterr().out)
    assert report["backend"] == "gpu" and report["particles"] == 64 and report["outcome"] == "ok"
    assert report["error"] is None or report["error"] > 0
