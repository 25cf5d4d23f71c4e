"""Wind on a vertex of a mesh, compiled by both backends."""

from __future__ import annotations

from softlab.model.base.variant import Open, inlined_routine
from softlab.model.formulas.wind import wind_on_triangle

row = Open("row(array, k) -> (x, y, z)")
corners_of = Open("corners_of(corners, triangle) -> (a, b, c)")


@inlined_routine
def wind_of(k, air, position, velocity, parameters, wind_lists):
    """Return the wind over the sheet's mass [m/s^2] on vertex k, summed over its triangles in their order.

    `wind_lists`: (offsets, triangles at each vertex, corners of triangles).
    """
    offsets, at_vertex, corners = wind_lists
    x, y, z = 0.0, 0.0, 0.0
    for n in range(offsets[k], offsets[k + 1]):
        a, b, c = corners_of(corners, at_vertex[n])
        fx, fy, fz = wind_on_triangle(
            row(position, a), row(position, b), row(position, c), row(velocity, a), row(velocity, b), row(velocity, c),
            air, parameters.drag, parameters.lift,
        )  # fmt: skip
        x, y, z = x + fx, y + fy, z + fz
    return x, y, z
