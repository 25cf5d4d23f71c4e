"""Fluids among solids: the judge's motion, momentum of both together, the same bits whoever computes them."""

from __future__ import annotations

import numpy as np
import pytest
from solid_scenes import D, driven, fluid_scene, judged, samples_of, stirred

from softlab.model.fluid.samples import particle_samples, sample_volumes, triangle_samples
from softlab.model.scene.scene import Scene

OIL = {"kind": "fluid", "origin": [0.0, 4 * D, 0.0], "size": [3 * D, D, 3 * D], "rest_distance": D, "density": 500.0}
WALLED = {
    "gravity": {},
    "floor": {"kind": "plane", "thickness": 0.0},
    "oil": OIL | {"drag": 0.5, "surface_tension": 1.0},
}


@pytest.mark.parametrize("scene", [fluid_scene(), fluid_scene(**WALLED)], ids=["alone", "walls and oil"])
def test_it_is_the_judges_and_the_same_bits_on_any_threads(scene: Scene) -> None:
    """A substep's sums have some fifty terms; slopes and pulls divide by distances, here of a tenth of the support at least:
    a thousand roundings of numbers around 1."""
    wanted, found = judged(scene, 2), driven(scene, 2)
    for one, other, within in zip(found, wanted, (1e-12, 1e-10, 1e-12, 1e-10), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=within)
    assert np.array_equal(found[3][4], np.zeros(3)), "what nothing moves has moved"
    assert np.abs(found[2] - samples_of(scene)[1] - 2 / 60 * samples_of(scene)[2]).max() > 1e-3, "nothing was pushed"
    again = driven(scene, 2, threads=3)
    assert all(np.array_equal(one, other) for one, other in zip(found, again, strict=True))


@pytest.mark.parametrize(("precision", "within"), [("float64", 1e-13), ("float32", 1e-5)])
def test_momentum_of_both_together_is_kept(precision: str, within: float) -> None:
    """What a pair does to a particle and to a sample is equal and opposite, and a sample's corners share it: so without
    walls, and with the one particle that nothing moves let go, the sum of m v stays, within roundings of what was exchanged.
    The vorticity's confinement, which is an outer force, is off."""
    scene = fluid_scene().replace({"water.vorticity_confinement": 0.0})
    samples, _, moving = samples_of(scene, held=False)
    start, unit = stirred(scene), scene.fluid_set.mass
    mass = unit / samples.lightness
    _, v, _, after = driven(scene, 1, precision, held=False)
    before = unit * start.velocity.sum(axis=0) + mass @ moving
    exchanged = np.abs(unit * (v - start.velocity)).sum()
    lost = unit * v.astype(float).sum(axis=0) + mass @ after.astype(float) - before
    assert np.abs(lost).max() < within * exchanged


def test_a_layer_of_samples_stands_for_what_is_behind_it() -> None:
    """Of a solid body filled with samples a rest distance apart, each is a particle of the fluid; of one layer more, so that
    it alone makes up for what is missing behind; a layer of samples half as far apart weighs as much."""
    scene = fluid_scene()
    lattice, support = scene.fluid_set.lattice, scene.fluid_set.support
    steps = np.arange(-4, 5) * D
    body = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    assert sample_volumes(body, lattice, support, True) == pytest.approx(1, abs=1e-12)
    layer, finer = body[body[:, 1] == 0], body[body[:, 1] == 0] / 2
    middle = len(layer) // 2
    volumes = [sample_volumes(one, lattice, support, False)[middle] for one in (layer, finer)]
    assert volumes[0] > 1.2
    assert 4 * volumes[1] == pytest.approx(volumes[0], rel=0.1)


def test_samples_of_triangles_have_each_place_once() -> None:
    """A square of two triangles: (n + 1)^2 places for n steps a side; each carries its share, whose sum is 1."""
    position = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    corners, shares = triangle_samples(position, np.array([[0, 1, 2], [0, 2, 3]]), 0.3)
    points = (shares[:, :, None] * position[corners]).sum(axis=1)
    steps = int(np.ceil(np.sqrt(2) / 0.3))
    assert len(points) == (steps + 1) ** 2 == len(np.unique(points.round(9), axis=0))
    assert shares.sum(axis=1) == pytest.approx(1, abs=1e-12)
    alone = particle_samples(np.array([4, 7]))
    assert alone[0].tolist() == [[4, 4, 4], [7, 7, 7]] and alone[1].sum() == 2
