"""Machine code cached on disk, for both backends: its folder, reports while a kernel compiles, compile times.

numba's own caches key a function by its place in a source file and by its closure, which here contains other compiled
functions and so differs in every process. Kernels here have their content in their name (model/base/digest.py), so that
one folder of the user's cache serves every checkout, and a kernel is compiled again only if something that it is made
of has changed. cpu_backend/core/compile.py and gpu_backend/core/compile.py mix these classes into numba's cache
classes; nothing here needs numba.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
import warnings
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from softlab.model.base.disk_cache import user_cache
from softlab.model.base.errors import InputError
from softlab.model.base.files import replacing
from softlab.model.base.waiting import Watchers

MAX_BYTES = 1 << 30  # of cached machine code; above it the half that was unused for longest is deleted
SECONDS = "seconds.json"  # of each kernel's last compilation, by label
_watchers = Watchers()
watched = _watchers.watched  # its watcher(label, seconds): a kernel that starts to compile, and its previous time
_begun: dict[str, float] = {}
_warned: set[str] = set()


class KernelCacheWarning(UserWarning):
    """Machine code cannot be cached: every run compiles again."""


@cache
def folder() -> Path | None:
    """Return the folder of cached machine code: below NUMBA_CACHE_DIR if that is set, else in the user's cache; None
    where neither can be written."""
    base = os.environ.get("NUMBA_CACHE_DIR")
    place = Path(base) / "softlab-kernels" if base else user_cache("kernels")
    if place is None:
        return None
    with suppress(OSError):
        place.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=place).close()
        return place
    return None


@cache
def _seconds() -> dict[str, float]:
    place = folder()
    with suppress(OSError, ValueError, AttributeError):
        known = json.loads((place / SECONDS).read_text()) if place else {}
        return {str(label): float(value) for label, value in known.items()}
    return {}


def _begin(label: str) -> None:
    _begun[label] = time.perf_counter()
    _watchers.notify(label, _seconds().get(label))


def _end(label: str) -> None:
    begun = _begun.pop(label, None)
    if begun is not None:
        _seconds()[label] = round(time.perf_counter() - begun, 3)


def attach_cache(dispatcher: Any, kernel_cache: type, label: str) -> None:
    """Give a numba dispatcher a cache of type `kernel_cache`, where one can be written. `label`: passed to watchers."""
    try:
        dispatcher._cache = kernel_cache(dispatcher.py_func)
        dispatcher._cache.label = label
    except (RuntimeError, OSError):
        _unwritable("no folder for it can be written; NUMBA_CACHE_DIR names another")


def _unwritable(reason: object) -> None:
    """Warn once per process: a cache that cannot be written only costs time."""
    if "unwritable" not in _warned:
        _warned.add("unwritable")
        text = f"machine code cannot be cached ({reason}): every run compiles again"
        warnings.warn(text, KernelCacheWarning, stacklevel=2)


@cache
def _delete_oldest() -> None:
    """Once per process, if the cache exceeds MAX_BYTES, delete the files that were unused for longest until half is
    free."""
    place = folder()
    with suppress(OSError):
        files = list(place.glob("*.nb?")) if place else []
        size = sum(file.stat().st_size for file in files)
        if size <= MAX_BYTES:
            return
        used: dict[str, float] = {}  # time of a kernel's last use: its index is touched then, its code is not
        for file in files:
            kernel = file.name.split(".")[0]
            used[kernel] = max(used.get(kernel, 0.0), file.stat().st_mtime)
        for file in sorted(files, key=lambda file: used[file.name.split(".")[0]]):
            size -= file.stat().st_size
            file.unlink(missing_ok=True)
            if size < MAX_BYTES // 2:
                break


class Place:
    """Replacement of numba's cache locators: one folder for all kernels."""

    @classmethod
    def from_function(cls, py_func: object, py_file: str) -> Place | None:
        """Return the cache of a function, or None if no folder is writable."""
        return cls() if folder() else None

    def ensure_cache_path(self) -> None:
        """Create the folder."""
        Path(self.get_cache_path()).mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """Return the folder of all kernels."""
        return str(folder())

    def get_source_stamp(self) -> str:
        """Return '': a kernel's content is in its name."""
        return ""

    def get_disambiguator(self) -> str:
        """Return '', for the same reason."""
        return ""


class NamedByContent:
    """Mixin of numba's cache implementations: a file has the kernel's name, which contains its content."""

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        """Return the kernel's name and its Python version."""
        return f"{fullname.partition('.')[2]}.py{sys.version_info[0]}{sys.version_info[1]}{abiflags}"


@cache
def _versions() -> tuple[str, ...]:
    """Return the compilers' versions: code of one version may not run with another."""
    versions = []
    for package in ("numba", "llvmlite", "numba-cuda"):
        with suppress(PackageNotFoundError):
            versions.append(f"{package} {version(package)}")
    return tuple(versions)


class NotifyingCache:
    """Mixin of numba's function caches: notifies watchers, and continues without files that cannot be read or
    written."""

    _cache_file: Any
    label: str

    def _index_key(self, sig: object, codegen: Any) -> tuple[object, ...]:
        return sig, codegen.magic_tuple(), _versions()

    @property
    def has_any(self) -> bool:
        """True if machine code of this function is cached for some argument types."""
        return os.path.exists(self._cache_file._index_path)

    def load_overload(self, sig: object, target_context: object) -> object:
        """Return the machine code for these types, or None if it must be compiled, after notifying watchers."""
        try:
            overload = super().load_overload(sig, target_context)  # type: ignore[misc]
        except Exception:  # a damaged file, or one that refers to modules of another version, can fail anywhere
            overload = None
            with suppress(OSError):
                os.unlink(self._cache_file._index_path)
        if overload is None:
            _begin(self.label)
        else:
            with suppress(OSError):
                os.utime(self._cache_file._index_path)
        return overload

    def save_overload(self, sig: object, data: object) -> None:
        """Cache machine code for these types, if it can be written."""
        _end(self.label)
        try:
            _delete_oldest()
            super().save_overload(sig, data)  # type: ignore[misc]
            _save_seconds()
        except OSError as error:
            _unwritable(error.strerror or error)
        except InputError as error:
            _unwritable(error)
        except RuntimeError as error:  # LLVM's callback has not stored the code
            if "no compiled object" not in str(error):
                raise
            raise KeyboardInterrupt from error  # Ctrl-C fell into the callback, where Python drops it


def _save_seconds() -> None:
    """Write the compile times under another name first; times that other processes wrote meanwhile may be lost."""
    place = folder()
    assert place is not None  # it was written to just now
    with replacing(place / SECONDS) as part:
        part.write_text(json.dumps(_seconds(), indent=0, sort_keys=True))
