"""Compilation of a C++ source of this folder at run time, into a cache folder, once per source and compiler."""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from softlab.bench.peers.base import PeerError
from softlab.cpu_backend.core.processor import processor_name
from softlab.model.base.disk_cache import cache_folder

# g++ first: it shares its OpenMP threads with numba, while two teams would disturb each other
COMPILERS = ("g++", "clang++")
COMPILE = ("-std=c++17", "-O3", "-march=native", "-ffast-math", "-fopenmp", "-fPIC", "-c")
# Linked separately and without -ffast-math: with it, g++ before 13 adds start-up code that flushes denormal numbers to
# zero in the thread that loads the library, which would change the arithmetic of the whole process.
LINK = ("-shared", "-fopenmp")
TIMEOUT = 120  # s


@cache
def find_compiler() -> tuple[str, str] | str:
    """Return (path, first line of --version) of a C++ compiler with OpenMP, or the reason why there is none."""
    asked = os.environ.get("CXX")
    names = (asked,) if asked else COMPILERS
    for name in names:
        path = shutil.which(name)
        if path is None:
            continue
        try:
            text = subprocess.run([path, "--version"], capture_output=True, text=True, timeout=TIMEOUT).stdout
        except (OSError, subprocess.SubprocessError) as error:
            return f"{name} does not start ({error})"
        return path, (text.splitlines() or [name])[0]
    return f"no C++ compiler ({', '.join(names)}); install g++, or set CXX"


@cache
def load_library(source: Path) -> ctypes.CDLL:
    """Return the source as a loaded library. Raises PeerError (no compiler, it fails, the library does not load)."""
    compiler_or_reason = find_compiler()
    if isinstance(compiler_or_reason, str):
        raise PeerError(compiler_or_reason)
    compiler, version = compiler_or_reason
    parts = (source.read_text(encoding="utf-8"), version, " ".join((*COMPILE, *LINK)), processor_name())
    key = hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]
    folder = cache_folder("peers")
    library = folder / f"{source.stem}-{key}.so"
    try:
        if not library.exists():
            with tempfile.TemporaryDirectory(dir=folder) as work:
                compiled, linked = Path(work) / "grid.o", Path(work) / "grid.so"
                _call([compiler, *COMPILE, str(source), "-o", str(compiled)])
                _call([compiler, *LINK, str(compiled), "-o", str(linked)])
                os.replace(linked, library)  # atomic, so that a second process never loads half a file
        return ctypes.CDLL(str(library))
    except OSError as error:
        raise PeerError(f"the compiled library cannot be used: {error}") from None


def _call(command: list[str]) -> None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT)
    except subprocess.SubprocessError as error:
        raise PeerError(f"the compiler did not finish: {error}") from None
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if "error" in line] or done.stderr.splitlines() or ["?"]
        raise PeerError(f"{Path(command[0]).name} refuses the source: {lines[0]}")
