"""Inflow and outflow of a fluid: layers that leave a nozzle, and regions in which particles are removed."""

from __future__ import annotations

from softlab.model.base.variant import formula, real

OPERATIONS_SINK = 12  # a particle and a sink


@formula
def passed(time, since, stop, before, rate):
    """Number of layers that have passed a nozzle by `time` [s], a real number: `before` by the time `since`, then
    `rate` [1/s] of them until `stop`."""
    return before + rate * (min(max(time, since), stop) - since)


@formula
def begun(layers):
    """Number of layers that have begun, an integer: layer k begins when more than k have passed."""
    whole = int(layers)
    return whole + 1 if real(whole) < layers else whole


@formula
def emitted(point, direction, layers, k, distance):
    """Position of a particle of layer k, one axis.

    `point`: its position in the nozzle; `layers`: number of layers emitted since; `distance`: between layers [m].
    """
    return point + direction * ((layers - real(k)) * distance)


@formula
def in_box(dx, dy, dz, hx, hy, hz):
    """True in a box. d: from its centre; h: half its edges."""
    return abs(dx) <= hx and abs(dy) <= hy and abs(dz) <= hz


@formula
def in_sphere(dx, dy, dz, radius):
    """True in a ball. d: from its centre."""
    return (dx * dx + dy * dy) + dz * dz <= radius * radius


@formula
def behind(dx, dy, dz, nx, ny, nz):
    """True behind a plane. d: from a point of the plane; n: its normal."""
    return (dx * nx + dy * ny) + dz * nz <= 0.0
