"""The door to every simulation: `open_simulation`, from the command line and from Python alike."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from app.auto_threads import AUTO, open_quickest
from app.shared import USUAL_LINK, open_shared
from model.contact.shortfalls import lost_so_far
from model.core.errors import SceneError
from model.core.families import family_of
from model.core.family import named
from model.core.simulation import Options, Simulation, State
from model.core.stability.diagnosis import refusal
from model.core.waiting import work
from model.scene.motion import RELEASE
from model.scene.scene import Scene, load_scene

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
    """Open a scene on a backend; use it as a context manager.

    `scene`: a Scene, a catalogue name or a TOML file. `threads` (cpu): `1x`, `2x`, `4x` the cores, a number, or `auto`: as
    many as cores or one, whichever is quicker now (`threads_reason` says why). `live`:
    what may change while running, of gravity, poke, dt, stiffness, damping; only those parts are compiled to be
    changeable. `initial`: start from a state. `gpus`: that share the sheet, by its rows, bodies that never meet, or the
    meshes of tetrahedral ones;
    `ranks`: processes of MPI on CPUs that do, of which this is one; every `exchange_every` steps those of a sheet tell each
    other of their borders (None: as suits).
    `link`: how GPUs do, `flags` (into each other's memory, kernels wait for kernels), `peer` (from it) or `nccl` (also where
    this is one of several processes of MPI, with a GPU each).

    Raises SceneError or InputError (bad input), UnstableTimeStep (dt over the limit, unless `allow_unstable`),
    BackendUnavailable (no GPU).

        with open_simulation("lab-grid") as simulation:
            simulation.advance(100)
            position = simulation.read("position")
    """
    if not isinstance(scene, Scene):
        scene = load_scene(scene)
    scene = scene.whole
    options = Options(precision, math, kernel, frozenset(live))
    if "targets" in options.live and scene.phases:
        told = f"moves pins, which {scene.name_of(RELEASE)} lets go; leave one of them out"
        raise SceneError("live", "targets", told)
    refused = refusal(scene)
    if refused is not None and not allow_unstable:
        raise refused
    if backend not in BACKENDS:
        raise SceneError("--backend", backend, f"must be one of {', '.join(BACKENDS)}")
    if gpus != 1 or ranks != 1:
        simulation = open_shared(scene, backend, options, threads, gpus, ranks, exchange_every, link)
    elif backend == "cpu" and threads == AUTO:
        from cpu_backend.core.threads import core_count

        simulation = open_quickest(lambda count: _open(scene, backend, options, count), core_count())
    else:
        simulation = _open(scene, backend, options, threads)
    simulation.lost_when_opened = lost_so_far(simulation)
    if initial is not None:
        try:
            simulation.load(initial)
        except BaseException:
            simulation.close()
            raise
    return simulation


def _open(scene: Scene, backend: str, options: Options, threads: str | int) -> Simulation:
    """The solver of the scene on the backend; the other backend is not even imported."""
    family = family_of(scene)
    if backend not in family.solvers:
        raise SceneError(
            "--backend", backend, f"does not support scenes of the kind {family.name}; use {', '.join(family.solvers)}"
        )
    with work("preparing the solver"):
        solver = named(family.solvers[backend])
        return solver(scene, options, threads) if backend == "cpu" else solver(scene, options)
