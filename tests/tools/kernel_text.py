"""The text that a CUDA kernel compiles to, without a GPU."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from softlab.model.tetrahedra import newton
from softlab.model.tetrahedra.constraints import CONSTANTS
from softlab.model.tetrahedra.descent import SCALE

RECORDS = {  # by family: its letter among a kernel's arguments, and the names of its constants
    "grid": ("G", PARAMETERS),
    "quads": ("P", XPBD_PARAMETERS),
    "contacts": ("K", SELF_CONTACT_PARAMETERS),
    "surfaces": ("S", SURFACE_CONTACT_PARAMETERS),
    "matrix": ("M", SYSTEM_PARAMETERS),
    "tetrahedra": ("T", (*CONSTANTS, *XPBD_PARAMETERS)),
    "descent": ("D", (SCALE, *newton.CONSTANTS, *XPBD_PARAMETERS)),
    "newton": ("N", (*newton.CONSTANTS, *XPBD_PARAMETERS)),
    "fluid": ("F", (*force_names(3), *FLUID_PARAMETERS)),
}


def record_of(real: Any, family: str) -> Any:
    """numba's type of the array that holds a family's constants."""
    from numba import typeof

    return typeof(np.zeros(1, record_type(RECORDS[family][1], real)))


@cache
def entry_of(function: Callable, arguments: tuple, math: str) -> str:
    """The PTX of a kernel's function for arguments of numba's types `arguments`, from its entry on: made once for all tests
    of a process."""
    from numba import cuda

    text = str(cuda.compile_ptx(function, arguments, cc=(9, 0), fastmath=math == "fast")[0])
    return text[text.index(".entry") :]


Letters = str | Sequence[Any]  # of arguments; one may also be (NamedTuple, Letters of its members)


def kernel_text(kernel: Any, letters: Letters, real: Any, math: str) -> str:
    """Return the PTX of a kernel from its entry on.

    `letters`, one per argument: R, W and C arrays of reals, of rows of reals and of pairs; I, L, U and B of integers of
    32 and 64 bits, of unsigned ones and of bytes; r a real, i, l and b numbers of 32 and 64 bits and a yes or no; those of
    RECORDS.
    """
    return entry_of(kernel.py_func, types_of(letters, real), math)


def types_of(letters: Letters, real: Any) -> tuple:
    """Return numba's types of arguments."""
    from numba import types

    real_type = types.float32 if real is np.float32 else types.float64
    known = {"R": real_type[::1], "W": real_type[:, ::1], "I": types.int32[::1], "L": types.int64[::1]}
    known["C"] = (types.complex64 if real is np.float32 else types.complex128)[::1]
    known |= {"U": types.uint64[::1], "B": types.uint8[::1]}
    known |= {"r": real_type, "i": types.int32, "l": types.int64, "b": types.boolean}
    families = {letter: family for family, (letter, _) in RECORDS.items()}

    def type_of(one: Any) -> Any:
        if isinstance(one, tuple):
            return types.BaseTuple.from_types(types_of(one[1], real), one[0])
        return known[one] if one in known else record_of(real, families[one])

    return tuple(map(type_of, letters))
