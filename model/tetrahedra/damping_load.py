"""Damping of tetrahedra that the sweeps of a substep do not resolve: it then supports static loads."""

from __future__ import annotations

import numpy as np

from softlab.model.contact.surface_parameters import contact_surface
from softlab.model.scene.scene import Scene

UNRESOLVED = 5.0  # of `damping_load`: there a ball's lowest tetrahedra have 0.4 of their rest volume, not 0.75


def damping_load(scene: Scene) -> np.ndarray:
    """Return tau h E / (rho e^2) over the iterations of a substep h [s], (bodies,); e [m]: the mean edge of a body's
    surface.

    A damper of the time tau is tau/h times as stiff as its element, whose own stiffness over the masses is E h^2 / (rho
    e^2) (M. Macklin et al., "XPBD", MIG 2016, eq. 26: gamma = tau/h). Sweeps visit elements one after the other: a
    damper undoes the motion of earlier projections, and the difference is a force that acts at rest, too. It grows and
    vanishes with this number.
    """
    body_set, method = scene.tetrahedra_set, scene.method
    h = method.dt / method.substeps
    edge = contact_surface(body_set).edge[: len(body_set.parts)]
    viscosity = np.array([part.damping * part.young_modulus / part.density for part in body_set.parts])
    return viscosity * h / (edge**2 * method.iterations)


def damping_lines(scene: Scene) -> list[str]:
    """Return a sentence where bodies of xpbd have more damping than their sweeps resolve."""
    if not scene.tetrahedra or scene.method.solver != "xpbd":
        return []
    load = damping_load(scene)
    worst = int(np.argmax(load))
    if not load[worst] > UNRESOLVED:
        return []
    name, part = scene.tetrahedra_set.names[worst], scene.tetrahedra_set.parts[worst]
    others = int((load > UNRESOLVED).sum()) - 1
    more = f" (and of {others} more)" if others else ""
    return [
        f"{name}.damping = {part.damping:g} s{more} is more than the sweeps of a substep resolve: dampers then "
        "support static loads, so that the body is flatter than its stiffness says and may stay inverted; reduce it to "
        f"{part.damping / load[worst]:.2g} s, or take {int(np.ceil(load[worst]))} times as many substeps or iterations"
    ]
