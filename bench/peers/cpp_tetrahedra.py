"""Position-based tetrahedra in C++ with OpenMP (tetrahedra.cpp): the lab's own constraints, in the lab's order."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np

from softlab.bench.peers.base import Opened
from softlab.bench.peers.compiler import load_library
from softlab.bench.peers.cpp_openmp import CppOpenmp
from softlab.bench.peers.scenes import SCENES
from softlab.model.core.build import build
from softlab.model.core.simulation import PRECISIONS
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.constraints import CONSTANTS, constraint_sets, tetrahedra_parts
from softlab.model.tetrahedra.family import tetrahedra_record

SOURCE = Path(__file__).with_name("tetrahedra.cpp")
KNOWN = frozenset({"neo-hookean", "gravity", "pins", "load", "gauss-seidel"})


class CppTetrahedra(CppOpenmp):
    """A sweep over the colours per substep, a parallel loop each."""

    name = "cpp_openmp_tetrahedra"
    scenes = ("tetrahedra",)

    def refusal(self, scene: Scene) -> str | None:
        if not scene.tetrahedra or scene.method.solver != "xpbd":
            return "it supports only position-based tetrahedra"
        if scene.method.iterations > 1 or len(constraint_sets(scene)) > 1:
            return "it supports one iteration per substep of one set of constraints"
        unknown = tetrahedra_parts(scene) - KNOWN
        return f"it has no {', '.join(sorted(unknown))}" if unknown else None

    def bound(self, scene: Scene, precision: str) -> float:
        """Return the rounding error of the positions [spacings].

        A coordinate is rounded by half a unit of its last digit in each of n substeps, which adds to the velocity and
        stays: about n^1.5 such halves, since they have either sign.
        """
        substeps = SCENES["tetrahedra"].check_steps * scene.method.substeps
        half = float(np.finfo(precision).eps) / 2 * scene.tetrahedra_set.extent
        return half * substeps**1.5 / scene.grid.spacing

    def open(self, scene: Scene, precision: str, threads: int) -> Opened:
        return _Bodies(scene, precision, threads)


class _Bodies(Opened):
    kernel = "one loop a colour"

    def __init__(self, scene: Scene, precision: str, threads: int):
        self.threads, self._substeps = threads, scene.method.substeps
        real: Any = PRECISIONS[precision]
        (self._set,) = constraint_sets(scene)
        body, record = build(scene), tetrahedra_record(scene, real)[0]
        self._corners, self._starts = self._set.corners.astype(np.int32), self._set.starts.astype(np.int64)
        self._values = np.ascontiguousarray(self._set.values, real)
        self._arrays = np.zeros((3, len(body.position), 4), real)  # positions, velocities, previous positions
        self._arrays[0, :, 3] = body.inverse_mass * scene.grid.mass
        self._numbers = np.array([record[name] for name in ("dt", "gravity", CONSTANTS[0], "inverse_substep")], float)
        if "gravity" not in tetrahedra_parts(scene):
            self._numbers[1] = 0.0
        library = load_library(SOURCE)
        self._advance = getattr(library, f"advance_{precision}")
        self._advance.argtypes = [*[ctypes.c_int64] * 4, *[ctypes.c_void_p] * 7, ctypes.c_int]
        self._advance.restype = None
        self.load(body.position, body.velocity)

    def advance(self, steps: int) -> None:
        arrays = (*self._arrays, self._corners, self._values, self._starts, self._numbers)
        self._advance(
            steps * self._substeps, self._arrays.shape[1], self._set.colours, self._set.run,
            *(array.ctypes.data for array in arrays), self.threads or 1,
        )  # fmt: skip

    def synchronize(self) -> None:
        """Return at once, since a call returns when its steps are done."""

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._arrays[0, :, :3], self._arrays[1, :, :3] = position, velocity

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        return self._arrays[0, :, :3].copy(), self._arrays[1, :, :3].copy()
