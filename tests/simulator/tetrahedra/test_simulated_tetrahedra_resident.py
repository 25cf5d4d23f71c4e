"""The kernel `resident` of tetrahedra, in plain Python: several slabs that meet, all at once, the bits of the CPU's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_simulated_tiles import assert_same, blocks_together  # noqa: F401  # a fixture
from tetrahedra_scenes import BODY, METHOD, moving, tetrahedra_scene

from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

BAR = BODY | {"shape": {"name": "box", "sides": [0.1, 0.5, 0.2], "resolution": 10}, "pinned": ["bottom"]}


def end_state(scene: Scene, backend: str, **options: Any) -> State:
    """In two goes, the second of which finds the tags and buffers that the first one left."""
    with open_simulation(scene, backend, initial=moving(scene), math="exact", **options) as simulation:
        simulation.advance(1)
        simulation.advance(1)
        return simulation.state()


def bar(**changes: Any) -> Scene:
    """Of five layers: slabs of 2, 2 and 1."""
    return Scene({"body": BAR | changes, "gravity": {}, "method": METHOD | {"substeps": 2}})


@pytest.mark.parametrize("layers", [2, 4, 6])
def test_slabs_do_what_the_cpu_does(blocks_together: None, layers: int) -> None:  # noqa: F811
    scene = bar()
    assert_same(end_state(scene, "gpu", kernel=f"resident:{layers}"), end_state(scene, "cpu", threads=1))


@pytest.mark.parametrize(
    "changes", [{"damping": 0.02}, {"tetrahedra": 6, "material": "corotated"}, {"material": "neo-hookean"}]
)
def test_materials_and_dampers(blocks_together: None, changes: dict[str, Any]) -> None:  # noqa: F811
    scene = bar(**changes)
    options = {"precision": "float64"}
    assert_same(end_state(scene, "gpu", kernel="resident", **options), end_state(scene, "cpu", threads=1, **options))


def test_several_bodies_and_every_part(blocks_together: None) -> None:  # noqa: F811
    scene = tetrahedra_scene("everything once")
    assert_same(end_state(scene, "gpu", kernel="resident"), end_state(scene, "cpu", threads=1))


def test_what_cannot_be_resident_is_refused() -> None:
    for kernel, scene, why in (
        ("resident", tetrahedra_scene("free"), "bodies of voxels"),
        ("resident", tetrahedra_scene("everything"), "colliders-in-iterations"),
        ("resident:3", bar(), "even"),
        ("resident:two", bar(), "even"),
        ("slabs", bar(), "resident, graph, launch, stages"),
    ):
        with pytest.raises(SceneError, match=why), open_simulation(scene, "gpu", kernel=kernel):
            pass


def test_a_body_too_large_for_the_chip_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    import softlab.gpu_backend.tetrahedra.resident_launch as resident_launch

    for limits, why in (((1, 1 << 20), "at once"), ((64, 500), "shared memory")):
        monkeypatch.setattr(resident_launch, "device_limits", lambda limits=limits: limits)
        with pytest.raises(SceneError, match=why), open_simulation(bar(), "gpu", kernel="resident:2"):
            pass
    assert np.isfinite(limits[0])
