"""The text that a CUDA kernel compiles to, without a GPU."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from softlab.model.contact.self_contact_parameters import SELF_CONTACT_PARAMETERS
from softlab.model.contact.substep_parameters import XPBD_PARAMETERS
from softlab.model.contact.surface_parameters import SURFACE_CONTACT_PARAMETERS
from softlab.model.core.own_forces import force_names
from softlab.model.core.parameters import PARAMETERS, record_type
from softlab.model.fluid.parameters import FLUID_PARAMETERS
from softlab.model.mass_spring.implicit_parameters import SYSTEM_PARAMETERS
from softlab.model.tetrahedra.constraints import CONSTANTS

RECORDS = {  # of a grid; of all solvers of quads, a cloth's names among others; of a cloth's contacts; of a matrix; ...
    "grid": PARAMETERS,
    "quads": XPBD_PARAMETERS,
    "contacts": SELF_CONTACT_PARAMETERS,
    "surfaces": SURFACE_CONTACT_PARAMETERS,
    "matrix": SYSTEM_PARAMETERS,
    "tetrahedra": (*CONSTANTS, *XPBD_PARAMETERS),
    "fluid": (*force_names(3), *FLUID_PARAMETERS),
}


def record_of(real: Any, family: str) -> Any:
    """numba's type of the array that holds a family's constants."""
    from numba import typeof

    return typeof(np.zeros(1, record_type(RECORDS[family], real)))


@cache
def ptx_of(function: Callable, arguments: tuple, math: str) -> str:
    """The PTX of a kernel's function for arguments of numba's types `arguments`: made once for all tests of a process."""
    from numba import cuda

    text, _ = cuda.compile_ptx(function, arguments, cc=(9, 0), fastmath=math == "fast")
    return str(text)


def entry_of(function: Callable, arguments: tuple, math: str) -> str:
    """`ptx_of` from the kernel's entry on."""
    text = ptx_of(function, arguments, math)
    return text[text.index(".entry") :]


def kernel_text(kernel: Any, letters: str, real: Any, math: str) -> str:
    """The PTX of a kernel from its entry on. `letters`, one of each argument: R and I arrays of reals and of integers, L of
    64-bit and U of unsigned ones, P the record of constants of solvers of quads, F of fluids,
    r a real, i and l numbers of 32 and 64 bits, b a yes or no."""
    from numba import types

    numbers = (types.float32 if real is np.float32 else types.float64)[::1]
    known = {"R": numbers, "I": types.int32[::1], "L": types.int64[::1], "U": types.uint64[::1]}
    known["P"], known["F"] = record_of(real, "quads"), record_of(real, "fluid")
    known |= {"r": numbers.dtype, "i": types.int32, "l": types.int64, "b": types.boolean}
    return entry_of(kernel.py_func, tuple(known[letter] for letter in letters), math)


def collide_text(real: Any, math: str, parts: frozenset[str]) -> str:
    """Of the kernel in which the masses of a position-based solver meet the colliders among `parts`."""
    from softlab.gpu_backend.position_based.stages import make_xpbd_stages

    return kernel_text(make_xpbd_stages(real, math, parts, 3).collide, "RRRPRUl", real, math)
