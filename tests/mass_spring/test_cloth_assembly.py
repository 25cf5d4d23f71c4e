"""The cloth's kernel `fused` does what its docstrings say, read off its machine code (see test_cpu_assembly.py).

Loops along rows that take roots: one for each family of springs (six, of which the walk's beginning repeats some), and
one for the triangles of a row of cells, with the roots of two triangles' normals and air speeds.
"""

import re

import numba
import numpy as np
import pytest
from test_cpu_assembly import DOUBLE, PACKED_ROOT, SCALAR_ROOT, row_loops, vector_units

from softlab.app.driver import open_simulation
from softlab.cpu_backend.mass_spring.cloth import solver as cloth
from softlab.model.scene.scene import load_scene

__all__ = ["vector_units"]  # a fixture


@pytest.mark.parametrize("math", ["fast", "exact"])
def test_loops_along_rows_take_packed_roots_alone(math):
    scene = load_scene("cloth-wind").replace({"cloth.rows": 8, "cloth.columns": 40, "method.integrator": "lab"})
    with open_simulation(scene, kernel="fused", math=math, threads=2) as simulation:
        assert isinstance(simulation, cloth.ClothMassSpring)
        arguments, parts = simulation._passes(0, 1), simulation.plan.parts
    dispatcher = cloth.make_cloth_advance.__wrapped__(np.float32, math, "lab", parts)
    dispatcher._cache = numba.core.caching.NullCache()  # machine code from the cache cannot be read
    dispatcher.compile((numba.int64, numba.typeof(tuple(arguments))))
    (compiled,) = dispatcher.overloads.values()
    text = compiled.library.get_asm_str()
    loops = row_loops(text)
    roots = [len(re.findall(PACKED_ROOT, loop)) for loop in loops]
    assert sum(count == 1 for count in roots) >= 6 and max(roots) >= 4
    assert not re.search(SCALAR_ROOT, text), "a remainder loop or a scalar version of a row loop"
    assert not any(re.search(DOUBLE, loop) for loop in loops)
    if math == "exact":
        assert not re.search(r"rsqrt|\bvfn?m(add|sub)\d+", text), "exact math approximates or contracts"
    else:
        assert not any(
            re.search(r"\bvdivps\b|\bvsqrtps\b", loop) for loop, count in zip(loops, roots, strict=True) if count
        )
