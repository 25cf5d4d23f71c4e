"""One headless run: open a scene, step it, write the requested outputs, and report."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import psutil

from softlab.app.command.foaming import Foaming, shows_foam
from softlab.app.command.pictures import USUAL_RATE, ClipView, check_rate, parse_size
from softlab.app.command.run_length import parse_record, step_count
from softlab.app.command.run_options import Request
from softlab.app.command.run_parts import body_lines, collider_lines, fluid_notes, newton_notes
from softlab.app.command.run_report import run_report
from softlab.app.driver import open_simulation
from softlab.app.outcome import INCOMPLETE, fault_lines, fault_words
from softlab.app.output.export import Exporter, Target, check_export
from softlab.app.output.files import check_state_target, read_state, write_state, write_trajectory
from softlab.app.output.video import CLIP, Picture, check_render, render
from softlab.app.render.views import check_view_options
from softlab.app.shared import USUAL_LINK, check_asked, check_cut, check_shared
from softlab.cpu_backend.core.threads import core_count, wait_policy
from softlab.model.base.errors import Diverged, Incomplete, InputError, SceneError
from softlab.model.base.memory import available_bytes, require
from softlab.model.base.waiting import work
from softlab.model.contact.overlaps import overlap_lines
from softlab.model.core.families import family_of
from softlab.model.core.options import PRECISIONS
from softlab.model.core.simulation import Simulation, State
from softlab.model.core.stability.divergence import MIN_INTERVAL
from softlab.model.core.stability.laws import limit_notes
from softlab.model.core.stability.resolution import resolution_line
from softlab.model.domains.launched import launched_ranks
from softlab.model.fluid.foam import FoamPoints
from softlab.model.scene.resting import resting_notes
from softlab.model.scene.scene import Scene
from softlab.model.scene.sheets import mesh_lines, rest_lines

WARM_UP_STEPS = 512  # on a real GPU: enough to capture every graph that a long run replays
PROGRESS_SECONDS = 0.2  # interval of the progress bar


def draws_clip(request: Request) -> bool:
    """Return True if `--render` names a clip rather than a picture."""
    return request.render is not None and request.render.suffix.lower() == CLIP


def picture_of(request: Request) -> Picture:
    """Return the picture that `--render` draws. Raises SceneError."""
    size = parse_size(request.size) if request.size is not None else (Picture.width, Picture.height)
    view_options = tuple(request.view_options or ())
    return Picture(*size, fps=request.fps or USUAL_RATE, view_options=view_options, legend=request.hud)


@dataclass
class Result:
    """The result of a run.

    `report` is what `run --json` prints, `state` the final state (the last checked finite one, if it diverged),
    `written` the files made, `notes` hints for the user, `diverged` the error that ended it, `incomplete` that not all
    of its physics was computed (None: all was, or it is allowed), `rank` of the process: only number 0 writes.
    """

    report: dict[str, object]
    state: State
    scene: Scene
    written: list[Path] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    diverged: Diverged | None = None
    incomplete: Incomplete | None = None
    rank: int = 0


def check_targets(scene: Scene, request: Request, steps: int, notes: list[str]) -> Target | None:
    """Check, before any work, everything that could prevent a result from being written, and return the target of
    exported meshes. Raises InputError, SceneError."""
    if request.out:
        check_state_target(request.out)
    if request.render:
        check_render(request.render)
    view_options = request.view_options or ()
    check_view_options(scene, view_options)
    asked: dict[str, object] = {f"--look {view_options[0]}": True} if view_options else {}
    asked |= {f"--size {request.size}": request.size, f"--fps {request.fps}": request.fps, "--no-hud": not request.hud}
    if not request.render and (unused := [option for option, value in asked.items() if value]):
        raise InputError(f"{unused[0]}: applies to a picture or a clip; add --render FILE.png or FILE.mp4")
    picture_of(request)
    if request.fps is not None:
        check_rate(request.fps, request.render)
    check_asked(request.backend, request.gpus, request.ranks, request.exchange_every, request.link)
    if request.gpus > 1:
        check_cut(scene, request.gpus, request.exchange_every, request.link, "--gpus")
    check_shared(max(request.ranks, launched_ranks()), request.render, request.export)
    if request.record:
        every, path = parse_record(request.record[:1]), request.record[1]
        check_state_target(path)
        frames = steps // every + 1
        item = 8 if request.precision == "float64" else 4
        needed = 2 * frames * scene.grid.particle_count * 2 * scene.dimensions * item
        require(needed, available_bytes(), "--record", f"every={every}", "main memory")
    if request.export:
        return check_export(request.export, request.export_every, scene.method.dt, notes)
    if request.export_every is not None:
        raise SceneError(
            "--export-every",
            request.export_every,
            "applies to --export of every frame; add --export body-{frame:04d}.ply",
        )
    return None


def run_scene(scene: Scene, request: Request, *, progress: bool = True) -> Result:
    """Run `scene` as requested. Raises SceneError, InputError, BackendUnavailable; a divergence is part of the
    result."""
    built = mesh_lines, rest_lines, body_lines, resting_notes, collider_lines
    lines = *built, overlap_lines, limit_notes, family_of(scene).warnings
    with work("checking the scene"):
        notes = [line for describe in lines for line in describe(scene)]
        known = request.precision in PRECISIONS  # others are refused below
        coarse = resolution_line(scene, request.precision) if known else None
    notes += [coarse] if coarse else []
    steps = step_count(scene, request.steps, request.time, notes)
    target = check_targets(scene, request, steps, notes)
    initial = read_state(request.initial, scene, notes) if request.initial else None
    begin = time.perf_counter()
    simulation = open_simulation(
        scene, request.backend, threads=request.threads, precision=request.precision, math=request.math,
        kernel=request.kernel, initial=initial, allow_unstable=request.allow_unstable, gpus=request.gpus,
        ranks=request.ranks, exchange_every=request.exchange_every, link=request.link or USUAL_LINK,
    )  # fmt: skip
    with simulation, ExitStack() as opened:
        start = simulation.state()
        if steps > 0:
            with work("warming up"):
                simulation.warm_up(min(steps, WARM_UP_STEPS) if simulation.kernel in ("graph", "tiles") else 1)
        compile_seconds = time.perf_counter() - begin
        clip = draws_clip(request)
        recorder = _Recorder(start, parse_record(request.record[:1]) if request.record else 0)
        exporter = Exporter(simulation, target) if target else None
        foaming = (
            Foaming(simulation)
            if request.render and not clip and shows_foam(scene, request.view_options or ())
            else None
        )
        view = opened.enter_context(ClipView(simulation, picture_of(request))) if clip and steps > 0 else None
        observers = [observer for observer in (recorder, exporter, foaming, view) if observer and observer.every]
        try:
            seconds, diverged = _advance(simulation, steps, observers, progress and simulation.rank == 0)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(*([exporter.stopped] if exporter else [])) from None
        with work("measuring the end"):
            state = simulation.state()
            report = run_report(simulation, state, steps, seconds, compile_seconds, diverged) | {"resolution": coarse}
        result = Result(report, state, simulation.scene, notes=notes, diverged=diverged, rank=simulation.rank)
        if result.report["outcome"] == INCOMPLETE and not request.allow_incomplete:
            result.incomplete = Incomplete(fault_words(result.report))
        if result.rank != 0:
            return result
        notes += fault_lines(result.report) + fluid_notes(simulation.scene, result.report) + newton_notes(result.report)
        if exporter:
            result.written += exporter.finish(simulation, notes)
        opened.close()  # before the clip is drawn with its own renderer
        _write_results(result, request, recorder, simulation, start, view, foaming.points if foaming else None)
        if diverged is not None:
            notes.append(f"the numbers above are of the last good state, at step {state.step}")
        waits = simulation.backend == "cpu" and simulation.threads > 1 and wait_policy() not in ("brief", "passive")
        if waits and psutil.getloadavg()[0] > core_count() + 0.5:  # threads spin, and other programs have been running
            notes.append(
                "other programs use the cores, which slows down threads that wait for each other: "
                "unset OMP_WAIT_POLICY and GOMP_SPINCOUNT, or use --threads auto"
            )
    return result


class Observer(Protocol):
    """Receives the state every `every` steps of a run; 0 for never."""

    every: int

    def observe(self, simulation: Simulation) -> None: ...


class _Recorder:
    """Records a state every `every` steps, including the start; 0 records nothing."""

    def __init__(self, start: State, every: int):
        self.every = every
        self.states = [start] if every else []

    def observe(self, simulation: Simulation) -> None:
        self.states.append(simulation.state())


def _advance(
    simulation: Simulation, steps: int, observers: Sequence[Observer], progress: bool
) -> tuple[float, Diverged | None]:
    """Advance the simulation. Returns (seconds of stepping alone, the divergence that ended it or None). `observers`
    receive states during the run."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

    from softlab.app.output.bar import Bar

    columns = (TextColumn("stepping"), BarColumn(), MofNCompleteColumn(), TextColumn("steps"), TimeRemainingColumn())
    done, seconds = 0, 0.0
    batch = 1 if simulation.backend == "cpu" else MIN_INTERVAL  # Ctrl-C takes effect between batches
    shown = None
    try:
        while done < steps:
            now = min(batch, steps - done, *(each.every - done % each.every for each in observers))
            begin = time.perf_counter()
            simulation.advance(now)
            simulation.synchronize()
            took = simulation.slowest(time.perf_counter() - begin)
            seconds += took
            done += now
            for each in observers:
                if done % each.every == 0:
                    each.observe(simulation)
            if took > 0:
                batch = max(1, min(round(now * PROGRESS_SECONDS / took), 2**31))
            if progress and took > 0:
                if shown is None and seconds / done * (steps - done) > 1:
                    shown = Bar(columns)
                    shown.start()
                    task = shown.add_task("stepping", total=steps)
                if shown is not None:
                    shown.update(task, completed=done)
        simulation.check()
    except Diverged as error:
        return seconds, error
    finally:
        if shown is not None:
            shown.stop()
    return seconds, None


def _write_results(
    result: Result, request: Request, recorder: _Recorder, simulation: Simulation, start: State, view: ClipView | None,
    foam: FoamPoints | None,
) -> None:  # fmt: skip
    if request.out:
        result.written.append(write_state(request.out, result.state))
    if request.record:
        result.written.append(write_trajectory(request.record[1], simulation.scene, recorder.states))
    picture = picture_of(request)
    if request.render and not draws_clip(request):
        state = result.state
        result.written.append(
            render(
                state.position, request.render, scene=simulation.scene, picture=picture, time=state.time,
                inverse_mass=state.inverse_mass, velocity=state.velocity, foam=foam,
            )
        )  # fmt: skip
    elif request.render:
        steps = result.state.step - start.step
        if steps < 1 or view is None:
            raise InputError(f"{request.render}: a run of 0 steps has no clip; pass --steps N or --time SECONDS")
        simulation.load(start)
        picture = replace(picture, fps=view.rate, fitted=view.fitted)
        result.written.append(
            render(simulation, request.render, steps=steps, steps_per_frame=view.every, picture=picture)
        )
