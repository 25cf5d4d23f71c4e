"""A cloth's contacts with itself on a real GPU: the bits of the CPU in exact math, through launches and captured graphs."""

from __future__ import annotations

import numpy as np
import pytest
from contact_scenes import folded

from softlab.app.driver import open_simulation
from softlab.model.contact.penetration import measure
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu


def end_state(scene: Scene, backend: str, steps: int, **options: object) -> State:
    with open_simulation(scene, backend, math="exact", **options) as simulation:  # type: ignore[arg-type]
        simulation.advance(steps // 3)
        simulation.advance(steps - steps // 3)
        return simulation.state()


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("ordering", ["gauss-seidel", "jacobi"])
@pytest.mark.parametrize(("rows", "columns", "layer", "apart"), [(37, 33, 9, 1), (13, 5, 7, 0)])
def test_exact_math_gives_the_bits_of_the_cpu(
    rows: int, columns: int, layer: int, apart: int, ordering: str, precision: str
) -> None:
    """Sheets that neither a block nor a warp divides; with layers in one place as well."""
    scene = folded(rows, columns, layer=layer, apart=apart).replace({"method.ordering": ordering})
    expected = end_state(scene, "cpu", 40, precision=precision)
    for kernel in ("graph", "launch", "stages"):
        state = end_state(scene, "gpu", 40, precision=precision, kernel=kernel)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel


def test_runs_repeat_to_the_bit() -> None:
    """Buckets are filled in whatever order threads come: no sum may show it."""
    scene = load_scene("cloth-self")
    states = [end_state(scene, "gpu", 60) for _ in range(3)]
    assert all(np.array_equal(state.position, states[0].position) for state in states)


def test_fast_math_keeps_the_cloth_out_of_itself() -> None:
    """After two seconds on the floor: as for the CPU in test_contacts_scenes.py."""
    scene = load_scene("hard/b18")
    with open_simulation(scene, "gpu") as simulation:
        simulation.advance(120)
        position = simulation.read("position")
    found = measure(scene.grid.rows, scene.grid.columns, scene.grid.spacing, position, scene.self_collision.thickness)  # type: ignore[union-attr]
    assert found.min_gap > 0.8 * scene.self_collision.thickness  # type: ignore[union-attr]
    assert found.crossings == 0
