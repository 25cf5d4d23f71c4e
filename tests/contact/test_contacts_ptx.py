"""The kernels of a cloth's contacts with itself compile for a GPU without one: no double in float32."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from kernel_text import entry_of, record_of

FIND = {
    "clear": "iif",
    "hash_cells": "ffpfliifss",
    "fill_buckets": "iii",
    "find_contacts": "ffpfliiifiiffiilss",
}
PROJECT = {
    "fill_links": "iiiif",
    "sort_links": "iii",
    "deepen": "ffiiffiiif",
    "load_up": "ifiiiff",
    "push": "ffiiffffpff",
    "gather": "fifiiiffff",
}
SCAN = {"chunks": "iii", "totals": "i", "add": "iii"}


pytestmark = pytest.mark.usefixtures("ptx_compiler")


def ptx(kernel: Any, arguments: str, math: str) -> str:
    """The kernel's text. `arguments`, a letter each: f float32, i 32-bit and l 64-bit integers of arrays, s a 32-bit one, p
    the record of constants."""
    from numba import types

    kinds = {"f": types.float32[::1], "i": types.int32[::1], "l": types.int64[::1], "s": types.int32}
    kinds["p"] = record_of(np.float32, "contacts")
    return entry_of(kernel.py_func, tuple(kinds[letter] for letter in arguments), math)


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", FIND)
def test_finding_holds_no_double(name: str, math: str) -> None:
    from softlab.gpu_backend.contact.self_find import make_find

    assert ".f64" not in ptx(getattr(make_find(np.float32, math), name), FIND[name], math)


@pytest.mark.parametrize("friction", [True, False], ids=["friction", "smooth"])
@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("name", PROJECT)
def test_projecting_holds_no_double_and_no_atomics_on_numbers(name: str, math: str, friction: bool) -> None:
    from softlab.gpu_backend.contact.self_project import make_project

    text = ptx(getattr(make_project(np.float32, math, friction), name), PROJECT[name], math)
    assert ".f64" not in text
    atomics = re.findall(r"\b(?:atom|red)\.\S+", text)
    assert all(".u32" in word or ".s32" in word for word in atomics)
    assert bool(atomics) == (name == "fill_links")


@pytest.mark.parametrize("name", SCAN)
def test_prefix_sums_are_whole_numbers(name: str) -> None:
    from softlab.gpu_backend.core.scan import make_scan

    text = ptx(getattr(make_scan(), name), SCAN[name], "exact")
    assert ".f32" not in text and ".f64" not in text
