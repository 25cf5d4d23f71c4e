"""Shape matching of a grid on CUDA: the position-based solver of sheets, with clusters in place of constraints."""

from __future__ import annotations

from softlab.gpu_backend.shape_matching.matching import Matching
from softlab.gpu_backend.xpbd.solver import PositionBased


class ShapeMatching(PositionBased):
    """Shape matching of a grid; model/core/simulation.py defines the contract."""

    def _make_matching(self) -> Matching:
        return Matching(self.scene, self.real, self.options.math, self._grid, self.stream)
