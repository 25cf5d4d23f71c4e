"""Weight of xpbd tetrahedra on colliders, which push after the solve of a substep: how far it shortens the lowest ones."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from softlab.model.contact.surface_parameters import contact_surface
from softlab.model.scene.scene import Scene

SAG = 0.03  # of `contact_sag`: up to it cubes of 2 to 4 voxels stick on slopes of tan a = 0.9 mu, mu up to 0.5


def contact_sag(scene: Scene) -> np.ndarray:
    """Return 2 g h^2 H / e^2 of each body, (bodies,): the additional strain of its lowest elements at rest.

    Within a substep h, elements push the particles that lie on a collider, of the mass m_l, down by the weight M g: by
    g h^2 M/m_l. Then the collider puts them back, as a spring of m_l / h^2 would. In a body of the height H, with the
    mean edge e of its surface, M/m_l is 2 H/e: half of each element's mass lies at its lower end.
    """
    tetrahedra_set, method = scene.tetrahedra_set, scene.method
    gravity = scene.gravity.acceleration if scene.gravity is not None and scene.gravity.enabled else 0.0
    ends = np.append(tetrahedra_set.first_particle, tetrahedra_set.particle_count)[: len(tetrahedra_set.parts) + 1]
    height = np.array([np.ptp(tetrahedra_set.position[a:b, 1]) for a, b in pairwise(ends)])
    edge = contact_surface(tetrahedra_set).edge[: len(tetrahedra_set.parts)]
    return 2 * abs(gravity) * (method.dt / method.substeps) ** 2 * height / edge**2


def sag_lines(scene: Scene) -> list[str]:
    """Return a sentence where the weight of an xpbd body shortens its lowest elements by more than SAG on colliders."""
    if not scene.tetrahedra or scene.method.solver != "xpbd" or not scene.colliders:
        return []
    sag = contact_sag(scene)
    worst = int(np.argmax(sag))
    if not sag[worst] > SAG:
        return []
    substeps = int(np.ceil(scene.method.substeps * (sag[worst] / SAG) ** 0.5))
    return [
        f"{scene.tetrahedra_set.names[worst]}: colliders push after the solve of a substep, so that on them its weight "
        f"shortens the lowest elements by up to {100 * sag[worst]:.0f} % more than their stiffness says; it rebounds from "
        f"that, and may slide or tip over where friction would hold it; use method.substeps = {substeps} or larger edges"
    ]
