"""The hand-written CUDA C++ cloth: the reference's answer over a driver made of loops, and real machine code from NVRTC."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cloth_scenes import PARTS, cloth_scene
from fake_cuda import SHIM, FakeDriver, compile_for_host

from softlab.bench.peers import compiler, cuda_cpp, cuda_cpp_cloth, cuda_driver
from softlab.bench.peers.base import PeerError
from softlab.bench.reference.mass_spring import simulate
from softlab.model.scene.scene import Scene, load_scene

STEPS = 60
RUN = """
                    cloth_step(*(const Quad **)a[0], *(const Quad **)a[1], *(Quad **)a[2], *(Quad **)a[3], *(int *)a[4],
                               *(int *)a[5], *(Constants *)a[6]);
}
"""
CLOTH_SHIM = SHIM[: SHIM.index("                    grid_step(")].replace(
    '#include "grid.cu"', '#define __align__(bytes) alignas(bytes)\n#include "cloth.cu"'
) + RUN.lstrip("\n")


def launched(
    scene: Scene, precision: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[np.ndarray, np.ndarray]:
    """The state after STEPS steps of the real kernel and the real host code."""
    found = compiler.find_compiler()
    if isinstance(found, str):
        pytest.skip(found)
    damped = cuda_cpp_cloth.ClothConstants(scene, precision).damped
    types = (f"-DReal={'float' if precision == 'float32' else 'double'}", f"-DKIND={precision}{damped}")
    library = compile_for_host(cuda_cpp_cloth.SOURCE, types + damped * ("-DDAMPED",), folder, found[0], CLOTH_SHIM)
    driver = FakeDriver(library)
    monkeypatch.setattr(cuda_driver, "driver", lambda: driver)
    monkeypatch.setattr(cuda_cpp_cloth, "compile_cloth", lambda *_: b"machine code")
    with cuda_cpp_cloth.CudaCppCloth().open(scene, precision, 1) as opened:
        opened.advance(STEPS // 2 + 1)
        opened.advance(STEPS - STEPS // 2 - 1)
        state = opened.read()
    assert not driver.memory  # all freed
    return state


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("name", ["springs", "damped"])
@pytest.mark.parametrize("rows,columns", [(7, 6), (19, 35), (1, 9)])
def test_the_reference_is_met_within_rounding(
    rows: int, columns: int, name: str, precision: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A step rounds a position and its some fifty sums a few epsilon of the sheet's size each; a damped cloth that hardly
    moves in 30 ms adds them up."""
    pinned: Any = [[0, 0]]
    scene = cloth_scene(name, "semi-implicit-euler", rows=rows, columns=columns, pinned=pinned)
    position, velocity = launched(scene, precision, tmp_path, monkeypatch)
    expected, expected_velocity = simulate(scene, STEPS)
    bound = STEPS * 10 * np.finfo(precision).eps * max(1.0, float(np.abs(expected).max()))
    assert np.abs(position - expected).max() < bound
    assert np.abs(velocity - expected_velocity).max() < bound / scene.method.dt
    assert np.abs(position - simulate(scene, 0)[0]).max() > 1000 * np.finfo(np.float32).eps  # it did move


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("damped", [False, True])
def test_the_source_compiles_for_a_real_architecture(damped: bool, precision: str) -> None:
    try:
        code = cuda_cpp_cloth.compile_cloth(precision, damped, "sm_90")
    except PeerError as error:
        if "is not here" in str(error):
            pytest.skip(str(error))
        raise
    assert code.startswith(b"\x7fELF") and b"cloth_step" in code


def test_scenes_that_it_does_not_know_are_refused() -> None:
    refusal = cuda_cpp_cloth.CudaCppCloth().refusal
    assert refusal(load_scene("cloth-warp")) is None
    assert "only cloth" in str(refusal(load_scene("lab-grid").replace({"method.integrator": "semi-implicit-euler"})))
    assert "semi-implicit" in str(refusal(load_scene("cloth-hanging")))
    assert "wind" in str(refusal(cloth_scene("air", "semi-implicit-euler")))
    assert "sphere" in str(refusal(cloth_scene("bodies", "semi-implicit-euler")))
    assert cuda_cpp.CudaCpp().refusal(Scene(PARTS["springs"])) is not None
