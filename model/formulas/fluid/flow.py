"""Inflow and outflow of a fluid: layers that leave a nozzle, and regions in which particles are removed."""

from __future__ import annotations

from types import SimpleNamespace

from softlab.model.formulas import plain

OPERATIONS_SINK = 12  # a particle and a sink


def make(real, compiled=plain):
    """Make the functions of emitters and sinks in the arithmetic `real`."""
    zero = real(0)

    @compiled
    def passed(time, since, stop, before, rate):
        """Number of layers that have passed a nozzle by `time` [s], a real number: `before` by the time `since`, then
        `rate` [1/s] of them until `stop`."""
        return before + rate * (min(max(time, since), stop) - since)

    @compiled
    def begun(layers):
        """Number of layers that have begun, an integer: layer k begins when more than k have passed."""
        whole = int(layers)
        return whole + 1 if real(whole) < layers else whole

    @compiled
    def emitted(point, direction, layers, k, distance):
        """Position of a particle of layer k, one axis.

        `point`: its place in the nozzle; `layers`: how many have passed; `distance`: between layers [m].
        """
        return point + direction * ((layers - real(k)) * distance)

    @compiled
    def in_box(dx, dy, dz, hx, hy, hz):
        """True in a box. d: from its centre; h: half its edges."""
        return abs(dx) <= hx and abs(dy) <= hy and abs(dz) <= hz

    @compiled
    def in_sphere(dx, dy, dz, radius):
        """True in a ball. d: from its centre."""
        return (dx * dx + dy * dy) + dz * dz <= radius * radius

    @compiled
    def behind(dx, dy, dz, nx, ny, nz):
        """True behind a plane. d: from a point of the plane; n: its normal."""
        return (dx * nx + dy * ny) + dz * nz <= zero

    return SimpleNamespace(
        passed=passed, begun=begun, emitted=emitted, in_box=in_box, in_sphere=in_sphere, behind=behind
    )
