"""Kernel digests: a hash of the computation of a compiled function, independent of names and of the version of
Python.

Measurements are keyed by it (bench/keys/enter.py). Machine code is not: two kernels of one digest may have other symbols, so
the cache of machine code uses `content_digest`. Nothing here imports the lab, so that the same file can be loaded beside the
code of an older commit.
"""

from __future__ import annotations

import ast
import hashlib
import sys
import types
from functools import cache
from pathlib import Path
from typing import Any

from softlab.bench.keys.syntax import UNKNOWN, Function, normal_form, parameters_of

FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
FOREIGN = frozenset({"numba", "numba_cuda", "numpy", "llvmlite", *sys.stdlib_module_names})
# Options of numba that change how a function is called or kept, but not the code of its body
NOT_IN_CODE = frozenset({"nogil", "no_cpython_wrapper", "no_cfunc_wrapper", "_nrt", "debug", "lineinfo", "cache"})


class SourceUnknown(LookupError):
    """The source of a function cannot be found, so that it has no digest."""


@cache
def _functions_in(path: str) -> dict[str, list[tuple[int, Function]]]:
    """Return name -> (first line, node) of every function in a file."""
    functions: dict[str, list[tuple[int, Function]]] = {}
    for node in ast.walk(ast.parse(Path(path).read_text(encoding="utf-8"))):
        if isinstance(node, FUNCTIONS):
            first = min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", ()))])
            functions.setdefault(getattr(node, "name", "<lambda>"), []).append((first, node))
    return functions


def tree_of(function: types.FunctionType) -> Function:
    """Return the syntax tree of a function, a definition or a lambda; of a variant of a formula the copy that was compiled.
    Raises SourceUnknown."""
    if hasattr(function, "softlab_formula"):
        from softlab.model.base.variant import specialised_tree  # which imports numpy: digests need none

        return specialised_tree(*function.softlab_formula)[0]
    code = function.__code__
    try:
        known = _functions_in(code.co_filename).get(code.co_name, [])
    except (OSError, SyntaxError, UnicodeDecodeError) as error:
        raise SourceUnknown(f"{code.co_filename}: the source of {code.co_name} cannot be read: {error}") from None
    here = [node for first, node in known if first == code.co_firstlineno]
    wanted = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    here = [node for node in here if tuple(parameters_of(node.args)[0]) == wanted]
    if len({ast.dump(node) for node in here}) != 1:
        raise SourceUnknown(
            f"{code.co_filename}:{code.co_firstlineno}: {len(here)} functions {code.co_name} are there, not one; "
            "restart, if the file has changed since it was imported"
        )
    return here[0]


class KernelDigests:
    """Digests of functions and values; each function's is computed once."""

    def __init__(self) -> None:
        self._known: dict[
            int, tuple[object, str]
        ] = {}  # by identity, with the object, so that no other takes its place
        self._entered: dict[int, int] = {}

    def of(self, kernel: object) -> str:
        """Return the digest (16 hexadecimal digits) of a compiled or plain function. Raises SourceUnknown."""
        return _hash(self.describe(kernel))

    def describe(self, value: object) -> str:
        """Return the text for a value: its content, never its name."""
        if isinstance(value, float):
            return f"float {value.hex()}"
        if value is None or value is Ellipsis or isinstance(value, bool | int | str | bytes | complex):
            return f"{type(value).__name__} {value!r}"
        if isinstance(value, tuple | list):
            return f"tuple({','.join(map(self.describe, value))})"
        if isinstance(value, set | frozenset):
            return f"set({','.join(sorted(map(self.describe, value)))})"
        if isinstance(value, dict):
            return f"dict({','.join(sorted(f'{self.describe(k)}:{self.describe(v)}' for k, v in value.items()))})"
        if isinstance(value, types.FunctionType) or hasattr(value, "py_func") or hasattr(value, "_defn"):
            return self._once(value)
        if isinstance(value, types.SimpleNamespace):
            return f"space({','.join(sorted(map(self.describe, vars(value).values())))})"
        if isinstance(value, types.ModuleType):
            return f"module {value.__name__}" if _is_foreign(value.__name__) else "module"
        if isinstance(value, type):
            return self._of_class(value)
        return self._of_object(value)

    def _of_object(self, value: object) -> str:
        if hasattr(value, "dtype") and hasattr(value, "tobytes"):
            return f"{value.dtype.str} {getattr(value, 'shape', ())} {_hash(value.tobytes())}"
        if (
            callable(value)
            and hasattr(value, "__name__")
            and _is_foreign(getattr(value, "__module__", "") or "builtins")
        ):
            return f"{value.__module__}.{getattr(value, '__qualname__', value.__name__)}"
        if _is_foreign(type(value).__module__):
            return f"{type(value).__module__}.{type(value).__name__} {_without_address(repr(value))}"
        raise TypeError(
            f"a kernel uses {value!r}, of {type(value).__module__}.{type(value).__name__}, which has no digest; "
            "give it numbers, arrays, functions or tuples of them"
        )

    def _of_class(self, value: type) -> str:
        if _is_foreign(value.__module__):
            return f"{value.__module__}.{value.__qualname__}"
        methods = sorted(self.describe(one) for one in vars(value).values() if isinstance(one, types.FunctionType))
        fields = getattr(value, "_fields", ())
        return f"class({','.join(fields)};{'' if fields else ','.join(methods)})"

    # ------------------------------------------------------------------ functions

    def _once(self, value: object) -> str:
        known = self._known.get(id(value))
        if known is None:
            known = self._known[id(value)] = (value, _hash(self._of_callable(value)))
        return f"function {known[1]}"

    def _of_callable(self, value: Any) -> str:
        if hasattr(value, "py_func"):  # what numba compiles
            options = getattr(value, "targetoptions", None) or {}
            relevant = {
                name: one for name, one in options.items() if name not in NOT_IN_CODE and one not in (None, False)
            }
            pipeline = getattr(getattr(value, "_compiler", None), "pipeline_class", None)
            how = "" if pipeline is None else self._of_class(pipeline)
            return f"compiled {self._options(relevant)} {how} {self.describe(value.py_func)}"
        if hasattr(value, "_defn"):  # an intrinsic: the function that writes its code
            return f"intrinsic {self.describe(value._defn)}"
        if _is_foreign(value.__module__ or ""):
            return f"{value.__module__}.{value.__qualname__}"
        if id(value) in self._entered:
            return f"entered {len(self._entered) - self._entered[id(value)]}"
        self._entered[id(value)] = len(self._entered)
        try:
            return self._of_function(value)
        finally:
            del self._entered[id(value)]

    def _options(self, options: dict[str, object]) -> str:
        return ",".join(f"{name}={self.describe(options[name])}" for name in sorted(options))

    def _of_function(self, function: types.FunctionType) -> str:
        cells = dict(zip(function.__code__.co_freevars, function.__closure__ or (), strict=True))

        def resolve(name: str) -> object:
            if name in cells:
                try:
                    return cells[name].cell_contents
                except ValueError:
                    return UNKNOWN
            if name in function.__globals__:
                return function.__globals__[name]
            return vars(__import__("builtins"))[name]

        defaults = self.describe((function.__defaults__, function.__kwdefaults__))
        return f"{normal_form(tree_of(function), resolve, self.describe)} {defaults} "  # as in keys that are stored


def _is_foreign(module: str) -> bool:
    return module.split(".")[0] in FOREIGN


def _without_address(text: str) -> str:
    return text.partition(" at 0x")[0]


def _hash(content: str | bytes) -> str:
    return hashlib.sha256(content if isinstance(content, bytes) else content.encode()).hexdigest()[:16]
