"""CUDA C++ with temporal blocking: the reference's answer over coroutines for threads, and real machine code from NVRTC."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fake_cuda import FakeBlocks, compile_blocks

from softlab.bench.experiments.checks import LIMITS
from softlab.bench.peers import compiler, cuda_cpp_blocked, cuda_driver, once
from softlab.bench.peers.base import PeerError
from softlab.bench.peers.cuda_cpp import CudaConstants
from softlab.bench.peers.cuda_cpp_blocked import (
    ONE_BLOCK,
    ONE_BLOCK_TILES,
    PASS_TILES,
    RESIDENT,
    RESIDENT_TILES,
    TILES,
    Blocked,
    Tile,
    candidates,
)
from softlab.bench.peers.numpy_grid import NumpyGrid
from softlab.bench.reference.mass_spring import simulate
from softlab.gpu_backend.core.device import gpu_available, simulated
from softlab.model.scene.scene import Scene, load_scene

STEPS = 60
PROCESSORS = 132  # of an H200
# kernel, tile, (rows, columns): one block, blocks of both widths of a lane, last tiles that are nearly empty or full
CASES = [
    (ONE_BLOCK, Tile(1, 4, 3, 1), (11, 30)),
    (ONE_BLOCK, Tile(2, 2, 4, 1), (8, 64)),
    (TILES, Tile(1, 2, 3, 2), (1, 1)),
    (TILES, Tile(1, 2, 3, 2), (11, 61)),
    (TILES, Tile(2, 3, 4, 3), (23, 119)),
    (RESIDENT, Tile(1, 4, 3, 3), (25, 75)),
    (RESIDENT, Tile(2, 3, 3, 2), (19, 125)),
]


def grid(rows: int, columns: int) -> Scene:
    return load_scene("lab-grid").replace(
        {
            "grid.rows": rows,
            "grid.columns": columns,
            "perturbation.amplitude": 0.05,
            "grid.pinned": "edges" if min(rows, columns) > 2 else "top-corners",
        }
    )


@pytest.fixture
def driver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeBlocks:
    """Threads that are coroutines in the place of the driver and the compiler."""
    found = compiler.find_compiler()
    if isinstance(found, str):
        pytest.skip(found)
    fake = FakeBlocks()

    def compiled(tile: Tile, _: str) -> bytes:
        return compile_blocks(cuda_cpp_blocked.SOURCE, tile.definitions, tmp_path, found[0])

    monkeypatch.setattr(cuda_driver, "driver", lambda: fake)
    monkeypatch.setattr(cuda_cpp_blocked, "compile_blocked", compiled)
    return fake


@pytest.mark.parametrize("kernel,tile,shape", CASES, ids=lambda part: getattr(part, "name", str(part)))
def test_the_reference_is_met_within_rounding(
    kernel: str, tile: Tile, shape: tuple[int, int], driver: FakeBlocks
) -> None:
    """In parts that are no multiple of the halo: buffers that swap, borders that take turns, flags that count on."""
    scene = grid(*shape)
    with Blocked(CudaConstants(scene, "float32"), "float32", kernel, tile) as peer:
        for steps in (2 * tile.halo + 1, 1, STEPS - 2 * tile.halo - 2):
            peer.advance(steps)
        position, velocity = peer.read()
        expected, expected_velocity = simulate(scene, STEPS)
        limit = LIMITS["float32"] * max(1, max(shape) / 23)
        assert np.abs(position - expected).max() <= limit
        assert np.abs(velocity - expected_velocity).max() <= limit / scene.method.dt
        peer.load(*simulate(scene, 0))
        peer.advance(STEPS)
        np.testing.assert_allclose(peer.read()[0], position, atol=limit)
    assert not driver.memory  # all freed


def test_a_block_that_gave_up_is_told(driver: FakeBlocks) -> None:
    with Blocked(CudaConstants(grid(11, 40), "float32"), "float32", RESIDENT, Tile(1, 2, 3, 2)) as peer:
        driver.memory[int(peer._exchanged[-1])][0] = 1
        with pytest.raises(PeerError, match="waited too long"):
            peer.read()


def test_the_quickest_tile_is_kept_and_what_cannot_be_opened_left_out(
    driver: FakeBlocks, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = grid(9, 40)
    choices = [(TILES, Tile(1, 2, 3, 2)), (RESIDENT, Tile(1, 4, 3, 3)), (ONE_BLOCK, Tile(2, 4, 3, 1))]
    seconds = {TILES: 2.0, ONE_BLOCK: 1.0}
    monkeypatch.setattr(cuda_cpp_blocked, "_trial", lambda peer: seconds[peer.kernel_kind])
    monkeypatch.setattr(FakeBlocks, "cuLaunchCooperativeKernel", lambda *_: (720,))  # too many blocks
    with cuda_cpp_blocked.quickest(CudaConstants(scene, "float32"), "float32", choices) as peer:
        assert peer.kernel == f"{ONE_BLOCK} {choices[2][1].name}"
        peer.advance(STEPS)
        assert np.abs(peer.read()[0] - simulate(scene, STEPS)[0]).max() <= LIMITS["float32"] * 40 / 23
    assert not driver.memory
    with pytest.raises(PeerError, match=f"{RESIDENT} .*720"):
        cuda_cpp_blocked.quickest(CudaConstants(scene, "float32"), "float32", choices[1:2])


def test_once_tells_of_every_tile(driver: FakeBlocks, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """`python -m softlab.bench.peers.once`, where the others are not here."""
    choices = [(TILES, Tile(1, 3, 3, 2)), (RESIDENT, Tile(1, 4, 3, 3))]
    monkeypatch.setattr(cuda_cpp_blocked, "candidates", lambda *_: choices)
    monkeypatch.setattr(once, "TRIAL", 4)
    monkeypatch.setattr(once, "PEERS", [cuda_cpp_blocked.CudaCppBlocked(), NumpyGrid()])
    assert once.main(["--scene", "grid", "--size", "15"]) == 0
    told = capsys.readouterr().out
    assert told.count(": ok,") == 2 and "0 failed" in told
    assert once.main(["--scene", "grid", "--size", "9", "--backend", "cpu"]) == 0
    assert "numpy: ok" in capsys.readouterr().out
    monkeypatch.setattr(cuda_cpp_blocked, "candidates", lambda *_: [(ONE_BLOCK, Tile(1, 2, 3, 1))])  # too low
    assert once.main(["--scene", "grid", "--size", "15"]) == 1
    assert "WRONG" in capsys.readouterr().out


@pytest.mark.parametrize("tile", [Tile(1, 4, 8, 8), Tile(2, 8, 16, 4), PASS_TILES[0]], ids=lambda tile: tile.name)
def test_the_source_compiles_for_a_real_architecture(tile: Tile) -> None:
    try:
        code = cuda_cpp_blocked.compile_blocked(tile, "sm_90")
    except PeerError as error:
        if "is not here" in str(error):
            pytest.skip(str(error))
        raise
    assert code.startswith(b"\x7fELF") and b"grid_resident" in code and b"grid_tiles" in code


@pytest.mark.parametrize("tile", [*ONE_BLOCK_TILES, *RESIDENT_TILES, *PASS_TILES], ids=lambda tile: tile.name)
def test_tiles_cover_a_grid_and_no_halo_spans_two_neighbours(tile: Tile) -> None:
    assert tile.warps <= 32 and tile.across * tile.down <= 32
    assert 2 * tile.warps * 2 * tile.width * 8 <= 48 << 10  # bytes of shared memory that a kernel may name
    if tile in ONE_BLOCK_TILES:
        return
    assert min(tile.width, tile.height) >= 3 * tile.halo
    for masses in range(tile.height + 1, 4 * tile.height):
        _, count = tile.blocks(masses, 1)
        own = tile.height - 2 * tile.halo
        last = masses - ((count - 1) * own + tile.halo)  # what the last tile owns
        assert count > 1 and tile.halo <= last <= tile.height - tile.halo


def test_every_size_has_a_candidate() -> None:
    for size in (1, 31, 32, 64, 65, 128, 256, 512, 1024, 2048, 8192):
        found = candidates(size, size, PROCESSORS)
        assert 1 <= len(found) <= 2 + 4 + len(PASS_TILES)
        assert (size <= 64) == any(kernel == ONE_BLOCK for kernel, _ in found)
        assert (size >= 512) == any(kernel == TILES for kernel, _ in found)
    assert any(kernel == RESIDENT for kernel, _ in candidates(1024, 1024, PROCESSORS))


@pytest.mark.gpu
@pytest.mark.parametrize("word", ["grid", "cloth", "xpbd", "implicit-16"])
def test_every_peer_of_a_real_gpu_gives_the_lab_s_answer(word: str) -> None:
    able, reason = gpu_available()
    if not able or simulated():
        pytest.skip(reason or "kernels run under the simulator")
    assert once.main(["--backend", "gpu", "--scene", word]) == 0
