"""The variants of a fluid's kernels on CUDA."""

from __future__ import annotations

from collections.abc import Mapping

from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import knows_time
from softlab.model.base.types import Real
from softlab.model.base.variant import Variant
from softlab.model.fluid.plan import fluid_features


def fluid_variant(
    real: Real, math: str, parts: frozenset[str], repeats: frozenset[str] = frozenset(),
    more: Mapping[str, int] | None = None,
) -> Variant:  # fmt: skip
    """Return the variant of a fluid's kernels. `repeats`: axes that are periodic; `more`: features besides these."""
    features = fluid_features(parts, repeats) | {"timed": knows_time(parts)} | dict(more or {})
    return device_variant(real, math, features)
