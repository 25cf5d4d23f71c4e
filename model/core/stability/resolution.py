"""Precision too coarse for a scene's location: far from the origin a substep's fall is lost in rounding."""

from __future__ import annotations

import numpy as np

from softlab.model.base.types import Real
from softlab.model.core.build import build, starts
from softlab.model.core.options import PRECISIONS
from softlab.model.scene.scene import Scene

FRAME = 1 / 60  # s: a velocity stored beside the position grows for this long before its displacement must be visible


def resolution_line(scene: Scene, precision: str) -> str | None:
    """Return a sentence where gravity is lost in the rounding of positions, None where it is not or nothing falls.

    Position-based solvers compute velocities from displacements: a particle at rest moves by g h^2 in a substep h, and
    does not fall where adjacent numbers at its height differ by more (an ulp). A separately stored velocity grows
    meanwhile: there the displacement after a FRAME, g h FRAME, counts.
    """
    gravity = scene.gravity.acceleration if scene.gravity is not None and scene.gravity.enabled else 0.0
    method = scene.method
    h = method.dt / method.substeps
    fall = abs(gravity) * h * (h if method.position_based else max(h, FRAME))
    if not fall:
        return None
    height = float(np.abs(starts(scene, build(scene).position)[:, 1]).max())
    with np.errstate(over="ignore"):
        real: Real = PRECISIONS[precision]
        ulp = float(np.spacing(real(height)))
    if not ulp > fall:
        return None
    remedy = "--precision float64, " if precision == "float32" else ""
    fewer = "fewer substeps" if method.position_based and method.substeps > 1 else "a larger method.dt"
    return (
        f"{precision} is too coarse for this place: {height:.4g} m from the origin, along y, neighbouring numbers are "
        f"{ulp:.2g} m apart, and gravity moves what rests by {abs(gravity) * h * h:.2g} m in {h:.2g} s: it hangs in the "
        f"air or falls in jumps; use {remedy}a place nearer to the origin, or {fewer}"
    )
