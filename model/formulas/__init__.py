"""Point-wise physics, one file a topic: the only place where a step's floating-point arithmetic is written.

A topic is a factory `make(real, compiled)`, or several: `real` is the arithmetic (numpy.float32 or numpy.float64, so
constants are `real(0.5)` and float32 stays float32), `compiled` the decorator of the backend (`numba.njit`, `numba.cuda.jit`,
or nothing at all in tests). Functions take and return scalars, so that both backends inline them into their own loops.

The CUDA backend re-reads a factory's source and, in `exact` math, compiles each product in it as a round-to-nearest
multiply, so that nothing is contracted into a fused multiply-add (see gpu_backend/core/formulas.py). Therefore floating-point
formulas live *inside* a factory whose first parameter is `real`; integer arithmetic (random.py) lives outside of those.
"""

from types import SimpleNamespace


def joined(*groups):
    """A topic whose functions several factories make."""
    return SimpleNamespace(**{name: function for group in groups for name, function in vars(group).items()})


def plain(function):
    """The decorator that compiles nothing: formulas as ordinary Python, for tests and for reading."""
    return function
