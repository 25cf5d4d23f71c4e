"""Every tile of the tables of grids, on a real GPU: the same bits as a launch a step."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.scene.scene import load_scene

pytestmark = pytest.mark.gpu


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_every_tile_of_the_table_gives_the_bits_of_a_launch_a_step(precision: str) -> None:
    """Also where two blocks share a multiprocessor, and where tiles are as large as shared memory."""
    from softlab.gpu_backend.core.tiling import parsed_tile
    from softlab.gpu_backend.mass_spring.grid.choice import RESIDENT, TILES
    from softlab.gpu_backend.mass_spring.grid.tile_launch import why_no_tile

    real = np.float32 if precision == "float32" else np.float64
    for name in [*RESIDENT[real], TILES[real][0]]:
        rung = "resident" if name in RESIDENT[real] else "tiles"
        tile = parsed_tile(name)
        sizes = [n for n in (1000, 500, 250, 120) if rung == "tiles" or not why_no_tile(rung, n, n, real, tile)]
        scene = load_scene("lab-grid").replace({"grid.rows": sizes[0], "grid.columns": sizes[0] + 1})
        states = []
        for kernel in ("launch", f"{rung}:{name}"):
            with open_simulation(scene, "gpu", precision=precision, math="exact", kernel=kernel) as simulation:
                simulation.advance(150)
                states.append(simulation.state())
        assert np.array_equal(states[0].position, states[1].position), name
        assert np.array_equal(states[0].velocity, states[1].velocity), name
