"""Absorption of a fluid by a cloth, on CUDA (model/world/plan.py, `soak`); one thread per particle of the cloth, then
one per sample."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.core.substeps import SubstepSimulation
from softlab.gpu_backend.fluid.among_solids import COUNTED, FluidAmongSolids
from softlab.model.fluid.among_solids import K_LIGHTNESS
from softlab.model.fluid.samples import CORNERS
from softlab.model.formulas.fluid import wetting
from softlab.model.scene.scene import Scene
from softlab.model.world.wetting import drinkers_of, rates_of


@cache
def make_soak(real: Any, math: str) -> SimpleNamespace:
    """Compile `soak`, `weigh` and `share`.

    `soak(wetness, first, offsets, samples, slots, found, rates)`; `weigh(wetness, first, vertices, weight, dry, rates,
    position, lightness)`; `share(corners, shares, lightness, begin, kinds)`: for every sample, from index `begin` of
    `kinds` on.
    """
    f = device_formulas(wetting.make, real, math)
    soaked, lighter, given_way = f.soaked, f.lighter, f.given_way
    corners_each, last = np.int32(CORNERS), np.int32(SIZE - 1)

    def soak(wetness, first, offsets, samples, slots, found, rates):
        k = np.int32(cuda.grid(1))  # type: ignore[call-arg]
        if k < wetness.size:
            touched = False
            for e in range(offsets[first + k], offsets[first + k + 1]):
                touched = touched or found[slots[samples[e]]] > 0
            wetness[k] = soaked(wetness[k], touched, rates[0], rates[1])

    def weigh(wetness, first, vertices, weight, dry, rates, position, lightness):
        k = np.int32(cuda.grid(1))  # type: ignore[call-arg]
        if k < wetness.size:
            position[SIZE * np.int64(vertices[k]) + last] = lighter(weight[k], wetness[k], rates[2])
            lightness[first + k] = lighter(dry[k], wetness[k], rates[2])

    def share(corners, shares, lightness, begin, kinds):
        s = np.int32(cuda.grid(1))  # type: ignore[call-arg]
        if s < corners.size // corners_each:
            at = np.int32(s * corners_each)
            kinds[begin + s] = given_way(
                shares[at], shares[at + 1], shares[at + 2], lightness[corners[at]], lightness[corners[at + 1]],
                lightness[corners[at + 2]],
            )  # fmt: skip

    return make_kernels((soak, weigh, share), f"wetting_{variant_name(real, math)}", **kernel_options(math))


class Wetting:
    """Wetting of a world's cloth in its fluid, as in cpu_backend/world/wetting.py."""

    launches = 3  # of `soak`

    def __init__(self, scene: Scene, cloth: SubstepSimulation, fluid: FluidAmongSolids, math: str):
        found, real, new = drinkers_of(scene), cloth.real, cloth.on_device
        self.vertices, self._first, self._real = found.vertices, np.int32(found.first), real
        self._cloth, self._fluid, self._kernels = cloth, fluid, make_soak(real, math)
        empty = np.zeros(len(found.vertices), real)
        self.wetness, self._kept, self._rates = new(empty), new(empty), new(np.zeros(3, real))
        self._own, self._dry = new(found.vertices.astype(np.int32)), new(found.lightness.astype(real))
        self._weight = new(cloth._weight[found.vertices])
        count, fluids = fluid.particle_count, len(fluid.body.position)
        self._begin = np.int64(K_LIGHTNESS * count + fluids)
        self._each = -(-len(found.vertices) // COUNTED), COUNTED, cloth.stream
        self._samples = -(-(count - fluids) // COUNTED), COUNTED, cloth.stream
        self.change(scene)

    def change(self, scene: Scene) -> None:
        """Apply the rates of a scene whose numbers have changed."""
        self._rates.copy_to_device(rates_of(scene).astype(self._real), stream=self._cloth.stream)

    def soak(self) -> None:
        """Update the wetness at a substep's end."""
        fluid = self._fluid
        _, offsets, samples, _ = fluid._carriers
        given = offsets, samples, fluid._slots, fluid.cells.found, self._rates
        self._kernels.soak[self._each](self.wetness, self._first, *given)
        self.weigh()

    def weigh(self) -> None:
        """Update weights and lightness from the wetness."""
        cloth, fluid = self._cloth, self._fluid
        position, lightness = cloth.position[cloth._current], fluid._carriers[0]
        given = self._own, self._weight, self._dry, self._rates, position, lightness
        self._kernels.weigh[self._each](self.wetness, self._first, *given)
        self._kernels.share[self._samples](*fluid._points, lightness, self._begin, fluid._kinds)

    def keep(self) -> None:
        """Save the wetness."""
        self._kept.copy_to_device(self.wetness, stream=self._cloth.stream)

    def restore(self) -> None:
        """Restore the saved wetness."""
        self.wetness.copy_to_device(self._kept, stream=self._cloth.stream)
        self.weigh()

    def tell(self) -> np.ndarray:
        """Return the wetness (n,)."""
        host = self.wetness.copy_to_host(stream=self._cloth.stream)
        self._cloth.synchronize()
        return np.asarray(host)

    def take(self, wetness: np.ndarray) -> None:
        """Replace the wetness by another (n,)."""
        self.wetness.copy_to_device(np.ascontiguousarray(wetness, self._real), stream=self._cloth.stream)
        self.weigh()
        self._cloth.synchronize()
