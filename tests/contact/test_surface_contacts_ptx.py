"""The kernels of bodies that meet compile for a GPU without one: no double in float32, nothing contracted in exact math."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernel_text import entry_of, record_of

FIND = {"take": "fif", "clear": "ii", "find_contacts": "fffiiiiiiiipfiiffiil"}
PROJECT = {"fill_links": "iiiif", "deepen": "ffiiffiiif", "push": "ffiiffffpff", "gather": "fifiiiffff"}
RUB = {"rub": "ffiiffffpff", "gather_rubbed": "fifiiiffff"}

pytestmark = pytest.mark.usefixtures("ptx_compiler")


def ptx(kernel: Any, arguments: str, real: Any, math: str) -> str:
    """The kernel's text. `arguments`, a letter each: f arrays of reals, i and l of 32- and 64-bit integers, p the record."""
    from numba import types

    reals = (types.float32 if real is np.float32 else types.float64)[::1]
    kinds = {"f": reals, "i": types.int32[::1], "l": types.int64[::1], "p": record_of(real, "surfaces")}
    return entry_of(kernel.py_func, tuple(kinds[letter] for letter in arguments), math)


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", FIND)
def test_finding_holds_no_double(name: str, math: str) -> None:
    from softlab.gpu_backend.contact.surfaces_find import make_find

    assert ".f64" not in ptx(getattr(make_find(np.float32, math), name), FIND[name], np.float32, math)


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", PROJECT | RUB)
def test_projecting_knows_the_surfaces_record(name: str, math: str) -> None:
    from softlab.gpu_backend.contact.self_project import make_project

    kernels = make_project(np.float32, math, True, surfaces=True)
    assert ".f64" not in ptx(getattr(kernels, name), (PROJECT | RUB)[name], np.float32, math)


def test_exact_math_contracts_nothing() -> None:
    from softlab.gpu_backend.contact.surfaces_find import make_find

    text = ptx(make_find(np.float64, "exact").find_contacts, FIND["find_contacts"], np.float64, "exact")
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text
