"""Spring terms of implicit Euler's system for a row of a cloth: forces at the step's end, or the product with a vector.

Both read a vector at each position, and a second vector that belongs to it, six planes behind.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import block_of, row_at
from softlab.cpu_backend.core.scratch import AXES
from softlab.model.base.types import Real
from softlab.model.contact.cloth_parameters import spring_constants
from softlab.model.formulas import implicit

BESIDE = 2 * AXES  # planes from a vector to the one that belongs to it


def _make(compiler: Compiler, real: Real, kind: str, place: Any, formula: Callable, name: str) -> Callable:
    """Make a function like rows.make_accelerations with `formula(d, w, stiffness, rest, damping, dt)`; d and w are
    differences of the two vectors."""
    block = block_of(real)
    k_stiffness, k_rest, k_damping = spring_constants(kind)

    def pull_row(
        blocks, x, y, z, wx, wy, wz, far_x, far_y, far_z, far_wx, far_wy, far_wz, stiffness, rest, damping, dt, out_x,
        out_y, out_z,
    ):  # fmt: skip
        for j in range(blocks * block):
            px, py, pz = formula(
                far_x[j] - x[j], far_y[j] - y[j], far_z[j] - z[j], far_wx[j] - wx[j], far_wy[j] - wy[j],
                far_wz[j] - wz[j], stiffness, rest, damping, dt,
            )  # fmt: skip
            out_x[j] = px
            out_y[j] = py
            out_z[j] = pz

    pull_row.__name__ = f"{kind}_{name}_row"
    pull_row = compiler.row(pull_row)

    def pulls(blocks, source, plane, here, there, parameters, scratch, triple, width):
        first, far = here + BESIDE * plane, there + BESIDE * plane
        pull_row(
            blocks, row_at(source, here), row_at(source, here + plane), row_at(source, here + 2 * plane),
            row_at(source, first), row_at(source, first + plane), row_at(source, first + 2 * plane),
            row_at(source, there), row_at(source, there + plane), row_at(source, there + 2 * plane),
            row_at(source, far), row_at(source, far + plane), row_at(source, far + 2 * plane), parameters[k_stiffness],
            parameters[k_rest], parameters[k_damping], parameters.dt, row_at(scratch, place(triple, 0, width)),
            row_at(scratch, place(triple, 1, width)), row_at(scratch, place(triple, 2, width)),
        )  # fmt: skip

    pulls.__name__ = f"{kind}_{name}"
    return compiler.compiled(pulls)


def make_end_pulls(compiler: Compiler, real: Real, parts: frozenset[str], kind: str, place: Any) -> Callable:
    """Make forces at the step's end. First vector: position without the end velocity; second: that velocity."""
    return _make(compiler, real, kind, place, compiler.formulas(implicit, real).end_pull_3d, "end")


def make_products(compiler: Compiler, real: Real, parts: frozenset[str], kind: str, place: Any) -> Callable:
    """Make products. First vector: position at the step's end; second: the vector to multiply."""
    product_3d = compiler.formulas(implicit, real).product_3d

    @compiler.compiled
    def product(dx, dy, dz, wx, wy, wz, stiffness, stiffness_rest, damping, dt):
        return product_3d(dx, dy, dz, wx, wy, wz, stiffness, stiffness_rest, damping)

    return _make(compiler, real, kind, place, product, "product")
