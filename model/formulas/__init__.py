"""Point-wise physics, one file per topic: the only place where a step's floating-point arithmetic is written.

A topic is one or several factories `make(real, compiled)`. `real` is the arithmetic (numpy.float32 or numpy.float64):
constants are `real(0.5)`, so that float32 stays float32. `compiled` is the decorator of the backend (`numba.njit`,
`numba.cuda.jit`, or none in tests). Functions take and return scalars, so that both backends inline them into their
loops.

The CUDA backend re-reads a factory's source and, in `exact` math, compiles each product in it as a round-to-nearest
multiply, so that nothing is contracted into a fused multiply-add (see gpu_backend/core/formulas.py). Therefore
floating-point formulas live *inside* a factory whose first parameter is `real`; integer arithmetic (random.py) lives
outside of those.
"""

from types import SimpleNamespace


def joined(*groups):
    """Return one topic with the functions of several factories."""
    return SimpleNamespace(**{name: function for group in groups for name, function in vars(group).items()})


def plain(function):
    """Return `function` uncompiled: the decorator for tests and for reading formulas as ordinary Python."""
    return function
