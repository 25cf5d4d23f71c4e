"""The commands that measure to give advice, one function per sub-command; softlab/cli.py adds them to its own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from softlab.app.command.command_line import DEFAULT_STORE, SceneName, Settings, StorePath, out, scene_of, typed
from softlab.app.command.options_class import with_options
from softlab.bench.measure.took import Timed
from softlab.bench.options import Backends, Precisions, Time, measure, precisions_of
from softlab.model.base.errors import SceneError

advising = typer.Typer()


@dataclass(frozen=True)
class AdviseOptions:
    """The options of `softlab advise`."""

    scene: SceneName
    error: Annotated[
        float,
        typer.Option(
            "--error",
            help="Largest error: in spacings; for tetrahedral bodies and for the density of a fluid relative (0.01: 1 %).",
        ),
    ]
    time: Time = None
    backend: Backends = None
    precision: Precisions = None
    total_seconds: Annotated[float, typer.Option(help="Time limit of the search in seconds.")] = 180.0
    write: Annotated[Path | None, typer.Option(help="Write the scene with the advised settings (.toml).")] = None
    force: Annotated[bool, typer.Option("--force", help="Replace the file of --write if it exists.")] = False
    check: Annotated[bool, typer.Option("--check", hidden=True)] = False  # of former versions
    settings: Settings = None
    store: StorePath = DEFAULT_STORE


@advising.command(cls=Timed, epilog="Example: softlab advise lab-curtain --error 1e-3 --write fast.toml")
@with_options(AdviseOptions)
def advise(options: AdviseOptions) -> None:
    """Measure which method, step size, precision and backend reaches an error fastest on this machine."""
    from softlab.app.command.scene_file import check_scene_target, write_scene
    from softlab.bench.experiments.advise.answer import measure_advice
    from softlab.bench.store.database import Store

    if options.check:
        message = "was removed: tests check the advice by brute force; to try other settings use softlab run with --set"
        raise SceneError("--check", True, message)
    if options.force and options.write is None:
        raise SceneError("--force", True, "replaces the file of --write; add --write FILE.toml")
    if options.write is not None:
        check_scene_target(options.write, options.force)  # before the work whose result it holds
    with Store(options.store) as opened:
        advice = measure_advice(
            opened, scene_of(options.scene, options.settings), options.error, time=options.time,
            total_seconds=options.total_seconds,
            how={"backends": options.backend, "precisions": precisions_of(options.precision), "command": typed()},
        )  # fmt: skip
        out.print(str(advice), markup=False, soft_wrap=True)
        if advice.best is None:
            raise typer.Exit(2)
    if options.write is not None:
        path = write_scene(options.write, advice.configured(), advice.heading(), force=options.force)
        out.print(f"{path}: softlab run {path} --time {advice.time:g} {advice.options()}", markup=False, soft_wrap=True)


@advising.command(cls=Timed, epilog="Example: softlab ablate lab-curtain --backend cpu --set method.integrator=rk4")
def ablate(
    scene: SceneName,
    time: Time = None,
    backend: Backends = None,
    settings: Settings = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Leave out one part of a scene at a time: measure the time it saves and the error it causes."""
    from softlab.bench.experiments.advise.ablate import ablate as find
    from softlab.bench.experiments.advise.ablation_results import print_ablation

    asked = scene_of(scene, settings)
    how = {"scene": asked, "backends": backend, "time": time}
    if asked.fluids:
        from softlab.bench.experiments.advise.fluids_ablation import ablate_fluids, print_fluid_ablation

        measure(store, ablate_fluids, how, report=print_fluid_ablation)
        return
    measure(store, find, how, report=print_ablation)
