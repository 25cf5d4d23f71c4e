"""Where masses differ, the lightest one sets what step sizes hold, told and measured by the references."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
import pytest
from bodies_scenes import AWAY

from softlab.bench.reference import shape_matching, xpbd, xpbd_mesh
from softlab.bench.reference.steps import masses
from softlab.model.core.build import build
from softlab.model.core.families import stability_limit
from softlab.model.core.integrators import frequency_bound, lightest_mass
from softlab.model.core.stability.limit import scene_frequency, scene_net
from softlab.model.scene.scene import Scene

SLACK = {"stiffness": 1e-12}  # N/m: what holds a mass does not matter
METHOD = {"solver": "xpbd", "dt": 0.001, "substeps": 2}


def loaded(**load: Any) -> Scene:
    light = {"kind": "load", "at": [1, 1], "mass": 0.01} | load
    sheet = {"rows": 3, "columns": 3, "mass": 1.0, "pinned": [[0, 0]]}
    return Scene({"grid": sheet, "springs": SLACK, "light": light, "damping": {"coefficient": 1.0}, "method": METHOD})


def by_area() -> Scene:
    sheet = {"shape": "sheet", "rows": 3, "columns": 3, "spacing": 0.2, "density": 0.3, "pinned": [[0, 0]]}
    return Scene({"mesh": sheet, "structural": SLACK, "damping": {"coefficient": 0.5}, "method": METHOD})


def soft_sheet() -> Scene:
    sheet = {
        "kind": "soft_sheet", "shape": {"name": "sheet", "resolution": 3}, "particle_spacing": 0.3,
        "cluster_stiffness": 0.0, "link_stiffness": 1e-12,
    }  # fmt: skip
    method = METHOD | {"solver": "shape-matching"}
    return Scene({"sheet": sheet, "plane": AWAY, "damping": {"coefficient": 0.5}, "method": method})


def speeds(scene: Scene, steps: int) -> np.ndarray:
    """(particles,) [m/s] after so many steps, begun at 1 mm/s."""
    position, inverse_mass = build(scene).position, build(scene).inverse_mass
    velocity = np.full_like(position, 1e-3) * (inverse_mass > 0)[:, None]
    if scene.bodies:
        moved = shape_matching.simulate(scene, steps, position, velocity)
    elif scene.mesh:
        mass = 1 / np.where(inverse_mass > 0, inverse_mass, np.inf)
        mass[inverse_mass == 0] = 1.0
        moved = xpbd_mesh.simulate(scene, steps, position, velocity, mass)
    else:
        heavy = np.broadcast_to(masses(scene), (scene.grid.rows, scene.grid.columns, 1)).ravel()
        moved = xpbd.simulate(scene, steps, position, velocity, substeps=scene.method.substeps, masses=heavy)
    return np.abs(moved[1]).max(axis=1)


@pytest.mark.parametrize(
    ("scene", "lightest"),
    # a corner with one triangle has a sixth of a cell, and so has the sheet's of 1 m and 0.2 kg/m^2, whose cells are a third
    [(loaded(), 0.01), (by_area(), 0.3 * 0.2**2 / 6), (soft_sheet(), 0.2 / 9 / 6)],
    ids=["load", "density", "soft sheet"],
)
def test_the_lightest_mass_sets_the_limit(scene: Scene, lightest: float) -> None:
    """h c/m < 2: in a substep a mass that nothing holds keeps 1 - h c/m of its speed. 0.98 of the limit leaves 0.96 of it,
    1.05 of it makes 1.1: of 50 substeps 0.13 and 117."""
    limit = stability_limit(scene)
    assert limit == pytest.approx(2 * 2 * lightest / scene.damping.coefficient, rel=1e-9)
    under, over = (speeds(scene.replace({"method.dt": side * limit}), 25).max() / 1e-3 for side in (0.98, 1.05))
    assert under < 1 and over == pytest.approx(1.1**50, rel=1e-6)


def test_pinned_masses_do_not_count() -> None:
    assert lightest_mass(loaded(at=[0, 0])) == 1.0
    assert lightest_mass(loaded(mass=5.0)) == 1.0
    assert lightest_mass(loaded(mass=5.0).replace({"grid.rows": 1, "grid.columns": 2, "light.at": [0, 1]})) == 5.0
    assert lightest_mass(loaded().replace({"grid.pinned": "edges", "light.at": [0, 1]})) == 1.0


@pytest.mark.parametrize("load", [0.01, 20.0])
@pytest.mark.parametrize("ratio", [1.0, 50.0])
def test_frequencies_of_nets_with_loads(load: float, ratio: float) -> None:
    """The estimate is the largest one of the dense matrix, and no bound lies below it."""
    scene = loaded(mass=load).replace({"springs.stiffness": 30.0, "springs.stiffness_ratio": ratio})
    net = scene_net(scene)
    dense = np.stack([net.apply(row) for row in np.eye(9)])
    own = np.repeat([1.0, 1 / load, 1.0], [4, 1, 4])
    own[0] = 0
    k = 30.0 * np.array([2 + 2 * ratio])  # of the loaded mass's four springs
    assert dense[4, 4] == pytest.approx(k[0] * own[4])
    exact, found = sqrt(np.linalg.eigvalsh(dense)[-1]), scene_frequency(scene)
    assert found.estimate == pytest.approx(exact, rel=1e-6)
    assert exact <= found.upper * (1 + 1e-9) and exact <= frequency_bound(scene) * (1 + 1e-9)
