"""Digests: results of other sources are compiled or measured again.

Machine code is keyed by its content (`content_digest`): the bytecode of a function, the numbers in its closure, and the
same of every function that it calls. A measurement names the text of its backend's sources (`source_digest`); when that
changes, the keys of its kernels (bench/keys) decide if it is still valid.
"""

from __future__ import annotations

import ast
import hashlib
import os
import sys
import types
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]  # where the layers lie: the checkout, or the installed package
FOREIGN = frozenset(
    {"numba", "numpy", "llvmlite", *sys.stdlib_module_names}
)  # told by name: kernels name their versions

_UNKNOWN = os.urandom(16)  # stands for what cannot be told apart: such a digest is another one in every process
# Pieces of a function's code, by its identity and docstring, with the code, so that no other gets its place: factories make
# functions of the same code again and again
_codes: dict[tuple[int, str | None], tuple[types.CodeType, list[bytes]]] = {}


def content_digest(*values: object) -> str:
    """Return a hash (hex) of the content of functions and plain values, the same in every process. For a function it
    covers its bytecode, constants, defaults, the values in its closure, and the globals that it names; functions
    (compiled ones too, with their options) are followed. Line numbers, comments, docstrings and the function's own name
    do not count. An unknown object gives a digest that no other process computes.
    """
    return _Walk().digest(values).hex()[:32]


class _Walk:
    """One walk through a function and all it refers to; a reference to a function already entered is recorded by its
    number."""

    def __init__(self) -> None:
        self._entered: dict[int, int] = {}

    def digest(self, value: object) -> bytes:
        """Return the digest of a value and all it refers to."""
        summary = hashlib.sha256()
        for piece in self._pieces(value):
            summary.update(len(piece).to_bytes(8, "little") + piece)
        return summary.digest()

    def _pieces(self, value: object) -> Iterator[bytes]:
        kind = type(value)
        yield kind.__name__.encode()
        if value is None or isinstance(value, (bool, int, str, bytes, complex, type(Ellipsis))):
            yield repr(value).encode()
        elif isinstance(value, float):
            yield value.hex().encode()
        elif isinstance(value, (tuple, list)):
            yield from (self.digest(item) for item in value)
        elif isinstance(value, (set, frozenset)):
            yield from sorted(self.digest(item) for item in value)
        elif isinstance(value, dict):
            yield from sorted(self.digest(item) for item in value.items())
        elif isinstance(value, types.CodeType):
            yield from self._of_code(value)
        elif isinstance(value, types.FunctionType):
            yield from self._of_function(value)
        elif isinstance(value, types.ModuleType):
            yield value.__name__.encode()
        elif isinstance(value, type):
            yield f"{value.__module__}.{value.__qualname__}{getattr(value, '_fields', '')}".encode()
        else:
            yield from self._of_object(value)

    def _of_object(self, value: object) -> Iterator[bytes]:
        if hasattr(value, "softlab_content"):  # known already: every kernel that calls it asks
            yield value.softlab_content.encode()
        elif hasattr(value, "py_func"):  # what numba compiles
            yield self.digest(getattr(value, "targetoptions", None))
            yield self.digest(value.py_func)
        elif hasattr(value, "_defn"):  # an intrinsic: the function that writes its code
            yield self.digest(value._defn)
        elif hasattr(value, "dtype") and hasattr(value, "tobytes"):  # numpy's numbers and arrays
            yield f"{value.dtype} {getattr(value, 'shape', ())}".encode()
            yield value.tobytes()
        elif type(value).__module__.split(".")[0] in ("numpy", "numba", "llvmlite"):  # their types, and ufuncs
            yield repr(value).encode()
        elif callable(value) and hasattr(value, "__qualname__"):  # functions of Python itself and of its libraries
            yield f"{value.__module__}.{value.__qualname__}".encode()
        else:
            yield _UNKNOWN

    def _of_function(self, function: types.FunctionType) -> Iterator[bytes]:
        if id(function) in self._entered:
            yield f"entered {self._entered[id(function)]}".encode()
            return
        self._entered[id(function)] = len(self._entered)
        if _package(function.__module__) in FOREIGN:
            yield f"{function.__module__}.{function.__qualname__}".encode()
            return
        yield from self._of_code(function.__code__, function.__doc__)
        yield self.digest((function.__defaults__, function.__kwdefaults__))
        for cell in function.__closure__ or ():
            try:
                yield self.digest(cell.cell_contents)
            except ValueError:  # set later than this is asked
                yield _UNKNOWN
        names = sorted(_names(function.__code__))
        for name in names:
            if name in function.__globals__:
                value = function.__globals__[name]
                yield name.encode() + b"=" + self.digest(value)
                if isinstance(value, types.ModuleType) and _package(value.__name__) not in FOREIGN:
                    yield from (self.digest(vars(value)[inner]) for inner in names if inner in vars(value))

    def _of_code(self, code: types.CodeType, docstring: str | None = None) -> Iterator[bytes]:
        known = _codes.get((id(code), docstring))
        if known is None:
            known = _codes[id(code), docstring] = code, list(self._read(code, docstring))
        yield from known[1]

    def _read(self, code: types.CodeType, docstring: str | None) -> Iterator[bytes]:
        yield code.co_code
        yield self.digest((
            code.co_argcount, code.co_kwonlyargcount, code.co_flags, code.co_names, code.co_varnames, code.co_freevars,
            code.co_cellvars,
        ))  # fmt: skip
        for place, constant in enumerate(code.co_consts):
            yield self.digest(None if place == 0 and docstring is not None and constant == docstring else constant)


