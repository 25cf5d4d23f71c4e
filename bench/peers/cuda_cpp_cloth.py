"""The cloth in hand-written CUDA C++ (cloth.cu): compiled, launched and replayed like the grid (cuda_cpp.py)."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from softlab.bench.peers import cuda_cpp, cuda_driver
from softlab.bench.peers.base import Opened, SheetStart
from softlab.model.contact.cloth_parameters import CLOTH_PARAMETERS, cloth_record
from softlab.model.contact.sheet_plan import cloth_parts
from softlab.model.scene.scene import Scene

SOURCE = Path(__file__).with_name("cloth.cu")
TYPES = {"float32": ("-DReal=float",), "float64": ("-DReal=double",)}
KNOWN = frozenset({"structural", "shear", "bending", "damping", "gravity", "pins"})
KINDS = ("structural", "shear", "bending")


@cache
def compile_cloth(precision: str, damped: bool, architecture: str) -> bytes:
    """Return machine code of cloth.cu, by cuda_driver.compile_source."""
    return cuda_driver.compile_source(SOURCE, TYPES[precision] + damped * ("-DDAMPED",), architecture)


def cloth_refusal(scene: Scene) -> str | None:
    """Return why a peer of the cloth (springs, dampers, gravity, pins, semi-implicit Euler) cannot run the scene."""
    if scene.method.solver != "mass-spring":
        return f"it has no {scene.method.solver} solver"
    if scene.cloth is None:
        return "it supports only cloth"
    if scene.method.integrator != "semi-implicit-euler":
        return f"it supports only semi-implicit Euler, not {scene.method.integrator}"
    unknown = cloth_parts(scene) - KNOWN - {f"{kind}-damping" for kind in KINDS}
    return f"it has no {', '.join(sorted(unknown))}" if unknown else None


class ClothConstants(SheetStart):
    """Constants of a step, rounded once: the numbers that the lab's own kernels read, like base.GridConstants."""

    def __init__(self, scene: Scene, precision: str):
        super().__init__(scene, precision)
        self._record = dict(zip(CLOTH_PARAMETERS, cloth_record(scene, self.real)[0].tolist(), strict=True))
        self.damped = any(self._record[f"{kind}_damping"] > 0 for kind in KINDS)

    @property
    def in_order(self) -> tuple[float, ...]:
        """Stiffness, stiffness_rest, damping of each kind of springs; then damping, gravity, dt."""
        springs = [f"{kind}{word}" for kind in KINDS for word in ("", "_rest", "_damping")]
        return tuple(self._record[name] for name in (*springs, "damping", "gravity", "dt"))


class CudaCppCloth(cuda_cpp.CudaCpp):
    """One thread per mass, one step per launch, the launches in a graph."""

    name = "cuda_cpp_cloth"
    label = "CUDA C++ in a graph"
    scenes = ("cloth",)

    def refusal(self, scene: Scene) -> str | None:
        return cloth_refusal(scene)

    def compile(self, architecture: str) -> bytes:
        return compile_cloth("float32", False, architecture)

    def open(self, scene: Scene, precision: str, threads: int) -> Opened:
        return _Cloth(ClothConstants(scene, precision), precision)


class _Cloth(cuda_cpp.Sheet):
    function = b"cloth_step"
    vector = 4

    def _compiled(self, precision: str) -> bytes:
        return compile_cloth(precision, self.constants.damped, cuda_driver.architecture())

    def _packed(self, array: np.ndarray, is_position: bool) -> np.ndarray:
        quads = np.zeros((self.constants.count, self.vector), self.constants.real)
        quads[:, :3] = array
        if is_position:
            quads[self.constants.pinned, 3] = 1
        return quads
