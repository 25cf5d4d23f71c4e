"""Water among bodies, tetrahedra and cloths: against the NumPy reference, laws, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_world_cpu import run
from wet_scenes import SHEET, WATER, D, wet_scene
from world_scenes import moving

from softlab.app.command.run import Request, run_scene
from softlab.app.output.files import write_state
from softlab.model.base.errors import SceneError
from softlab.model.world.solids import solids_of


@pytest.mark.parametrize("name", ["bodies", "tetrahedra"])
def test_momentum_is_kept(name: str) -> None:
    """Of all members together, without gravity and walls: what rounding leaves of what water gives to solids."""
    scene = wet_scene(name, gravity=None, floor=None)
    m, begin = scene.world_set.masses[:, None], moving(scene, 0.001)
    end = run(scene, 4, begin)
    scale = float((m * np.abs(begin.velocity)).sum())
    np.testing.assert_allclose((m * end.velocity).sum(axis=0), (m * begin.velocity).sum(axis=0), atol=1e-11 * scale)
    water = scene.world_set.slices()["fluid"]
    given = (m * (end.velocity - begin.velocity))[water].sum(axis=0)
    assert np.abs(given[1]) > 1e-3 * scale, "they did not meet"


@pytest.mark.parametrize(
    ("name", "changes", "told"),
    [
        ("bodies", {"brick.origin": [2.5 * D, 2.0 * D, 2.5 * D]}, r"water\.origin .* begin inside brick: move one"),
        ("tetrahedra", {"block.origin": [0.13, 0.08, 0.12]}, r"water\.origin .* begin inside block: move one"),
        ("bodies", {"brick.particle_spacing": 2 * D}, r"brick\.particle_spacing .* at most, 1\.25 rest distances"),
        ("cloth", {"method.scheme": "averaged"}, r"method\.scheme .* must be macklin where a fluid meets solids"),
        ("cloth", {"domain": {"size": [1.0, 1.0, 1.0]}}, r"domain\.kind .* is not supported together with solids"),
        (
            "cloth", {"water": {"kind": "fluid", "dimensions": 2, "size": [0.2, 0.2]}},
            r"water\.dimensions .* must be 3 where a fluid meets solids",
        ),
        ("cloth", {"method": {"solver": "pbf"}}, r"method\.solver .* must be world"),
        ("cloth", {"wetting": {"capacity": 1.5}}, r"wetting\.kind .* no longer absorb fluid; .* its wet mass or density"),
        ("cloth", {"soaked": {"kind": "wetting"}}, r"soaked\.kind .* no longer absorb fluid"),
    ],
)  # fmt: skip
def test_what_is_refused(name: str, changes: dict[str, Any], told: str) -> None:
    """In one line."""
    with pytest.raises(SceneError, match=told) as caught:
        tables = {key: value for key, value in changes.items() if "." not in key}
        scene = wet_scene(name, **tables)
        scene = scene.replace({key: value for key, value in changes.items() if "." in key})
        solids_of(scene)
    assert "\n" not in str(caught.value)


def test_a_cloths_samples_are_close_enough_and_weigh_what_it_weighs() -> None:
    """A rest distance and less from one another, however wide its threads are; pinned corners give way to nothing."""
    scene = wet_scene("cloth")
    solids = solids_of(scene)
    sheet = scene.members["cloth"].grid.particle_count
    points = solids.samples.points(scene.world_set.position[solids.particles])
    nearest = np.sort(np.linalg.norm(points[:, None] - points, axis=2), axis=1)[:, 1]
    assert nearest.min() > 0.55 * D * (1 - 1e-6) and nearest.max() < D and solids.samples.count > sheet
    assert list(solids.particles) == list(range(sheet))
    assert (solids.samples.lightness == 0).sum() == 2
    unit = WATER["rest_distance"] ** 3 * 1000
    assert solids.samples.lightness.max() == pytest.approx(unit / SHEET["mass"])


def test_a_state_file_with_wetness_opens_with_a_note(tmp_path: Path) -> None:
    """Former versions wrote it: the run is that of the same file without it."""
    scene = wet_scene("cloth")
    begin = moving(scene, 0.001)
    file = write_state(tmp_path / "old.npz", begin)
    with np.load(file) as arrays:
        np.savez(file, **arrays, wetness=np.ones(len(begin.position)))
    result = run_scene(scene, Request(steps=1, precision="float64", math="exact", initial=str(file)), progress=False)
    assert [note for note in result.notes if "old.npz: wetness is ignored" in note]
    assert np.array_equal(result.state.position, run(scene, 1, begin).position)
