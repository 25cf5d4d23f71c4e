"""The CPU kernels as plain Python: the same results without compiling, as CUDA's simulator gives them.

With SOFTLAB_PLAIN_PYTHON=1 in the environment, or after `plain_python(True)`, calling a kernel runs its Python source:
the kernel and every function it calls, with NumPy scalars for numbers. In `exact` math the bits equal those of the
compiled kernel; `fast` math, which may round differently, is computed as `exact`. Breakpoints in formulas work. A step
of 64 masses takes milliseconds instead of seconds of compiling, one of a million masses takes minutes.

Intrinsics, which only machine code has, have an equivalent next to them (see `in_python`). One thread runs all bands in
sequence: kernels whose threads wait for each other notice that the others are missing and take their serial branch.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from types import CellType, FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numba
import numpy as np
from numba._dispatcher import Dispatcher as BaseDispatcher
from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher

SWITCH = "SOFTLAB_PLAIN_PYTHON"
SECONDS = "SOFTLAB_PLAIN_PYTHON_SECONDS"

_equivalents: dict[Any, Callable] = {}  # of intrinsics, and of functions that differ on one thread
_translated: dict[Any, Callable] = {}
_machine_code = BaseDispatcher.__call__  # the normal call of a kernel
_left = math.inf  # seconds until machine code takes over
_end = math.inf  # process time [s] at which the current call has to end


class TooLong(Exception):
    """Raised when a call in plain Python takes longer than compiling would."""


def still_time() -> None:
    """Raise TooLong if the call has used up its time; called by loops over bands and over parts of a team's work."""
    if time.process_time() > _end:
        raise TooLong


def _each(*bounds: int) -> Iterator[int]:
    """Iterate as prange does, in plain Python."""
    for k in range(*bounds):
        still_time()
        yield k


def in_python(machine_code: Any) -> Callable[[Callable], Callable]:
    """Declare the decorated function the plain equivalent of an intrinsic or compiled function."""

    def declare(function: Callable) -> Callable:
        _equivalents[machine_code] = function
        return function

    return declare


def _sqrt(number: Any) -> Any:
    """Return the square root in the argument's type, NaN if negative; that of a float32 via float64 is exact."""
    return type(number)(math.sqrt(number)) if number >= 0 else number - number + math.nan * number


def _whole(kind: Any) -> Callable[[Any], Any]:
    def convert(number: Any) -> Any:
        try:
            return kind(number)
        except (ValueError, OverflowError):  # NaN and numbers out of range, for which processors also return a value
            return np.asarray(number).astype(kind)[()]

    return convert


class _Numpy(SimpleNamespace):
    """numpy with conversions that raise no errors."""

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)


_replaced: dict[Any, Any] = {
    math.sqrt: _sqrt,
    numba.prange: _each,
    np: _Numpy(int32=_whole(np.int32), int64=_whole(np.int64), uint32=_whole(np.uint32), uint64=_whole(np.uint64)),
}


def _plainly(value: Any) -> Any:
    """Return the replacement of a global or closed-over value of a compiled function."""
    if isinstance(value, tuple):
        return tuple(_plainly(item) for item in value)
    if isinstance(value, Dispatcher):
        return translated(value)
    if callable(value) or isinstance(value, ModuleType):
        return _equivalents.get(value, _replaced.get(value, value))
    return value


def translated(dispatcher: Any) -> Callable:
    """Return the plain function of a compiled one; all that it calls is plain too."""
    if dispatcher in _equivalents:
        return _equivalents[dispatcher]
    if dispatcher not in _translated:
        function = dispatcher.py_func
        names = {k: _plainly(v) for k, v in function.__globals__.items() if k in function.__code__.co_names}
        names["__builtins__"] = __builtins__
        cells = tuple(CellType(_plainly(cell.cell_contents)) for cell in function.__closure__ or ())
        _translated[dispatcher] = FunctionType(
            function.__code__, names, function.__name__, function.__defaults__, cells
        )
    return _translated[dispatcher]


def _is_dispatcher(dispatcher: Any) -> bool:
    """Return True if a kernel has machine code, from this process or cached."""
    return bool(dispatcher.overloads) or getattr(dispatcher._cache, "has_any", False)


def _arrays(arguments: Any) -> Iterator[np.ndarray]:
    """Iterate over all arrays that a call may write to, in tuples too."""
    for argument in arguments:
        if isinstance(argument, np.ndarray) and argument.flags.writeable:
            yield argument
        elif isinstance(argument, tuple):
            yield from _arrays(argument)


def _call(dispatcher: Any, *arguments: Any) -> Any:
    global _left, _end
    if _left < math.inf and _is_dispatcher(dispatcher):
        numba.set_num_threads(
            numba.get_num_threads()
        )  # starts the threads: cached code of a team may be called before any solver did
        return _machine_code(dispatcher, *arguments)
    begin = time.process_time()
    before = [(array, array.copy()) for array in _arrays(arguments)] if _left < math.inf else []
    _end = begin + _left
    try:
        with np.errstate(all="ignore"):  # quotients by zero and overflows give numbers, as in machine code
            return translated(dispatcher)(*(readable(argument) for argument in arguments))
    except TooLong:
        for array, copy in before:
            array[...] = copy
        plain_python(False)  # the next kernels would take too long, too
        return dispatcher(*arguments)
    finally:
        _left -= time.process_time() - begin


class Constants:
    """The values of a record of equal types, by attribute or by name, thirty times as fast as in numpy's own."""

    def __init__(self, record: np.record):
        values = np.frombuffer(record.tobytes(), record.dtype[0])
        self.__dict__.update(zip(record.dtype.names or (), values, strict=True))

    def __getitem__(self, name: str) -> Any:
        return self.__dict__[name]

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"no constant {name}; there are {', '.join(self.__dict__)}")


def readable(argument: Any) -> Any:
    """Return an argument in the form that plain Python takes.

    A Python number becomes a 64-bit one, as in machine code; records, and arrays of one record, also in tuples, become
    `Constants`, except those of several types, which kernels write.
    """
    if type(argument) is float:
        return np.float64(argument)
    if type(argument) is np.record:
        return Constants(argument)
    if type(argument) is np.ndarray and argument.dtype.names:
        types = {argument.dtype[name] for name in argument.dtype.names}
        return (Constants(argument[0]),) if len(types) == 1 else argument
    if type(argument) is tuple:
        return tuple(readable(item) for item in argument)
    return argument


def plain_python(on: bool, seconds: float = math.inf) -> None:
    """Make calls of kernels run their source (True) or their machine code (False) from now on.

    `seconds`: process time after which machine code takes over, with the same bits in `exact` math; existing machine
    code runs at once.
    """
    global _left
    _left = seconds
    if on:
        setattr(CPUDispatcher, "__call__", _call)  # noqa: B010 - nothing is asked, and lost, when kernels run compiled
    elif is_plain():
        delattr(CPUDispatcher, "__call__")


def is_plain() -> bool:
    """Return True if kernels run as plain Python."""
    return CPUDispatcher.__dict__.get("__call__") is _call


if os.environ.get(SWITCH, "0") not in ("", "0"):
    plain_python(True, float(os.environ.get(SECONDS, "inf")))
