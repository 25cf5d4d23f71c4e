"""Compilation of the formulas of model/formulas for CUDA, in `fast` or `exact` math.

The CUDA compiler contracts a * b + c into one fused multiply-add, which rounds once instead of twice, and numba.cuda
has no switch for it. So in `exact` math every product of a formula is a call of the round-to-nearest multiply, which is
never contracted. Quotients and roots are correctly rounded unless fast math is on,
and then fast math is off. In `fast` math the compiler may reorder and approximate, and small functions are replaced by
instructions: `inverse_length` by the approximate reciprocal root, `difference` by a subtraction that is not cancelled;
of `reciprocal` both branches are computed and one is selected, since the quotient is faster there than the comparison.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import cache
from types import ModuleType

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.device import simulated
from softlab.model.base.types import Features, FeatureSet, Real
from softlab.model.base.variant import PRODUCT, Formulas, OfPrecision, Variant, routine

if not simulated():
    from numba.cuda import libdevice

    from softlab.gpu_backend.core.instructions import approximate_root_64

# Instructions of `fast` math: without a branch and, in float64, without a quotient.

# its root is finite, and it is negligible next to a real squared length
LEAST_SQUARED = OfPrecision(lambda real: 1e-37 if real is np.float32 else 1e-290)


@routine
def squared_length(dx, dy):
    return dx * dx + (dy * dy + LEAST_SQUARED)


@routine
def inverse_length_64(squared):
    """Return 1 / sqrt(squared) from an approximate root of 20 bits.

    With e = 1 - s y^2, 1 / sqrt(s) = y (1 - e)^(-1/2) = y (1 + e/2 + 3 e^2/8 + ...), so one step leaves 5 e^3/16 <
    1e-18.
    """
    y = approximate_root_64(squared)
    e = 1.0 - squared * y * y
    return y + y * e * (0.5 + 0.375 * e)


@routine
def difference_64(a, b):
    return libdevice.dadd_rn(a, -b)  # libdevice has no rounded subtraction in double precision


@routine
def quotient(a, b):
    return a * (1.0 / b)


@routine
def reciprocal(weight, stiffening, compliance):
    inverse = 1.0 / (stiffening * weight + compliance)
    return inverse if weight > 0.0 else 0.0


def _instructions(real: Real, math: str, options: dict[str, bool]) -> dict[str, Callable]:
    if simulated():
        return {PRODUCT: operator.mul} if math == "exact" else {}
    single = real is np.float32
    if math == "exact":
        return {PRODUCT: libdevice.fmul_rn if single else libdevice.dmul_rn}
    variant = Variant(real, cuda.jit(device=True, **options))
    return {
        "squared_length": variant(squared_length),
        "inverse_length": libdevice.rsqrtf if single else variant(inverse_length_64),
        "reciprocal": variant(reciprocal),
        "difference": libdevice.fsub_rn if single else variant(difference_64),
        "quotient": variant(quotient),
    }


@cache
def _variant(real: Real, math: str, inline: bool, features: FeatureSet) -> Variant:
    options = {"fastmath": math == "fast"}
    instructions = _instructions(real, math, options)
    product = instructions.pop(PRODUCT, None)
    compiled = inlined(math) if inline else cuda.jit(device=True, **options)
    return Variant(real, compiled, dict(features), product, instructions, {"inlined": inlined(math)})


def device_variant(real: Real, math: str, features: Features | None = None, inline: bool = False) -> Variant:
    """Return the compiler of formulas as device functions for `math`; see model/base/variant.py."""
    return _variant(real, math, inline, frozenset((features or {}).items()))


def device_formulas(module: ModuleType, real: Real, math: str, features: Features | None = None) -> Formulas:
    """Return the formulas of a module in a variant."""
    return device_variant(real, math, features).of(module)
