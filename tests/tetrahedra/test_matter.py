"""What tetrahedra are made of, region by region, and how far masses of neighbours are apart."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kinematic_scenes import BAR, kinematic_scene, run
from vbd_scenes import deformation, elastic_force

from softlab.model.base.errors import SceneError
from softlab.model.particles.tetrahedra.topology import neighbours
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.scene.scene import Scene

EXACT: dict[str, Any] = {"precision": "float64", "math": "exact", "threads": 1}
LONG = BAR | {"shape": {"name": "box", "sides": [0.4, 0.1, 0.1]}, "poisson_ratio": 0.0, "damping": 0.02}
HALF = {"kind": "region", "low": [0.0, -1.0, -1.0]}
HARD = {"kind": "material", "region": "half", "young_modulus": 6e4, "density": 3000.0}


def test_two_halves_that_are_drawn_give_as_springs_in_series_do() -> None:
    """Without a lateral contraction each half is strained alike throughout, which linear tetrahedra hold exactly: the stress
    is d / (l / E1 + l / E2), as is known of rods, the harder half takes E1 / (E1 + E2) of the way."""
    scene = kinematic_scene(
        "newton", bar=LONG, half=HALF, hard=HARD,
        pull={"kind": "motion", "pins": "right", "velocity": [0.1, 0.0, 0.0], "duration": 0.1},
        method={"solver": "newton", "dt": 0.05, "iterations": 20},
    )  # fmt: skip
    found = scene.tetrahedra_set
    state = run(scene, 60, **EXACT)
    hard = found.matter.young_modulus == 6e4
    assert hard.sum() == len(hard) / 2
    strain = deformation(found, state.position)[:, 0, 0] - 1
    np.testing.assert_allclose(strain[hard], 0.01 / 0.2 * 0.25, rtol=1e-6)
    np.testing.assert_allclose(strain[~hard], 0.01 / 0.2 * 0.75, rtol=1e-6)


@pytest.mark.parametrize("solver", ["xpbd", "vbd"])
def test_every_solver_asks_each_tetrahedron_what_it_is_made_of(solver: str) -> None:
    """Two halves, again; by sweeps, to what they leave."""
    scene = kinematic_scene(
        solver, bar=LONG, half=HALF, hard=HARD, damping={"coefficient": 0.2},
        pull={"kind": "motion", "pins": "right", "velocity": [0.1, 0.0, 0.0], "duration": 0.1},
        method={"solver": solver, "dt": 0.01, "substeps": 10 if solver == "xpbd" else 1, "iterations": 3},
    )  # fmt: skip
    found = scene.tetrahedra_set
    state = run(scene, 150, **EXACT)
    hard = found.matter.young_modulus == 6e4
    strain = deformation(found, state.position)[:, 0, 0] - 1
    assert strain[~hard].mean() / strain[hard].mean() == pytest.approx(3, rel=0.02)


def test_regions_weigh_what_their_density_says() -> None:
    found = kinematic_scene("xpbd", bar=LONG, half=HALF, hard=HARD).tetrahedra_set
    assert found.masses.sum() == pytest.approx(0.5 * found.volume.sum() * (1000.0 + 3000.0), rel=1e-14)
    last = {"kind": "material", "region": "half", "body": "bar", "density": 10.0, "damping": 0.5}
    found = kinematic_scene("xpbd", bar=LONG, half=HALF, hard=HARD, last=last).tetrahedra_set
    assert found.masses.sum() == pytest.approx(0.5 * found.volume.sum() * (1000.0 + 10.0), rel=1e-14)
    assert set(found.matter.damping) == {0.02, 0.5} and set(found.matter.young_modulus) == {2e4, 6e4}


def largest_ratio(found: TetrahedraSet) -> float:
    near = neighbours(found.tetrahedra, found.particle_count)
    owner = np.repeat(np.arange(found.particle_count), near.lengths)
    return float((found.masses[owner] / found.masses[near.indices]).max())


@pytest.mark.parametrize("ratio", [1.0, 1.01, 1.5, 2.0, 4.0, 1e7])
def test_a_limit_of_masses_keeps_the_total(ratio: float) -> None:
    """Both to rounding, of a body of which one half is 50 times as dense."""
    body = {"kind": "tetrahedral_body", "shape": {"name": "star", "resolution": 24}, "voxels": 8}
    dense = {"kind": "material", "region": "half", "density": 50_000.0}
    free = Scene({"body": body, "half": HALF, "dense": dense}).tetrahedra_set
    held = Scene({"body": body | {"mass_ratio": ratio}, "half": HALF, "dense": dense}).tetrahedra_set
    assert held.masses.sum() == pytest.approx(free.masses.sum(), rel=1e-14)
    assert largest_ratio(held) <= ratio * (1 + 1e-13) and (held.masses > 0).all()
    if ratio == 1.0:
        np.testing.assert_allclose(held.masses, free.masses.mean(), rtol=1e-12)
    if ratio == 1e7:
        np.testing.assert_allclose(held.masses, free.masses, rtol=1e-12)
    else:
        assert largest_ratio(free) > 4


def test_a_body_with_a_limit_falls_as_one_without() -> None:
    """Masses do not count in free fall; and its scene says so only where it has one."""
    plain = Scene({"bar": BAR | {"pinned": []}, "gravity": {}})
    limited = Scene({"bar": BAR | {"pinned": [], "mass_ratio": 1.5}, "gravity": {}})
    one, other = (run(scene, 5, **EXACT) for scene in (plain, limited))
    np.testing.assert_allclose(one.position, other.position, atol=1e-14)
    assert "mass_ratio" not in plain.canonical() and "mass_ratio" in limited.canonical()
    assert not np.abs(elastic_force(limited.tetrahedra_set, other.position)).max() > 1e-8


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"bar": BAR | {"mass_ratio": 0.5}}, "bar.mass_ratio = 0.5: must be at least 1"),
        ({"hard": HARD}, "hard.region = 'half': there is none"),
        ({"hard": HARD | {"region": "hal"}, "half": HALF}, "did you mean half"),
        ({"hard": HARD | {"body": "bat"}, "half": HALF}, "did you mean bar"),
        ({"hard": HARD | {"poisson_ratio": 0.5}, "half": HALF}, "hard.poisson_ratio"),
        ({"hard": HARD | {"density": 0.0}, "half": HALF}, "hard.density = 0.0: must be greater than 0"),
    ],
)
def test_what_no_material_can_be_is_one_clear_line(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words) as caught:
        kinematic_scene("xpbd", **changes)
    assert "\n" not in str(caught.value)
