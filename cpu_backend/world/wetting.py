"""Absorption of a fluid by a cloth, on CPU threads (model/world/plan.py, `soak`)."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.simulation import WIDTH, QuadsSimulation
from softlab.cpu_backend.fluid.among_solids import FluidAmongSolids
from softlab.model.fluid.among_solids import K_LIGHTNESS
from softlab.model.fluid.samples import CORNERS
from softlab.model.formulas.fluid import wetting
from softlab.model.scene.scene import Scene
from softlab.model.world.wetting import drinkers_of, rates_of


@cache
def make_soak(real: Any, math: str) -> SimpleNamespace:
    """Compile `soak`, `weigh` and `share`.

    `soak(bands, wetness, first, offsets, samples, slots, neighbours, rates)`; `weigh(bands, wetness, first, vertices,
    weight, dry, rates, position, lightness)`; `share(bands, corners, shares, lightness, own)`: for every sample.
    """
    compiler = Compiler(f"wetting_{np.dtype(real).name}_{math}", math)
    f = wetting.make(real, compiler.compiled)
    soaked, lighter, given_way = f.soaked, f.lighter, f.given_way

    def soak(band, bands, wetness, first, offsets, samples, slots, neighbours, rates):
        for k in range(wetness.size * band // bands, wetness.size * (band + 1) // bands):
            touched = False
            for e in range(offsets[first + k], offsets[first + k + 1]):
                touched = touched or neighbours[slots[samples[e]]] > 0
            wetness[k] = soaked(wetness[k], touched, rates[0], rates[1])

    def weigh(band, bands, wetness, first, vertices, weight, dry, rates, position, lightness):
        for k in range(wetness.size * band // bands, wetness.size * (band + 1) // bands):
            position[vertices[k], WIDTH - 1] = lighter(weight[k], wetness[k], rates[2])
            lightness[first + k] = lighter(dry[k], wetness[k], rates[2])

    def share(band, bands, corners, shares, lightness, own):
        for s in range(own.size * band // bands, own.size * (band + 1) // bands):
            at = CORNERS * s
            own[s] = given_way(
                shares[at], shares[at + 1], shares[at + 2], lightness[corners[at]], lightness[corners[at + 1]],
                lightness[corners[at + 2]],
            )  # fmt: skip

    return SimpleNamespace(**{each.__name__: compiler.banded(each) for each in (soak, weigh, share)})


class Wetting:
    """Wetting of a world's `cloth` in its `fluid`. `wetness` (n,): of the cloth's `vertices` that carry samples."""

    def __init__(self, scene: Scene, cloth: QuadsSimulation, fluid: FluidAmongSolids, math: str):
        found, real = drinkers_of(scene), cloth.real
        self.vertices, self._first, self._bands = found.vertices, found.first, cloth._bands
        self.wetness, self._kept = np.zeros(len(found.vertices), real), np.zeros(len(found.vertices), real)
        self._weight = cloth._position[found.vertices, WIDTH - 1].copy()
        self._dry, self._rates, self._kernels = found.lightness.astype(real), np.zeros(3, real), make_soak(real, math)
        self._cloth, self._neighbours = cloth, fluid._world.lists.neighbours
        _, by_number, _, self._slots, self._points, _, carriers, _ = fluid._met
        self._lightness, self._offsets, self._samples, _ = carriers
        count, begin = fluid._particles, len(fluid.body.position)
        self._own = by_number[K_LIGHTNESS * count + begin : (K_LIGHTNESS + 1) * count]
        self.change(scene)

    def change(self, scene: Scene) -> None:
        """Apply the rates of a scene whose numbers have changed."""
        self._rates[:] = rates_of(scene)

    def soak(self) -> None:
        """Update the wetness at a substep's end."""
        given = self._offsets, self._samples, self._slots, self._neighbours, self._rates
        self._kernels.soak(self._bands, self.wetness, self._first, *given)
        self.weigh()

    def weigh(self) -> None:
        """Update weights and lightness from the wetness."""
        given = self.vertices, self._weight, self._dry, self._rates, self._cloth._position, self._lightness
        self._kernels.weigh(self._bands, self.wetness, self._first, *given)
        self._kernels.share(self._bands, *self._points, self._lightness, self._own)

    def keep(self) -> None:
        """Save the wetness."""
        self._kept[:] = self.wetness

    def restore(self) -> None:
        """Restore the saved wetness."""
        self.wetness[:] = self._kept
        self.weigh()

    def tell(self) -> np.ndarray:
        """Return the wetness (n,)."""
        return self.wetness.copy()

    def take(self, wetness: np.ndarray) -> None:
        """Replace the wetness by another (n,)."""
        self.wetness[:] = wetness
        self.weigh()
