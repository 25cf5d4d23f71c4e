"""The machine code of the position-based kernels: loops along a row are vectors, without a scalar root for a remainder or an
edge; see test_cpu_assembly.py for how that shows."""

from __future__ import annotations

import re

import numba
import numpy as np
import pytest
from test_cpu_assembly import DOUBLE, PACKED_ROOT, SCALAR_ROOT, row_loops, vector_units  # noqa: F401 - a fixture
from xpbd_scenes import xpbd_scene

from softlab.app.driver import open_simulation
from softlab.cpu_backend.xpbd import solver as xpbd
from softlab.cpu_backend.xpbd.jacobi_kernel import make_jacobi_advance
from softlab.cpu_backend.xpbd.seidel import make_seidel_advance


@pytest.mark.parametrize(
    ("name", "ordering", "precision", "math"),
    [
        ("springs", "gauss-seidel", "float32", "fast"),
        ("rigid", "gauss-seidel", "float64", "exact"),
        ("springs", "jacobi", "float32", "fast"),
    ],
)
def test_projections_take_packed_roots_alone(name: str, ordering: str, precision: str, math: str) -> None:
    """In every family: six of them, with weights and without where colours need both."""
    scene = xpbd_scene(name, ordering, rows=8, columns=80)
    with open_simulation(scene, precision=precision, math=math, threads=1) as simulation:
        assert isinstance(simulation, xpbd.PositionBased)
        variant, arguments = simulation._variant(), simulation._arguments(0, 1)
    make = make_jacobi_advance if ordering == "jacobi" else make_seidel_advance
    dispatcher = make.__wrapped__(*variant)  # past the memory of kernels made before
    dispatcher._cache = numba.core.caching.NullCache()
    dispatcher.compile((numba.typeof(arguments[0]), numba.typeof(tuple(arguments[1:]))))
    (compiled,) = dispatcher.overloads.values()
    text = compiled.library.get_asm_str()
    loops = row_loops(text)
    assert (
        len(re.findall(PACKED_ROOT, text)) >= 6
    )  # not counted by loops: those of soft constraints have a branch inside
    assert not re.search(SCALAR_ROOT, text), "a remainder loop or a scalar version of a row loop"
    if precision == "float32":
        assert not any(re.search(DOUBLE, loop) for loop in loops)
    if math == "fast":
        assert re.search("rsqrt", text) or np.dtype(precision).itemsize == 8
    else:
        assert not re.search(r"rsqrt|\bvfn?m(add|sub)\d+", text), "exact math approximates or contracts"
