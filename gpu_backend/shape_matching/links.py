"""Links on CUDA: their arrays, and their projections colour by colour."""

from __future__ import annotations

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.constraints import make_projections
from softlab.gpu_backend.core.device import DeviceArray, Stream
from softlab.gpu_backend.core.quads import pack
from softlab.gpu_backend.shape_matching.kernels import THREADS
from softlab.model.base.types import Real
from softlab.model.particles.body_set import BodySet
from softlab.model.particles.links import LINKS
from softlab.model.tables.method import Method


class DeviceLinks:
    """Links of the bodies of `body_set`, if any has some."""

    def __init__(self, body_set: BodySet, method: Method, real: Real, math: str, stream: Stream):
        self._body_set, self._real, self._stream, self._starts = body_set, real, stream, body_set.links.starts
        self._project = make_projections(real, math, LINKS)
        ends, values = pack(body_set.links.ends), self._of(method)
        zeros: np.ndarray = np.zeros(body_set.links.count, real)
        self._ends, self._values, self._multipliers = (
            cuda.to_device(array, stream=stream) for array in (ends, values, zeros)
        )

    def _of(self, method: Method) -> np.ndarray:
        """Return (2 * links,): rest lengths, compliances."""
        values: np.ndarray = self._body_set.links.values(method.dt / method.substeps, self._body_set.mass)
        return pack(values.astype(self._real))

    def change(self, method: Method) -> None:
        """Update the values that depend on the length of a substep."""
        self._values.copy_to_device(self._of(method), stream=self._stream)

    def project(self, position: DeviceArray, record: DeviceArray, number: int, fresh: bool) -> None:
        """Project the links of a colour; `fresh`: the first time in a substep."""
        start, stop = self._starts[number], self._starts[number + 1]
        self._project[max(1, -(-int(stop - start) // THREADS)), THREADS, self._stream](
            position, position, self._ends, self._values, self._multipliers, start, stop, self._starts[-1],
            np.int32(fresh), record,
        )  # fmt: skip
