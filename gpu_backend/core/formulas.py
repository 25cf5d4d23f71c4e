"""Compilation of the formulas of model/formulas for CUDA, in `fast` or `exact` math.

The CUDA compiler contracts a * b + c into one fused multiply-add, which rounds once instead of twice, and numba.cuda
has no switch for it. So in `exact` math a factory's source is parsed again and every product becomes a call of the
round-to-nearest multiply, which is never contracted. Quotients and roots are correctly rounded unless fast math is on,
and then fast math is off. In `fast` math the compiler may reorder and approximate, and small functions are replaced by
instructions: `inverse_length` by the approximate reciprocal root, `difference` by a subtraction that is not cancelled;
of `reciprocal` both branches are computed and one is selected, since the quotient is faster there than the comparison.
"""

from __future__ import annotations

import ast
import inspect
import operator
import sys
import textwrap
from collections.abc import Callable
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import simulated
from softlab.model.base.types import Real


class _RoundProducts(ast.NodeTransformer):
    """Replaces a * b by _product(a, b), also in a *= b."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        return self._call(node.left, node.right) if isinstance(node.op, ast.Mult) else node

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST:
        self.generic_visit(node)
        if not isinstance(node.op, ast.Mult) or not isinstance(node.target, ast.Name):
            return node
        left = ast.Name(node.target.id, ast.Load())
        return ast.Assign([node.target], self._call(left, node.value))

    @staticmethod
    def _call(left: ast.expr, right: ast.expr) -> ast.Call:
        return ast.Call(ast.Name("_product", ast.Load()), [left, right], [])


class _ReplaceFunctions(ast.NodeTransformer):
    """Removes the definitions of the named inner functions, so that the names refer to the namespace."""

    def __init__(self, names: set[str]):
        self.names = names

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST | None:
        if node.name in self.names:
            return None
        self.generic_visit(node)
        return node


def _instructions(real: Real, math: str, options: dict[str, Any]) -> dict[str, Callable]:
    if simulated():
        return {"_product": operator.mul} if math == "exact" else {}
    from numba.cuda import libdevice

    single = real is np.float32
    if math == "exact":
        return {"_product": libdevice.fmul_rn if single else libdevice.dmul_rn}
    return _fast_instructions(real, options)


def _fast_instructions(real: Real, options: dict[str, Any]) -> dict[str, Callable]:
    """Return the replacements for `fast` math: without a branch and, in float64, without a quotient.

    float64 has an approximate root of 20 bits only; with e = 1 - s y^2, 1 / sqrt(s) = y (1 - e)^(-1/2) = y (1 + e/2 + 3
    e^2/8 + ...), so one step leaves 5 e^3/16 < 1e-18.
    """
    from numba.cuda import libdevice

    from softlab.gpu_backend.core.instructions import approximate_root_64

    device = cuda.jit(device=True, **options)
    single = real is np.float32
    root: Any = approximate_root_64
    least = real(1e-37 if single else 1e-290)  # its root is finite, and it is negligible next to a real squared length
    half, three_eighths, one, zero = real(0.5), real(0.375), real(1), real(0)

    @device
    def squared_length(dx, dy):
        return dx * dx + (dy * dy + least)

    @device
    def inverse_length_64(squared: Any) -> Any:
        y = root(squared)
        e = one - squared * y * y
        return y + y * e * (half + three_eighths * e)

    @device
    def difference_64(a, b):
        return libdevice.dadd_rn(a, -b)  # libdevice has no rounded subtraction in double precision

    @device
    def quotient(a, b):
        return a * (one / b)

    @device
    def reciprocal(weight, stiffening, compliance):
        inverse = one / (stiffening * weight + compliance)
        return inverse if weight > zero else zero

    return {
        "squared_length": squared_length,
        "inverse_length": libdevice.rsqrtf if single else inverse_length_64,
        "reciprocal": reciprocal,
        "difference": libdevice.fsub_rn if single else difference_64,
        "quotient": quotient,
    }


def _rewritten(make: FunctionType, real: Real, math: str, options: dict[str, Any]) -> Callable:
    """Return the factory `make` with its source transformed for `math`; factories it calls are transformed as well."""
    instructions = _instructions(real, math, options)
    namespace = dict(vars(sys.modules[make.__module__])) | instructions
    _refuse_attributes(make, namespace)
    for name, value in list(namespace.items()):
        if _is_factory(value) and value is not make:
            namespace[name] = lambda *arguments, value=value: _rewritten(value, real, math, options)(*arguments)
    exec(_transformed(make, frozenset(instructions)), namespace)
    return namespace[make.__name__]


@cache
def _transformed(make: FunctionType, instructions: frozenset[str]) -> CodeType:
    """Return the code of the factory `make` with its products rounded, if there is a `_product`, and without the inner
    functions that instructions replace."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(make)))
    if "_product" in instructions:
        factory = tree.body[0]
        assert isinstance(factory, ast.FunctionDef)
        factory.body = [_RoundProducts().visit(n) if isinstance(n, ast.FunctionDef) else n for n in factory.body]
    tree = ast.fix_missing_locations(_ReplaceFunctions(set(instructions)).visit(tree))
    return compile(tree, inspect.getfile(make), "exec")


@cache
def _named_in(make: FunctionType) -> frozenset[tuple[str, str]]:
    """Return (name, attribute) of every attribute access in a factory's source."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(make)))
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)]
    return frozenset((node.value.id, node.attr) for node in nodes if isinstance(node.value, ast.Name))


def _refuse_attributes(make: FunctionType, namespace: dict[str, Any]) -> None:
    """Refuse a factory that is called as an attribute of its module: it would not be rewritten, and its products
    contracted."""
    for name, attribute in _named_in(make):
        if isinstance(namespace.get(name), ModuleType) and _is_factory(getattr(namespace[name], attribute, None)):
            raise TypeError(f"{make.__module__}: import {attribute} by its name; {name}.{attribute} is not rewritten")


def _is_factory(value: Any) -> bool:
    """Return True for a factory of formulas in an arithmetic, with a first parameter `real`; those of integers have
    their own products."""
    here = isinstance(value, FunctionType) and value.__module__.startswith("softlab.model.formulas.")
    return here and value.__code__.co_varnames[:1] == ("real",)


def device_formulas(make: Any, real: Real, math: str, **flags: int) -> Any:
    """Return `make(real, compiled, **flags)`, compiled as device functions for `math`."""
    options = {"fastmath": math == "fast"}
    return _rewritten(make, real, math, options)(real, cuda.jit(device=True, **options), **flags)
