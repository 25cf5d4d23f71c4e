"""`open_simulation`: opens a scene on a backend, for the command line and for Python."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from softlab.app.auto_threads import AUTO, open_quickest
from softlab.app.shared import USUAL_LINK, open_shared
from softlab.model.base.components import named
from softlab.model.base.errors import SceneError
from softlab.model.base.waiting import work
from softlab.model.core.families import family_of
from softlab.model.core.simulation import Options, Simulation, State
from softlab.model.core.stability.diagnosis import refusal
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.tables.motion import RELEASE

BACKENDS = ("cpu", "gpu")


def open_simulation(
    scene: Scene | str | Path,
    backend: str = "cpu",
    *,
    threads: str | int = "1x",
    precision: str = "float32",
    math: str = "fast",
    kernel: str | None = None,
    live: Iterable[str] = (),
    initial: State | None = None,
    allow_unstable: bool = False,
    gpus: int = 1,
    ranks: int = 1,
    exchange_every: int | None = None,
    link: str = USUAL_LINK,
) -> Simulation:
    """Open a scene on a backend; use the simulation as a context manager.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, the name of a catalogue scene, or a TOML file.
    backend : {"cpu", "gpu"}
        CPU threads (numba) or CUDA (numba.cuda).
    threads : str or int
        CPU threads: "1x", "2x" or "4x" as many as cores, a number, or "auto": one thread per core or a single one, whichever
        is faster now (`threads_reason` says why).
    precision : {"float32", "float64"}
        Type of positions and velocities.
    math : {"fast", "exact"}
        "exact" gives the same bits on every backend and thread count; "fast" is faster.
    kernel : str, optional
        Kernel to use; by default the fastest one measured for the scene.
    live : iterable of str
        What may change while running: gravity, poke, dt, stiffness, damping, wind, targets, taps. Only these parts are
        compiled to be changeable.
    initial : State, optional
        State to start from.
    allow_unstable : bool
        Accept a step size over the stability limit.
    gpus : int
        Number of GPUs that share the scene: rows of a sheet, bodies that never meet, or meshes of tetrahedra.
    ranks : int
        Number of MPI processes that share the scene on CPUs; this process is one of them.
    exchange_every : int, optional
        Steps between two exchanges of a shared sheet's borders; by default chosen from its size.
    link : {"flags", "nccl"}
        How GPUs exchange data: kernels write into each other's memory and wait for each other, or NCCL (also between MPI
        processes with one GPU each).

    Returns
    -------
    Simulation
        At the scene's start, or at `initial`.

    Raises
    ------
    SceneError, InputError
        Bad input.
    UnstableTimeStep
        The step size exceeds the stability limit.
    BackendUnavailable
        There is no usable GPU, or another component is missing.

    Examples
    --------
    >>> with open_simulation("lab-grid") as simulation:
    ...     simulation.advance(100)
    ...     position = simulation.read("position")
    """
    if not isinstance(scene, Scene):
        scene = load_scene(scene)
    scene = scene.whole
    options = Options(precision, math, kernel, frozenset(live))
    if "targets" in options.live and scene.phases:
        reason = f"moves pins, which {scene.name_of(RELEASE)} releases; leave one of them out"
        raise SceneError("live", "targets", reason)
    refused = refusal(scene)
    if refused is not None and not allow_unstable:
        raise refused
    if backend not in BACKENDS:
        raise SceneError("--backend", backend, f"must be one of {', '.join(BACKENDS)}")
    if gpus != 1 or ranks != 1:
        simulation = open_shared(scene, backend, options, threads, gpus, ranks, exchange_every, link)
    elif backend == "cpu" and threads == AUTO:
        from softlab.cpu_backend.core.threads import core_count

        simulation = open_quickest(lambda count: _open(scene, backend, options, count), core_count())
    else:
        simulation = _open(scene, backend, options, threads)
    simulation.lost_when_opened = simulation.faults()
    if initial is not None:
        try:
            simulation.load(initial)
        except BaseException:
            simulation.close()
            raise
    return simulation


def _open(scene: Scene, backend: str, options: Options, threads: str | int) -> Simulation:
    """Return the scene's simulation on the backend. Does not import the other backend."""
    family = family_of(scene)
    if backend not in family.solvers:
        raise SceneError(
            "--backend", backend, f"does not support scenes of the kind {family.name}; use {', '.join(family.solvers)}"
        )
    with work("preparing the solver"):
        solver = named(family.solvers[backend])
        return solver(scene, options, threads) if backend == "cpu" else solver(scene, options)
