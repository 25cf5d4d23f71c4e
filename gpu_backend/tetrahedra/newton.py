"""Implicit tetrahedral bodies on CUDA: not there yet."""

from __future__ import annotations

from gpu_backend.tetrahedra.solver import Tetrahedra
from model.core.errors import BackendUnavailable
from model.core.simulation import Options
from model.scene.scene import Scene


class TetrahedraNewton(Tetrahedra):
    """Raises BackendUnavailable."""

    def __init__(self, scene: Scene, options: Options):
        raise BackendUnavailable(
            "the solver newton has no CUDA kernels yet",
            "--backend cpu runs it, --set method.solver=xpbd runs the scene on the GPU",
        )