def _package(module: str | None) -> str:
    return (module or "").split(".")[0]


def _names(code: types.CodeType) -> set[str]:
    """Return the globals and attributes that a function names, including those of functions inside it."""
    inner = (_names(constant) for constant in code.co_consts if isinstance(constant, types.CodeType))
    return set(code.co_names).union(*inner)


def source_digest(*places: Path) -> str:
    """Return a hash of the Python files among `places` and of all Python files below the folders among them, with their
    relative paths."""
    digest = hashlib.sha256()
    for place in places:
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            name = file.relative_to(place).as_posix() if place.is_dir() else file.name
            digest.update(name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


@cache
def backend_sources(backend: str) -> tuple[Path, ...]:
    """Return the sources of a backend (`cpu` or `gpu`) for `source_digest`: its package, the formulas, the records of
    constants, and the modules of `model` that it imports."""
    package, formulas = ROOT / f"{backend}_backend", ROOT / "model" / "formulas"
    imported = {name.removeprefix("softlab.") for file in package.rglob("*.py") for name in _imported(file)}
    files = {ROOT / f"{name.replace('.', '/')}.py" for name in imported}
    files |= set(
        (ROOT / "model").glob("*/*parameters.py")
    )  # kernels read their fields by name and import nothing of them
    others = (file for file in files if file.is_file() and file.parts[len(ROOT.parts)] == "model")
    return (package, formulas, *sorted(file for file in others if formulas not in file.parents))


def _imported(file: Path) -> Iterator[str]:
    """Return the full names that a source file imports: modules, and names in them, which may be modules too."""
    for node in _statements(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{name.name}" for name in node.names)


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """Return the statements within one, including itself, without expressions, which are twenty times as many."""
    yield node
    for field in ("body", "orelse", "finalbody", "handlers", "cases"):
        inside = getattr(node, field, ())
        for one in inside if isinstance(inside, list) else ():  # a lambda's body is an expression
            yield from _statements(one)


MAX_NAME = 150  # characters: with a module, a hash and a suffix still a file's name, which may have 255


def file_name(name: str) -> str:
    """Return the name, its end replaced by a hash if it is too long for a file. Different names stay different."""
    if len(name) <= MAX_NAME:
        return name
    return f"{name[: MAX_NAME - 17]}_{hashlib.sha256(name.encode()).hexdigest()[:16]}"
