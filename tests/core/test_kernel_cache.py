"""Machine code on disk: compiled once, told while it is, done without where it cannot be kept."""

from __future__ import annotations

import errno
import os
import warnings
from typing import Any

import numpy as np
import pytest
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base import kernel_cache
from softlab.model.base.kernel_cache import KernelCacheWarning, watched


@pytest.fixture(autouse=True)
def kept(tmp_path, monkeypatch):
    """A folder of its own, nothing told yet."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    for memory in (kernel_cache.folder, kernel_cache._seconds, kernel_cache._delete_oldest):
        memory.cache_clear()
    monkeypatch.setattr(kernel_cache, "_warned", set())
    yield tmp_path / "softlab-kernels"
    for memory in (kernel_cache.folder, kernel_cache._seconds, kernel_cache._delete_oldest):
        memory.cache_clear()


def compiled(factor: float = 2.0, variant: str = "test") -> list[tuple[str, float | None]]:
    """What a watcher is told while a small kernel of that content runs for the first time in a process."""

    def scale(values):
        for k in prange(values.size):
            values[k] *= factor

    told: list[tuple[str, float | None]] = []
    values = np.ones(3)
    with watched(lambda label, seconds: told.append((label, seconds))):
        Compiler(variant, "exact").kernel(scale)(values)
    assert np.array_equal(values, [factor] * 3)
    return told


def test_a_kernel_is_compiled_once_whatever_its_variant_is_called():
    assert compiled() == [("scale test", None)]
    assert compiled() == [] == compiled(variant="another")
    ((label, seconds),) = compiled(3.0)  # other content under the same label: told how long that took last time
    assert label == "scale test" and seconds is not None and seconds > 0


def test_the_time_it_took_is_known_to_the_next_process():
    compiled()
    kernel_cache._seconds.cache_clear()
    assert compiled(3.0)[0][1] is not None


def test_a_damaged_file_is_compiled_anew(kept):
    compiled()
    for file in kept.glob("scale*"):
        file.write_bytes(b"no machine code")
    assert len(compiled()) == 1
    assert compiled() == []


def test_a_full_disk_costs_time_and_is_told_once(kept, monkeypatch):
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    with pytest.warns(KernelCacheWarning, match="No space left") as told:
        assert len(compiled()) == 1 and len(compiled()) == 1
    assert len(told) == 1
    assert not [file for file in kept.iterdir() if "tmp" in file.name], "a part file was left behind"


def test_ctrl_c_in_the_compiler_s_callback_is_not_lost(kept):
    """Python drops an exception in LLVM's callback, which then has not stored the code."""

    class Interrupted:
        def save_overload(self, sig, data):
            raise RuntimeError(f"no compiled object yet for {data}")

    class Cache(kernel_cache.NotifyingCache, Interrupted):
        label = "interrupted"

    with pytest.raises(KeyboardInterrupt):
        Cache().save_overload((), "a library")


def test_without_a_writable_folder(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))  # below a file nothing can be made, not even by root
    kernel_cache.folder.cache_clear()
    with pytest.warns(KernelCacheWarning, match="NUMBA_CACHE_DIR"):
        compiled()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compiled()


def test_the_longest_unused_goes_first(kept, monkeypatch):
    compiled()
    compiled(3.0)
    old, new = sorted(kept.glob("*.nbi"), key=lambda file: file.stat().st_mtime)
    os.utime(old, (2e9, 2e9))  # used again
    for file in kept.glob("*.nbc"):
        os.utime(file, (1e9, 1e9))
    os.utime(new, (1e9, 1e9))
    held = sum(file.stat().st_size for file in kept.glob("*.nb?"))
    monkeypatch.setattr(kernel_cache, "MAX_BYTES", held - 1)
    kernel_cache._delete_oldest.cache_clear()
    kernel_cache._delete_oldest()
    left = {file.name.split(".")[0] for file in kept.glob("*.nb?")}
    assert left <= {old.name.split(".")[0]} and not new.exists()


def test_a_terminal_is_told_what_is_compiled():
    import io

    from rich.console import Console

    from softlab.app.command.command_line import compilations_shown

    def said(terminal: bool, *compilations: tuple[str, float | None]) -> str:
        console = Console(file=io.StringIO(), force_terminal=terminal, soft_wrap=True, highlight=False)
        with compilations_shown(console):
            for watcher in list(kernel_cache._watchers):
                for label, seconds in compilations:
                    watcher(label, seconds)
        return console.file.getvalue()

    assert said(True, ("advance team", None)) == "compiling advance team: for the first time here\n"
    assert (
        said(True, ("advance team", 12.3), ("first_diverged 2d", 0.4))
        == "compiling advance team: took 12 s last time\n"
    )
    assert said(False, ("advance team", None)) == ""
