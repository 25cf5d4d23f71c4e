"""Sine, cosine, exponentials, logarithms and powers in float64, the same bits on every machine.

Sine and cosine of arrays: the polynomials of fdlibm (Sun Microsystems, 1993; k_sin.c, k_cos.c) after a reduction by
multiples of pi / 2 in three parts (e_rem_pio2.c), an error under one ulp up to |x| of 1e6. The others, of which few different
values occur: with DIGITS decimal digits, rounded once to float64.
"""

from __future__ import annotations

from collections.abc import Callable
from decimal import Context, Decimal, Overflow, localcontext
from math import isinf, isnan
from typing import TypeVar, overload

import numpy as np

Value = TypeVar("Value", float, np.ndarray)
DIGITS = 60
TWO_OVER_PI = 6.36619772367581382433e-01
PARTS_OF_HALF_PI = (
    1.57079632673412561417e00,
    6.07710050630396597660e-11,
    2.02226624879595063154e-21,
)  # 33 bits each, the rest
SINE = (
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04, 2.75573137070700676789e-06,
    -2.50507602534068634195e-08, 1.58969099521155010221e-10,
)  # fmt: skip
COSINE = (
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05, -2.75573143513906633035e-07,
    2.08757232129817482790e-09, -1.13596475577881948265e-11,
)  # fmt: skip


@overload
def sine_and_cosine(angle: float) -> tuple[float, float]: ...
@overload
def sine_and_cosine(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]: ...
def sine_and_cosine(angle: float | np.ndarray) -> tuple[float, float] | tuple[np.ndarray, np.ndarray]:
    """Return (sine, cosine) of an array or a number [rad]."""
    x = np.asarray(angle, dtype=np.float64)
    quarter = np.rint(x * TWO_OVER_PI)
    first, second, third = PARTS_OF_HALF_PI
    rough = x - quarter * first
    near = rough - quarter * second
    low = quarter * third - ((rough - near) - quarter * second)
    y = near - low
    tail = (near - y) - low
    s, c = _sine_near(y, tail), _cosine_near(y, tail)
    turn = quarter.astype(np.int64) & 3
    sine = np.choose(turn, [s, c, -s, -c])
    cosine = np.choose(turn, [c, -s, -c, s])
    return (sine, cosine) if x.ndim else (float(sine), float(cosine))


def sine(angle: Value) -> Value:
    """Return the sine of an array or a number [rad]."""
    return sine_and_cosine(angle)[0]


def cosine(angle: Value) -> Value:
    """Return the cosine of an array or a number [rad]."""
    return sine_and_cosine(angle)[1]


def _polynomial(coefficients: tuple[float, ...], z: np.ndarray) -> np.ndarray:
    value = np.full_like(z, coefficients[-1])
    for one in coefficients[-2::-1]:
        value = one + z * value
    return value


def _sine_near(x: np.ndarray, tail: np.ndarray) -> np.ndarray:
    """Return the sine of x + tail in [-pi / 4, pi / 4]."""
    z = x * x
    cube = z * x
    rest = _polynomial(SINE[1:], z)
    return np.asarray(x - ((z * (0.5 * tail - cube * rest) - tail) - cube * SINE[0]))


def _cosine_near(x: np.ndarray, tail: np.ndarray) -> np.ndarray:
    """Return the cosine of x + tail in [-pi / 4, pi / 4]."""
    z = x * x
    half = 0.5 * z
    rest = z * _polynomial(COSINE, z)
    whole = 1.0 - half
    return np.asarray(whole + (((1.0 - whole) - half) + (z * rest - x * tail)))


def _each(values: Value, function: Callable[[Decimal], Decimal], special: Callable[[float], float]) -> Value:
    """Return `function`, with DIGITS digits, of each value of an array or a number; `special` of values that are not
    finite. Equal values are computed once."""
    array = np.asarray(values, dtype=np.float64)
    different, place = np.unique(array, return_inverse=True)
    computed = np.empty(len(different))
    with localcontext(Context(prec=DIGITS)) as context:
        context.traps[Overflow] = False
        for k, one in enumerate(different.tolist()):
            computed[k] = special(one) if isinf(one) or isnan(one) else float(function(Decimal(one)))
    result = computed[place.reshape(array.shape)]
    return result if isinstance(values, np.ndarray) else float(result)


def expm1(values: Value) -> Value:
    """exp(x) - 1."""
    return _each(values, lambda x: x if abs(x) < Decimal("1e-40") else x.exp() - 1, lambda x: -1.0 if x < 0 else x)


def log1p(values: Value) -> Value:
    """log(1 + x) of x over -1."""
    return _each(values, lambda x: x if abs(x) < Decimal("1e-40") else (1 + x).ln(), lambda x: x)


def whole_power(value: Value, exponent: int) -> Value:
    """x^n for a whole number of at least 1, x times x times x ..., from the left."""
    product = value
    for _ in range(exponent - 1):
        product = product * value
    return product


def power(values: Value, exponent: float) -> Value:
    """x^exponent of finite x of at least 0, and an exponent over 0."""
    exact_exponent = Decimal(exponent)
    return _each(values, lambda x: (exact_exponent * x.ln()).exp() if x else x, lambda x: x)
