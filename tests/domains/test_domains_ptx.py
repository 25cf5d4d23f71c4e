"""The kernels that carry borders, compiled to PTX with no GPU: what they ask of the memory of the whole system."""

from typing import Any

import numpy as np
import pytest
from kernel_text import entry_of

pytestmark = pytest.mark.usefixtures("ptx_compiler")


def text(name: str, real: Any, axes: int = 2) -> str:
    from numba import types

    from gpu_backend.domains.kernels import make_border_kernels

    pair = (types.complex64 if real is np.float32 else types.complex128)[::1]
    state = pair if axes == 2 else (types.float32 if real is np.float32 else types.float64)[::1]
    epoch, flags, number = types.int32[::1], types.int32[::1], types.int32
    signatures = {
        "pull": (state, state, number, state, state, number, number),
        "push": (state, state, number, number, pair, flags, epoch),
        "take": (state, state, number, number, pair, flags, epoch, flags),
        "count_on": (epoch,),
    }
    kernel = getattr(make_border_kernels(real, axes), name)
    return entry_of(kernel.py_func, signatures[name], "exact")


@pytest.mark.parametrize("name", ["pull", "push", "take", "count_on"])
@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("axes", [2, 3])
def test_borders_travel_whole(axes: int, name: str, real: Any) -> None:
    """A mass in a plane is one access of both axes; float32 has no double, nothing lies in local memory."""
    found = text(name, real, axes)
    assert ".local" not in found
    assert real is np.float64 or ".f64" not in found
    if name in ("pull", "push") and axes == 2:
        assert found.count("ld.global.v2.") == 2 and found.count("st.global.v2.") == 2


def test_flags_are_seen_by_other_gpus() -> None:
    """A release after a fence of the whole system, an acquire before the inbox is read past the first-level cache."""
    push, take = text("push", np.float32), text("take", np.float32)
    assert push.index("membar.sys" if "membar.sys" in push else "fence") < push.index("st.release.sys.global.s32")
    assert take.index("ld.acquire.sys.global.s32") < take.index("ld.relaxed.gpu.global.v2.f32")
    assert "%globaltimer" in take
