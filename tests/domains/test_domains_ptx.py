"""The kernels that carry borders, compiled to PTX with no GPU: what they ask of the memory of the whole system."""

from typing import Any

import numpy as np
import pytest
from kernel_text import entry_of

pytestmark = pytest.mark.usefixtures("ptx_compiler")


def text(name: str, unit: Any) -> str:
    from numba import types

    from softlab.gpu_backend.domains.kernels import make_border_kernels

    units = (types.complex64 if unit is np.complex64 else types.complex128)[::1]
    counts, number = types.int32[::1], types.int32
    signatures = {
        "pull_some": (units, units, counts, units, units, counts, number),
        "push": (units, units, number, number, units, counts, counts),
        "wait": (counts, number, counts, counts),
        "take": (units, units, number, number, units, counts),
    }
    return entry_of(getattr(make_border_kernels(unit), name).py_func, signatures[name], "exact")


@pytest.mark.parametrize("name", ["pull_some", "push", "take"])
@pytest.mark.parametrize("unit, bytes_each", [(np.complex64, 8), (np.complex128, 16)])
def test_borders_travel_whole(unit: Any, bytes_each: int, name: str) -> None:
    """A unit is one access, of a position and of a velocity; nothing lies in local memory, nothing is computed of it."""
    found, word = text(name, unit), f"v2.{'f32' if bytes_each == 8 else 'f64'}"
    assert ".local" not in found
    assert found.count(f".global.{word}") == 4, "two loads and two stores"
    assert not any(f"{operation}.f" in found for operation in ("add", "mul", "fma", "cvt"))


def test_flags_are_seen_by_other_gpus() -> None:
    """A release after the block's barrier, which follows all that it wrote; an acquire, and a clock that ends the wait; then
    the inbox is read past the first-level cache."""
    push, wait, take = (text(name, np.complex128) for name in ("push", "wait", "take"))
    assert push.rindex("st.global.v2") < push.rindex("bar.sync") < push.index("st.release.sys.global.s32")
    assert wait.index("ld.acquire.sys.global.s32") < wait.rindex("bar.sync") and "%globaltimer" in wait
    assert take.count("ld.relaxed.gpu.global.v2.f64") == 2
