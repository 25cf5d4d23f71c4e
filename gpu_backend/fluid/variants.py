"""The variants of a fluid's kernels on CUDA."""

from __future__ import annotations

from typing import Any

from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import knows_time
from softlab.model.base.types import Real
from softlab.model.base.variant import Variant
from softlab.model.fluid.plan import fluid_features


def fluid_variant(
    real: Real, math: str, parts: frozenset[str], repeats: frozenset[str] = frozenset(), **more: Any
) -> Variant:
    """Return the variant of a fluid's kernels. `repeats`: axes that are periodic; `more`: features besides these."""
    return device_variant(real, math, fluid_features(parts, repeats) | {"timed": knows_time(parts)} | more)
