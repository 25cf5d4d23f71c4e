"""Spring terms of implicit Euler's system for a row of a cloth: forces at the step's end, or the product with a vector.

Both read a vector at each position, and a second vector that belongs to it, six planes behind.
"""

from __future__ import annotations

from collections.abc import Callable

from softlab.cpu_backend.core.layout import BLOCK, row_at
from softlab.cpu_backend.core.scratch import AXES, row_start
from softlab.cpu_backend.mass_spring.cloth.rows import k_damping, k_rest, k_stiffness, pulls_of
from softlab.model.base.variant import Open, filled, routine, row_routine
from softlab.model.formulas.implicit import end_pull_3d, product_3d

BESIDE = 2 * AXES  # planes from a vector to the one that belongs to it
pull_formula = Open("pull_formula(dx, dy, dz, wx, wy, wz, stiffness, rest, damping, dt)")


@row_routine
def pull_row(
    blocks, x, y, z, wx, wy, wz, far_x, far_y, far_z, far_wx, far_wy, far_wz, stiffness, rest, damping, dt, out_x,
    out_y, out_z,
):  # fmt: skip
    for j in range(blocks * BLOCK):
        px, py, pz = pull_formula(
            far_x[j] - x[j], far_y[j] - y[j], far_z[j] - z[j], far_wx[j] - wx[j], far_wy[j] - wy[j],
            far_wz[j] - wz[j], stiffness, rest, damping, dt,
        )  # fmt: skip
        out_x[j] = px
        out_y[j] = py
        out_z[j] = pz


@routine
def pulls(blocks, source, plane, here, there, parameters, scratch, triple, width):
    """Write, as rows.pulls, `pull_formula` of the differences of two vectors."""
    first, far = here + BESIDE * plane, there + BESIDE * plane
    pull_row(
        blocks, row_at(source, here), row_at(source, here + plane), row_at(source, here + 2 * plane),
        row_at(source, first), row_at(source, first + plane), row_at(source, first + 2 * plane),
        row_at(source, there), row_at(source, there + plane), row_at(source, there + 2 * plane),
        row_at(source, far), row_at(source, far + plane), row_at(source, far + 2 * plane), parameters[k_stiffness],
        parameters[k_rest], parameters[k_damping], parameters.dt, row_at(scratch, row_start(triple, 0, width)),
        row_at(scratch, row_start(triple, 1, width)), row_at(scratch, row_start(triple, 2, width)),
    )  # fmt: skip


@routine
def product(dx, dy, dz, wx, wy, wz, stiffness, stiffness_rest, damping, dt):
    return product_3d(dx, dy, dz, wx, wy, wz, stiffness, stiffness_rest, damping)


def end_pulls(parts: frozenset[str]) -> dict[str, Callable]:
    """Return forces at the step's end. First vector: position without the end velocity; second: that velocity."""
    return pulls_of(parts, filled(pulls, {"pull_formula": end_pull_3d}))


def products(parts: frozenset[str]) -> dict[str, Callable]:
    """Return products. First vector: position at the step's end; second: the vector to multiply."""
    return pulls_of(parts, filled(pulls, {"pull_formula": product}))
