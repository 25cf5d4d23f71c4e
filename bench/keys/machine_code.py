"""Compiled text of recorded kernels, up to names: PTX of CUDA kernels, LLVM IR of CPU kernels.

Two commits whose kernels differ in source may still compile to the same code; then their measurements are of one program.
Works without a GPU where the packages nvidia-nvvm and nvidia-cuda-nvrtc are installed.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator
from typing import Any

from softlab.bench.keys.record import DeviceArray, Launch, combined

COMPUTE_CAPABILITY = (9, 0)
LLVM_NAME = re.compile(r'[@%](?:"[^"]*"|[\w.$]+)')
PTX_NAME = re.compile(r"\b(?:_Z|__cudapy_)\w+")  # of functions and their parameters; registers are numbered already
ELSEWHERE = re.compile(r'^(?:declare\b[^@]*|\.extern\b.*?)(@"[^"]*"|@[\w.$]+|\b_Z\w+)', re.MULTILINE)
DEFINED = re.compile(r'^define\b[^@]*(@"[^"]*"|@[\w.$]+)', re.MULTILINE)
CONTENT = re.compile(  # names in texts: of functions, and of what they are made of; scopes of aliasing
    r"""\[\d+ x i8\] c"[^"]*(?:_Z|_[0-9a-f]{32})[^"]*"|_[0-9a-f]{32}|(?<=!")_Z[^"]*"""
)
NAMED = re.compile(r"^\s*(//.*|;.*|source_filename.*|\.file.*|\.loc.*)$", re.MULTILINE)
COMMON = re.compile(r"^\.common \.global [^;]*?(\w+);\n", re.MULTILINE)  # such as error codes of inlined functions


def without_names(text: str) -> str:
    """Return the text with its own names numbered in order of appearance, without comments, positions in files and unread
    globals. Functions from elsewhere keep their names."""
    text = CONTENT.sub("", NAMED.sub("", text))
    text = COMMON.sub(lambda match: match[0] if text.count(match[1]) > 1 else "", text)
    replacements = {name: name for name in set(ELSEWHERE.findall(text)) - set(DEFINED.findall(text))}
    names = PTX_NAME if ".version" in text else LLVM_NAME
    return names.sub(lambda match: replacements.setdefault(match[0], f"@{len(replacements)}"), text)


def machine_code_key(calls: Iterable[Launch]) -> str:
    """One hash of the code of all kernels among the launches, each for the types of its arguments."""
    texts: dict[tuple[object, ...], str] = {}
    for call in calls:
        types = tuple(map(type_of, call.arguments))
        if (id(call.kernel), types) not in texts:
            texts[id(call.kernel), types] = without_names(_code(call.kernel, types))
    return combined(map(_hash, texts.values()))


def _hash(text: str) -> str:
    import hashlib

    return hashlib.sha256(text.encode()).hexdigest()[:16]


def type_of(argument: object) -> object:
    """Return numba's type of an argument of a recorded call, also of records of arrays that would be on the device."""
    from numba import typeof, types
    from numba.np.numpy_support import from_dtype

    if isinstance(argument, DeviceArray):
        return types.Array(from_dtype(argument.array.dtype), argument.array.ndim, "C")
    if isinstance(argument, tuple):
        members = tuple(map(type_of, argument))
        named = hasattr(argument, "_fields")
        return types.NamedTuple(members, type(argument)) if named else types.BaseTuple.from_types(members)
    return typeof(argument)


def _code(kernel: Any, types: tuple[object, ...]) -> str:
    if type(kernel).__name__ == "CUDADispatcher":
        from numba import cuda

        fast = bool(kernel.targetoptions.get("fastmath"))
        text, _ = cuda.compile_ptx(kernel.py_func, types, cc=COMPUTE_CAPABILITY, fastmath=fast)
        return str(text)
    from numba.core.caching import NullCache

    parts = list(_inner(kernel))
    for part in parts:
        part._cache = NullCache()  # machine code from the disk has no text
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "Inspection disabled")
        kernel.compile(tuple(_folded(kernel, types)))
        texts = [text for part in parts for text in part.inspect_llvm().values()]
    return "\n".join(sorted(texts, key=without_names))


def _folded(kernel: Any, argument_types: tuple[object, ...]) -> Iterator[object]:
    """Yield the types of the arguments by parameter, those of `*arguments` as one tuple."""
    from numba import types

    parameters = list(kernel._compiler.pysig.parameters.values())
    for k, parameter in enumerate(parameters):
        if parameter.kind is parameter.VAR_POSITIONAL:
            yield types.StarArgTuple(argument_types[k:])
        else:
            yield argument_types[k]


def _inner(kernel: Any) -> Iterator[Any]:
    """A compiled function and those that it calls, bodies of parallel kernels among them, which it enters by address."""
    seen: dict[int, object] = {}
    waiting = [kernel]
    while waiting:
        value = waiting.pop()
        if id(value) in seen:
            continue
        seen[id(value)] = value
        if hasattr(value, "py_func"):
            yield value
            value = value.py_func
        if hasattr(value, "__closure__"):
            names = [value.__globals__.get(name) for name in value.__code__.co_names]
            waiting += [
                one for one in (*(c.cell_contents for c in value.__closure__ or ()), *names) if hasattr(one, "py_func")
            ]
