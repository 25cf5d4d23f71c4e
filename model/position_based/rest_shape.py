"""Conditions of a bending model on a mesh's rest shape."""

from __future__ import annotations

import math

import numpy as np

from softlab.model.base.errors import SceneError

LARGEST_ANGLE = 1.0  # degrees: allowed by the digits of a file and the accuracy of its author


def check_flat(bending: str, tangents: np.ndarray) -> None:
    """Raise SceneError for hinges that are bent at rest, `tangents` (hinges,) tan(theta/4), under `isometric` of the
    part `bending`.

    Its energy (M. Bergou et al., "A Quadratic Bending Model for Inextensible Surfaces", SGP 2006, for surfaces that are
    flat at rest) depends on the size of a hinge's angle, not its sign, and has no slope where the hinge is flat: a
    hinge bent at rest and released flat stays flat, one folded through rests on the wrong side.
    """
    largest = math.degrees(4 * math.atan(np.abs(tangents).max(initial=0.0)))
    if largest > LARGEST_ANGLE:
        raise SceneError(
            f"{bending}.model",
            "isometric",
            f"applies to meshes that are flat at rest; this one has a hinge bent by {largest:.3g} degrees: "
            f"--set {bending}.model=dihedral holds rest angles",
        )
