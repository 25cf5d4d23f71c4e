"""How a fluid comes and goes: layers that leave a nozzle, and places in which particles end."""

from __future__ import annotations

from types import SimpleNamespace

from model.formulas import plain

OPERATIONS_SINK = 12  # a particle and a sink


def make(real, compiled=plain):
    """See the functions; in the arithmetic `real`."""
    zero = real(0)

    @compiled
    def passed(time, since, stop, before, rate):
        """How many layers have passed a nozzle by `time` [s], a real number: `before` by the time `since`, then `rate`
        [1/s] of them, until `stop`."""
        return before + rate * (min(max(time, since), stop) - since)

    @compiled
    def begun(layers):
        """How many layers began, of so many that have passed, as a whole number: layer k does when more than k have."""
        whole = int(layers)
        return whole + 1 if real(whole) < layers else whole

    @compiled
    def emitted(point, way, layers, k, distance):
        """One axis of where a particle of layer k is, whose place in the nozzle is `point`, when so many `layers` have
        passed, `distance` [m] from each other."""
        return point + way * ((layers - real(k)) * distance)

    @compiled
    def in_box(dx, dy, dz, hx, hy, hz):
        """d: from the box's centre; h: half its edges."""
        return abs(dx) <= hx and abs(dy) <= hy and abs(dz) <= hz

    @compiled
    def in_sphere(dx, dy, dz, radius):
        """d: from its centre."""
        return (dx * dx + dy * dy) + dz * dz <= radius * radius

    @compiled
    def behind(dx, dy, dz, nx, ny, nz):
        """d: from a point of the plane; n: its normal."""
        return (dx * nx + dy * ny) + dz * nz <= zero

    return SimpleNamespace(
        passed=passed, begun=begun, emitted=emitted, in_box=in_box, in_sphere=in_sphere, behind=behind
    )
