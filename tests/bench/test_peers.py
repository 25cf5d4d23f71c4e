"""Peers: the same answer as the lab's, a reason where they cannot run, and a comparison that survives its store."""

import shutil

import numpy as np
import pytest
from fake_cuda import FakeDriver, compile_for_host
from typer.testing import CliRunner

from softlab.bench.experiments.checks import LIMITS
from softlab.bench.peers import compiler, cuda_cpp, cuda_driver
from softlab.bench.peers.base import Opened, PeerError
from softlab.bench.peers.cpp_openmp import SOURCE, CppOpenmp, CppOpenmpBlocked
from softlab.bench.peers.numpy_grid import NumpyGrid
from softlab.bench.peers.registry import OURS, PEERS
from softlab.bench.peers.scenes import SCENES
from softlab.bench.peers.warp_grid import WarpGrid
from softlab.bench.reference.mass_spring import simulate
from softlab.model.base.errors import SceneError
from softlab.model.core.build import build
from softlab.model.scene.scene import load_scene

STEPS = 60
SHAPES = [(1, 1), (1, 7), (7, 1), (23, 19), (40, 530)]  # the last: more than one tile, and bands of many rows


def grid(rows, columns, **changes):
    return load_scene("lab-grid").replace(
        {"grid.rows": rows, "grid.columns": columns, "perturbation.amplitude": 0.05} | changes
    )


def needs_compiler():
    found = compiler.find_compiler()
    if isinstance(found, str):
        pytest.skip(found)
    return found[0]


