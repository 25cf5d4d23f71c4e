"""The door to every simulation: `open_simulation`, from the command line and from Python alike."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from model.errors import SceneError, UnstableTimeStep
from model.integrators import stability_limit
from model.scene import Scene, load_scene
from model.simulation import Options, Simulation, State

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
) -> Simulation:
    """Open a scene on a backend; use it as a context manager.

    `scene`: a Scene, a catalogue name or a TOML file. `threads` (cpu): `1x`, `2x`, `4x` the cores, or a number. `live`:
    what may change while running, of gravity, poke, dt, stiffness, damping; only those parts are compiled to be
    changeable. `initial`: start from a state.

    Raises SceneError or InputError (bad input), UnstableTimeStep (dt over the limit, unless `allow_unstable`),
    BackendUnavailable (no GPU).

    >>> with open_simulation("lab-grid") as simulation:
    ...     simulation.advance(100)
    ...     position = simulation.read("position")
    """
    if not isinstance(scene, Scene):
        scene = load_scene(scene)
    options = Options(precision, math, kernel, frozenset(live))
    limit = stability_limit(scene)
    if scene.method.dt > limit * (1 + 1e-12) and not allow_unstable:
        raise UnstableTimeStep(scene.method.dt, limit, scene.method.integrator)
    if backend == "cpu":
        from cpu_backend.mass_spring import MassSpring

        simulation: Simulation = MassSpring(scene, options, threads)
    elif backend == "gpu":
        from gpu_backend.mass_spring import MassSpring as CudaMassSpring

        simulation = CudaMassSpring(scene, options)
    else:
        raise SceneError("--backend", backend, f"must be one of {', '.join(BACKENDS)}")
    if initial is not None:
        try:
            simulation.load(initial)
        except BaseException:
            simulation.close()
            raise
    return simulation
