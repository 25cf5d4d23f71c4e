"""Free fall and straight flight."""

from __future__ import annotations

import numpy as np
from lab import GRAVITY, Lab, farthest, start
from law import of
from rows import Row

STEPS = 8


def fallen(row: Row, steps: int) -> float:
    """[m]: how far a scheme lets a point fall, in closed form (docs/method/cases.md, A2). A step of semi-implicit Euler
    adds g h to the velocity before it moves: g h^2 n(n+1)/2 in n substeps. The hand-out's step takes half of it.
    Explicit Euler moves first: g h^2 n(n-1)/2. Schemes of second order have g t^2/2 exactly."""
    h, n = row.h, steps * row.bare.method.substeps
    return (
        GRAVITY
        * {
            "substeps": h * h * n * (n + 1) / 2,
            "half": h * h * n * (n + 1) / 4,
            "late": h * h * n * (n - 1) / 2,
            "exact": (h * n) ** 2 / 2,
        }[row.fall]
    )


@of("fall")
def test_free_fall_and_straight_flight(row: Row, case: str, lab: Lab) -> None:
    """y = -g h^2 n(n+1)/2 (or the scheme's own closed form), the same for every particle: no strain.

    Each substep rounds velocities to `noise` (what an ulp of the largest coordinate is over h); n of them, each of
    which moves a particle for the rest of the time t, add up to n * noise * t at most. Constraints at rest are
    projected by what rounding leaves of them, `iterations` times a substep."""
    velocity = [0.5, -0.25, 0.125][: row.dimensions] if case != "fall" else [0.0] * row.dimensions
    scene = row.scene(gravity={"acceleration": GRAVITY}) if case == "fall" else row.bare
    begin, changed = start(scene, velocity=velocity), case == "flight while dt changes"
    with lab.open(scene, begin, ["dt"] if changed else ()) as simulation:
        first, time = simulation.state(), 0.0
        for step in range(STEPS):
            dt = scene.method.dt * (1, 0.5, 0.75)[step % 3] if changed else scene.method.dt
            if changed:
                simulation.set("method.dt", dt)
            simulation.advance(1)
            time += dt
        last = simulation.state()
    moved = np.asarray(last.position, np.float64) - first.position
    expected = np.asarray(velocity) * time
    if case == "fall":
        expected[1] -= fallen(row, STEPS)
    substeps = STEPS * scene.method.substeps
    bound = substeps * (1 + scene.method.iterations) * lab.noise(scene, first, last) * time
    assert farthest(moved - expected) <= bound, (moved, expected, bound)