def assert_same(opened: Opened, scene, precision: str) -> None:
    """The peer's state after STEPS steps is the reference's, to rounding in coordinates as large as the grid.

    In two parts, of which the first is odd: buffers that swap at every step must be found again.
    """
    with opened:
        opened.advance(STEPS // 2 + 1)
        opened.advance(STEPS - STEPS // 2 - 1)
        opened.synchronize()
        position, velocity = opened.read()
        expected, expected_velocity = simulate(scene, STEPS)
        limit = LIMITS[precision] * max(1, max(scene.grid.rows, scene.grid.columns) / 23)
        assert position.dtype == velocity.dtype == np.dtype(precision)
        assert np.abs(position - expected).max() <= limit
        assert np.abs(velocity - expected_velocity).max() <= limit / scene.method.dt
        start = build(scene)  # of the lab's own sine; the reference's is NumPy's
        opened.load(start.position, start.velocity)
        opened.advance(STEPS)
        opened.synchronize()
        np.testing.assert_array_equal(opened.read()[0], position)  # from the start again: the same bits


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("shape", SHAPES)
def test_numpy_gives_the_lab_s_answer(shape, precision):
    scene = grid(*shape)
    assert_same(NumpyGrid().open(scene, precision, 1), scene, precision)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("peer", [CppOpenmp(), CppOpenmpBlocked()], ids=lambda peer: peer.name)
def test_cpp_gives_the_lab_s_answer(peer, precision, threads):
    """Bands, tiles and time levels do not show: one row, one column, fewer rows than threads, several tiles."""
    needs_compiler()
    for shape in SHAPES:
        scene = grid(*shape, **{"grid.pinned": "edges" if min(shape) > 2 else "top-corners"})
        assert_same(peer.open(scene, precision, threads), scene, precision)


def test_loading_the_cpp_peer_leaves_the_arithmetic_of_this_process_alone():
    """-ffast-math, linked into a library by an older g++, would flush denormal numbers to zero from then on."""
    needs_compiler()
    compiler.load_library(SOURCE)
    assert np.float32(1e-40) * np.float32(0.5) > 0


def test_warp_gives_the_lab_s_answer():
    peer = WarpGrid("cpu")
    available, reason = peer.available()
    if not available:
        pytest.skip(reason)
    for precision in peer.precisions:
        scene = grid(23, 19)
        assert_same(peer.open(scene, precision, 1), scene, precision)


# ---------------------------------------------------------------------- CUDA C++ without a GPU


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_the_cuda_source_compiles_for_a_real_architecture(precision):
    try:
        code = cuda_cpp.compile_grid(precision, "sm_90")
    except PeerError as error:
        if "is not here" in str(error):
            pytest.skip(str(error))
        raise
    assert code.startswith(b"\x7fELF") and b"grid_step" in code


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_cuda_cpp_launches_what_it_should(precision, tmp_path, monkeypatch):
    """The real kernel and the real host code over a driver that is made of loops: buffers, arguments, graphs."""
    library = compile_for_host(cuda_cpp.SOURCE, cuda_cpp.TYPES[precision], tmp_path, needs_compiler())
    for shape in [(1, 1), (9, 33), (23, 19)]:
        driver = FakeDriver(library)
        monkeypatch.setattr(cuda_driver, "driver", lambda driver=driver: driver)
        monkeypatch.setattr(cuda_cpp, "compile_grid", lambda *_: b"machine code")
        scene = grid(*shape)
        assert_same(cuda_cpp.CudaCpp().open(scene, precision, 1), scene, precision)
        assert not driver.memory  # all freed
        with cuda_cpp.CudaCpp().open(scene, precision, 1) as opened:
            driver.launches = 0
            opened.advance(2 * 256 + 32 + 4 + 2 + 1)
            assert driver.launches == 2 + 1 + 1 + 1 + 1


def test_without_a_driver_the_reason_is_told(monkeypatch):
    def none():
        raise RuntimeError("no driver\nmany lines")

    monkeypatch.setattr(cuda_driver, "driver", none)
    available, reason = cuda_cpp.CudaCpp().available()
    assert not available and reason.endswith("no driver")


# ---------------------------------------------------------------------- what a peer refuses


@pytest.mark.parametrize("peer", PEERS, ids=lambda peer: peer.name)
def test_every_peer_says_whether_it_is_here_and_which_scenes_it_runs(peer):
    available, text = peer.available()
    assert isinstance(available, bool) and text and "\n" not in text
    for word in peer.scenes:
        (scene,) = SCENES[word].sized(False, [4])
        assert peer.refusal(scene) is None
    refused = peer.refusal(grid(4, 4, **{"method.integrator": "velocity-verlet"}))
    if "grid" not in peer.scenes:
        assert refused
    else:
        assert "verlet" in refused
        assert "external" in peer.refusal(grid(4, 4, **{"external.magnitude": 1.0}))


def test_peers_have_names_of_their_own():
    names = [peer.name for peer in PEERS]
    assert len(set(names)) == len(names) and OURS not in names


def test_without_a_compiler_the_reason_names_the_remedy(monkeypatch):
    compiler.find_compiler.cache_clear()
    monkeypatch.setattr(shutil, "which", lambda _: None)
    monkeypatch.delenv("CXX", raising=False)
    try:
        available, reason = CppOpenmp().available()
        assert not available and "install g++" in reason
    finally:
        compiler.find_compiler.cache_clear()


def test_a_source_that_does_not_compile_is_a_reason(tmp_path, monkeypatch):
    needs_compiler()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    source = tmp_path / "bad.cpp"
    source.write_text("this is no C++\n")
    with pytest.raises(PeerError, match="refuses the source"):
        compiler.load_library(source)
    assert not list(tmp_path.rglob("*.so"))


@pytest.mark.parametrize(
    "arguments",
    [
        ["--size", "0"],
        ["--backend", "tpu"],
        ["--max-seconds", "-1"],
        ["--precision", "float16"],
        ["--repeats", "0"],
        ["--kernels"],
        ["--scene", "lab-grid"],
    ],
)
def test_bad_choices_are_refused_in_a_line(arguments, tmp_path):
    from softlab.cli import app

    result = CliRunner().invoke(app, ["sweep", "--peers", "--store", str(tmp_path / "r.sqlite"), *arguments])
    assert isinstance(result.exception, SceneError)
