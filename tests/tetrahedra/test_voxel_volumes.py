"""Voxels that keep their volume as a whole: the judge's states, what is stored, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from tetrahedra_scenes import BODY, moving, tetrahedra_scene

from softlab.app.driver import open_simulation
from softlab.bench.reference import tetrahedra_voxels as reference
from softlab.bench.reference.finite_elements import Body
from softlab.bench.reference.tetrahedra import Method
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.constraints import SHAPES, VOLUMES, constraint_sets, tetrahedra_of_sets
from softlab.model.tetrahedra.material import energies

STEPS = 2


@pytest.mark.parametrize("name", ["voxels", "hookean voxels"])
def test_states_are_the_references(name: str) -> None:
    """As tests/tetrahedra/test_tetrahedra_cpu.py, whose bounds these are: rounding alone. A Poisson's ratio of 0.499 makes
    a volume 500 times as stiff as a shape; but the projection of a volume is exact where it does not give, so that rounding
    is not magnified by it."""
    scene = tetrahedra_scene(name)
    found, part, begin, method = scene.tetrahedra_set, scene.tetrahedra["body"], moving(scene), scene.method
    shapes, volumes = constraint_sets(scene)
    chosen, first = tetrahedra_of_sets(found)
    body = Body.of(found.position, found.tetrahedra[chosen], part.material, part.young_modulus, part.poisson_ratio)
    place = np.empty(len(chosen), np.int64)
    place[chosen] = np.arange(len(chosen))
    voxels = [np.sort(place[np.flatnonzero(found.patch == found.patch[one])]) for one in first]
    position, velocity = reference.simulate(
        body, begin.position, begin.velocity, begin.inverse_mass, voxels, method.dt / method.substeps,
        STEPS * method.substeps, Method(shapes.sweep, method.iterations, (0.0, -9.81, 0.0), part.damping),
    )  # fmt: skip
    with open_simulation(scene, "cpu", initial=begin, precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(STEPS)
        state = simulation.state()
    np.testing.assert_allclose(state.position, position, atol=1e-12)
    np.testing.assert_allclose(state.velocity, velocity, atol=3e-10)
    assert np.abs(state.position - begin.position).max() > 1e-3
    assert (shapes.kind, volumes.kind, volumes.corners.shape) == (SHAPES, VOLUMES, (2, 8))


@pytest.mark.parametrize("material", ["fixed-corotated", "neo-hookean"])
def test_a_mean_volume_stores_no_more_than_each_does(material: str) -> None:
    """A linear map stores the same either way, since all J are alike; of any other the square of a mean is at most the mean
    of squares (Jensen)."""
    whole, each = (
        Scene({"body": BODY | {"material": material, "poisson_ratio": 0.499, "volume": volume}}).tetrahedra_set
        for volume in ("voxels", "tetrahedra")
    )
    turned = whole.position @ np.diag([1.25, 0.8, 1.0])
    assert energies(whole, turned).sum() == pytest.approx(energies(each, turned).sum(), rel=1e-9)
    shaken = whole.position + np.random.default_rng(2).normal(0, 1e-3, whole.position.shape)
    assert energies(whole, shaken).sum() < energies(each, shaken).sum()
    assert len(np.unique(whole.patch)) == len(whole.tetrahedra) // 5 and len(np.unique(each.patch)) == len(
        each.tetrahedra
    )
