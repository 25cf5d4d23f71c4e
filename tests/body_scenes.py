"""Small scenes of bodies, for the tests of what a user sees of them."""

from __future__ import annotations

from typing import Any

from model.scene import Scene

BEAM: dict[str, Any] = {
    "kind": "soft_body", "shape": {"name": "beam", "resolution": 16}, "particle_spacing": 0.12,
    "cluster_stiffness": 500.0, "origin": [0.2, 1.0, -0.1], "angle": 30.0, "axis": [0.0, 1.0, 0.4], "copies": [2, 1, 1],
    "apart": [1.5, 1.0, 1.0],
}  # fmt: skip
TORUS: dict[str, Any] = {
    "kind": "rigid_body", "shape": {"name": "torus", "resolution": 16}, "particle_spacing": 0.15, "origin": [0.0, 2.2, 0.0],
    "angle": 90.0, "axis": [1.0, 0.0, 0.0],
}  # fmt: skip
METHOD = {"solver": "shape-matching", "dt": 0.005, "substeps": 2}
PLANE = {"plane": {"point": [0.0, 0.0, 0.0]}}


def beams_and_torus(**parts: Any) -> Scene:
    """Two soft beams beside each other and a rigid torus above them."""
    return Scene(
        {"title": "Bodies", "beam": BEAM, "torus": TORUS, "gravity": {}, "method": METHOD} | parts, name="bodies"
    )
