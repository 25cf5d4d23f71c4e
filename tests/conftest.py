"""Shared by the tests: how to open a scene on each backend.

Tests of physics run in `exact` math and, unless they say otherwise, in float64, so that their tolerances follow from
the equations alone.
"""

import gc
import os
import sys
import time

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before numba: spinning idle threads starve a small machine
os.environ.setdefault("SOFTLAB_COMMIT", "0123456789ab")  # so that what measures does so from changed files, too

from collections.abc import Callable
from fnmatch import fnmatch
from functools import cache
from types import SimpleNamespace
from typing import Any

import pytest
from over_a_second import OVER_A_SECOND
from tiers import COMPILED, ONLY_THOROUGH, THINNED
from variants import covering

from softlab.cpu_backend.core.threads import core_count  # before numba: it asks for four times the cores

MAX_WORKERS = 8  # each may take a gigabyte
DEAR = ("test_cuda_simulator.py", "test_compiled.py")  # files that workers begin with and share
LAST = {"app", "assets", "bench", "cluster", "command", "panel", "plots"}  # folders: physics comes before them
BEGUN = time.monotonic()


@pytest.fixture(params=["cpu", pytest.param("gpu", marks=pytest.mark.gpu)])
def backend(request: pytest.FixtureRequest) -> str:
    """`cpu`, and `gpu` where there is one (kernels under the CUDA simulator have their own tests, on small grids)."""
    return request.param


@pytest.fixture(params=["fused", "stages"])
def kernel(request: pytest.FixtureRequest) -> str:
    """Both executions of a plan: many steps in one kernel, and stage by stage."""
    return request.param


@pytest.fixture(params=["float64", "float32"])
def precision(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def opened(backend: str) -> Callable[..., Any]:
    """opened(scene, kernel=..., precision=..., ...) -> a simulation on `backend`; dt over the limit is allowed."""
    from softlab.app.driver import open_simulation

    def open_it(
        scene: Any, *, kernel: str = "fused", precision: str = "float64", math: str = "exact", **options: Any
    ) -> Any:
        if backend == "cpu":
            options.setdefault("threads", 1)
        else:
            options.pop("threads", None)
            kernel = {"fused": None}.get(kernel, kernel)  # type: ignore[assignment]  # the fused ones have names there
        options.setdefault("allow_unstable", True)
        return open_simulation(scene, backend, kernel=kernel, precision=precision, math=math, **options)

    return open_it


@pytest.fixture
def run(opened: Callable[..., Any]) -> Callable[..., Any]:
    """run(scene, steps, ...) -> the State after `steps` steps; `initial`: where to start, see `start_at`."""

    def run_it(scene: Any, steps: int, **options: Any) -> Any:
        with opened(scene, **options) as simulation:
            simulation.advance(steps)
            return simulation.state()

    return run_it


@pytest.fixture
def start_at() -> Callable[..., Any]:
    """start_at(scene, position, velocity=0) -> a State at time 0 to open the scene with."""
    import numpy as np

    from softlab.model.core.build import build
    from softlab.model.core.simulation import State

    def state(scene: Any, position: Any, velocity: Any = None) -> State:
        position = np.asarray(position, dtype=np.float64).reshape(-1, 2)
        velocity = (
            np.zeros_like(position) if velocity is None else np.asarray(velocity, dtype=np.float64).reshape(-1, 2)
        )
        return State(position, velocity, build(scene).inverse_mass, 0.0, 0)

    return state


@pytest.fixture
def ptx_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """CUDA kernels can be compiled without a GPU. Needs NVVM and NVRTC: pip install -e ".[ptx]"."""
    cuda = pytest.importorskip("numba.cuda", reason="needs numba-cuda")
    import numba.cuda.dispatcher as dispatcher

    monkeypatch.setattr(dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=(9, 0)))
    if missing := no_ptx(cuda):
        pytest.skip(f'the CUDA compiler is not installed (pip install -e ".[ptx]"): {missing}')


@cache
def no_ptx(cuda: Any) -> str:
    """What is wrong with the CUDA compiler, or ""."""
    from numba import types

    try:
        cuda.compile_ptx(lambda a: None, (types.float32[::1],), cc=(9, 0))
    except Exception as error:
        return type(error).__name__
    return ""


PLAIN_SECONDS = 2.0  # of a test, until its kernels are compiled after all: about what compiling one takes

in_plain_python = pytest.StashKey[bool]()


def listed(table: dict[str, str], item: pytest.Item) -> bool:
    return any(fnmatch(item.name, pattern) for pattern in table.get(item.path.name, "").split())


@pytest.hookimpl(tryfirst=True)  # before the fixtures of modules and sessions, which run kernels too
def pytest_runtest_setup(item: pytest.Item) -> None:
    minutes = item.config.getoption("--minutes")
    if minutes and time.monotonic() - BEGUN > 60 * minutes:
        pytest.skip(f"--minutes {minutes:g} are over")
    plain = item.stash[in_plain_python]
    os.environ["SOFTLAB_PLAIN_PYTHON"] = str(int(plain))  # for the first import, and for processes that tests start
    os.environ["SOFTLAB_PLAIN_PYTHON_SECONDS"] = str(PLAIN_SECONDS)
    if "softlab.cpu_backend.core.plain" in sys.modules:
        sys.modules["softlab.cpu_backend.core.plain"].plain_python(plain, PLAIN_SECONDS)
    if item.get_closest_marker("gpu") and no_gpu():
        pytest.skip(no_gpu())
    if "softlab.bench.measure.machine" in sys.modules:
        measured_once(sys.modules["softlab.bench.measure.machine"])


