"""The part `self_collision`: collisions of a cloth with itself."""

from __future__ import annotations

from pydantic import model_validator

from softlab.model.base.table import NotNegative, Part, Positive, Sweeps
from softlab.model.tables.parts import friction_is_ordered

MAX_CONTACTS = 12  # of one mass with triangles; the nearest are used, those beyond are counted
# Largest host memory per mass: each contact's triangle, corners, links, values and forces; its cell of space and
# scratch; the triangles around it.
CONTACT_BYTES = MAX_CONTACTS * (4 * (1 + 3 + 3) + 8 * (7 + 4)) + 176 + 4 * (1 + 6 + 6)


class SelfCollision(Part):
    """Collisions of the cloth with itself: a mass keeps `thickness` from the sheet's triangles, with Coulomb friction.

    Every substep searches for the triangles that a mass may approach within it and keeps the mass on its current side.
    Masses that begin nearer than the thickness are moved apart at `separation_speed` at most, so that an overlap does
    not create high speeds; too low a speed lets a heavy pile sink. A sweep carries a push from one layer to the next.
    Edges that cross without a mass near a triangle are not detected; model/contact/penetration.py counts them.
    """

    thickness: Positive = 0.01  # m, between two layers; at most the sheet's spacing
    static_friction: NotNegative = 0.3
    dynamic_friction: NotNegative = 0.2  # at most static_friction
    separation_speed: Positive = 0.5  # m/s
    sweeps: Sweeps = 4  # over all contacts, after each iteration over the constraints

    _friction_is_ordered = model_validator(mode="after")(friction_is_ordered)