def measured_once(machine: Any) -> None:
    """A machine's limits are measured once a process, of small arrays: a hundred tests enter their machine into a store."""
    if not hasattr(machine.measured_limits, "__wrapped__"):
        machine.measured_limits = cache(machine.measured_limits)
        machine.copy_bytes = lambda: 1 << 20


@cache
def no_gpu() -> str:
    """Why what is marked `gpu` cannot be tested here, or ""."""
    from softlab.gpu_backend.core.device import gpu_available, simulated

    works, reason = gpu_available()
    if works and simulated():
        return "the CUDA simulator is no GPU: tests/simulator holds its tests"
    return "" if works else reason


def pytest_collection_finish() -> None:
    """Ten thousand tests stay: who looks for garbage does not go through them again and again (a tenth of the time)."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 50)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--thorough",
        action="store_true",
        help="every test and every variant; what runs without it, and all that is dear, with compiled kernels",
    )
    parser.addoption(
        "--rest",
        action="store_true",
        help="of --thorough what does not run without it, in variants that show every pair of parameter values",
    )
    parser.addoption("--minutes", type=float, help="skip the tests that would begin later than this (default: none)")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The dearest first, with --rest physics before tools. Without --thorough leave out what ONLY_THOROUGH and
    OVER_A_SECOND list, windows, and what THINNED does not need, but nothing that is for a real GPU. With it the variants
    that THINNED does not need, and OVER_A_SECOND's that are not COMPILED, run as plain Python. --rest runs as many of what
    is left out as together with what is not show every pair of values of a test's parameters."""
    rest = config.getoption("--rest")
    thorough = config.getoption("--thorough") or rest
    # the simulator's grids are so small that the CPU's kernels take longer to compile than to run as Python
    simulated = os.environ.get("NUMBA_ENABLE_CUDASIM") == "1"
    items.sort(key=lambda item: (item.path.name not in DEAR, rest and item.nodeid.split("/")[1] in LAST))
    left_out, slow = set(), set()
    dear = set()  # of those left out, what is compiled when it runs
    variants: dict[Any, list[Any]] = {}
    for item in items:
        on_gpu = item.get_closest_marker("gpu") is not None  # and held against the CPU on grids for it
        item.stash[in_plain_python] = simulated or not (thorough or on_gpu or listed(COMPILED, item))
        if rest and item.path.name == "test_cuda_simulator.py":
            dear.add(item)  # which asks the simulator's tests the same
        if listed(ONLY_THOROUGH, item) or item.get_closest_marker("display"):
            dear.add(item)
        elif (listed(OVER_A_SECOND, item) or item.get_closest_marker("rest")) and not on_gpu:
            slow.add(item)
        elif item.path.name in THINNED and hasattr(item, "callspec") and not on_gpu:
            variants.setdefault((item.path, item.originalname), []).append(item)  # type: ignore[attr-defined]
    for same in variants.values():
        cases = [{name: repr(value) for name, value in item.callspec.params.items()} for item in same]
        left_out |= set(same) - {same[place] for place in covering(cases)}
    for item in left_out | {item for item in slow if not listed(COMPILED, item)} if thorough else ():
        item.stash[in_plain_python] = True
    if rest or not thorough:
        default = set(items) - left_out - dear - slow
        wanted = new_pairs(items, default) if rest else default
        config.hook.pytest_deselected(items=[item for item in items if item not in wanted])
        items[:] = [item for item in items if item in wanted]


def new_pairs(items: list[pytest.Item], default: set[pytest.Item]) -> set[pytest.Item]:
    """Of the tests that do not run by default those without parameters, those of a real GPU, and the variants that show a
    pair of values which no default variant shows."""

    def case(item: Any) -> dict[str, Any]:
        values = item.callspec.params.items()
        return {name: value if isinstance(value, str | int | float) else id(value) for name, value in values}

    result = set(items) - default
    variants: dict[Any, list[Any]] = {}
    for item in items:
        if hasattr(item, "callspec") and item.get_closest_marker("gpu") is None:
            variants.setdefault((item.path, item.originalname), []).append(item)  # type: ignore[attr-defined]
    for same in variants.values():
        late = [item for item in same if item not in default]
        known = [case(item) for item in same if item in default]
        chosen = covering([case(item) for item in late], 2, known)
        result -= set(late) - {late[place] for place in chosen}
    return result


@pytest.hookimpl(tryfirst=True)  # before pytest-xdist looks at its options
def pytest_cmdline_main(config: pytest.Config) -> None:
    """A worker a core, unless one or two files are asked for, a debugger, the output as it comes, or a real GPU alone."""
    options = config.option
    if not config.pluginmanager.hasplugin("xdist") or hasattr(config, "workerinput"):
        return  # no pytest-xdist, or one of its workers
    files = [name.partition("::")[0] for name in options.file_or_dir]
    few = 0 < len(files) <= 2 and all(name.endswith(".py") for name in files)
    watched = options.usepdb or options.trace or options.collectonly or options.capture == "no"
    alone = watched or ("gpu" in options.markexpr.split() and "not gpu" not in options.markexpr)
    if options.numprocesses is None and not options.tx and not (few or alone):
        options.numprocesses = min(core_count(), MAX_WORKERS)
        if options.dist == "no":
            options.dist, options.loadscopereorder = "loadfile", False  # in the order of collection, see DEAR


@pytest.hookimpl(optionalhook=True)  # without pytest-xdist there is none
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Files to workers, so that fixtures of modules are made once, but each test of a DEAR one by itself."""
    from xdist.scheduler import LoadFileScheduling

    class ByFile(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            scope = super()._split_scope(nodeid)
            return nodeid if scope.endswith(DEAR) else scope

    return ByFile(config, log) if config.getoption("dist") == "loadfile" else None
