"""The command line of the soft-body lab: one function a sub-command, nothing else."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from model.errors import SoftlabError

app = typer.Typer(
    help="A soft-body lab: the same scenes on CPU threads and on CUDA, how fast and how wrong each run was.",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)
errors = Console(stderr=True, highlight=False, soft_wrap=True)
out = Console(highlight=False)

SceneName = Annotated[str, typer.Argument(metavar="SCENE", help="A name that `softlab scenes` lists, or a .toml file.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a field, e.g. grid.rows=64. Repeatable."),
]
Backend = Annotated[str, typer.Option(help="cpu or gpu.")]
Threads = Annotated[str, typer.Option(help="CPU threads: 1x, 2x, 4x the cores, or a number.")]
Precision = Annotated[str, typer.Option(help="float32 or float64.")]
Math = Annotated[str, typer.Option(help="fast, or exact (the same bits on every backend and thread count).")]
Methods = Annotated[
    list[str] | None,
    typer.Option(
        help='Only this integrator or position-based method ("xpbd jacobi"; xpbd: all orderings). Repeatable.'
    ),
]
StorePath = Annotated[Path, typer.Option("--store", help="The store of measurements.")]
Folder = Annotated[Path, typer.Option("--out", help="The folder to write to.")]
DEFAULT_STORE = Path("softlab-results") / "results.sqlite"
DEFAULT_FIGURES = Path("softlab-results") / "figures"
DEFAULT_BOOK = Path("softlab-results") / "labbook.pdf"


def main() -> None:
    """Run the command line; an error a user can mend is one line on standard error and its exit status."""
    try:
        app()
    except SoftlabError as error:
        errors.print(f"softlab: {error}", markup=False)
        sys.exit(error.exit_status)
    except KeyboardInterrupt:
        errors.print("softlab: stopped")
        sys.exit(130)
    except BrokenPipeError:  # the reader (head, less) has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)


def _scene(name: str, settings: list[str] | None) -> Any:
    from model.scene import load_scene, parse_settings

    return load_scene(name).replace(parse_settings(settings))


def _precisions(chosen: list[str] | None) -> tuple[str, ...]:
    from model.simulation import PRECISIONS, Options

    return tuple(dict.fromkeys(Options(name).precision for name in chosen or PRECISIONS))


@app.command(epilog="Example: softlab run lab-grid --steps 1000 --backend gpu --set grid.rows=256 --json")
def run(
    scene: SceneName,
    backend: Backend = "cpu",
    threads: Threads = "1x",
    precision: Precision = "float32",
    math: Math = "fast",
    kernel: Annotated[
        str | None,
        typer.Option(
            help="Force a kernel; cpu: fused, team, tiled, stages; gpu: one-block, resident, tiles, graph, launch, stages."
        ),
    ] = None,
    steps: Annotated[int | None, typer.Option(help="Steps to do (default 1000).")] = None,
    time: Annotated[float | None, typer.Option(help="Seconds to simulate, rounded to whole steps.")] = None,
    settings: Settings = None,
    initial: Annotated[Path | None, typer.Option(help="Start from a state file (.npz).")] = None,
    out_file: Annotated[Path | None, typer.Option("--out", help="Write the end state (.npz).")] = None,
    record: Annotated[
        tuple[str, Path] | None, typer.Option(metavar="every=N FILE.npz", help="Write a state every N steps.")
    ] = None,
    render: Annotated[Path | None, typer.Option(help="Draw the end (.png) or the whole run (.mp4).")] = None,
    export_to: Annotated[
        str | None,
        typer.Option(
            "--export", metavar="FILE", help="Meshes of the end (.ply, .glb); body-{frame:04d}.ply: of frames."
        ),
    ] = None,
    export_every: Annotated[
        float | None, typer.Option(help="Seconds simulated between two frames of --export (default 1/60).")
    ] = None,
    allow_unstable: Annotated[bool, typer.Option("--allow-unstable", help="Run over the stability limit.")] = False,
    judge: Annotated[
        bool, typer.Option(help="Hold the end state against a converged reference, where affordable.")
    ] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Run a scene without a window."""
    from app.run import Request, parse_record, run_scene
    from bench.judge import judge_run

    request = Request(
        backend, threads, precision, math, kernel, steps, time, initial, out_file,
        parse_record(record[:1]) if record else 0, record[1] if record else None, render, allow_unstable,
        export_to, export_every,
    )  # fmt: skip
    result = run_scene(_scene(scene, settings), request)
    for note in result.notes:
        errors.print(note, markup=False)
    if initial:
        result.report["error_reason"] = "started from a file, for which there is no reference"
    elif judge:
        result.report["error"], result.report["error_reason"] = judge_run(result.scene, result.state, result.diverged)
    if as_json:
        print(json.dumps(result.report))
    else:
        from app.tables import print_report

        print_report(out, result.report, result.written)
    if result.diverged:
        raise result.diverged


@app.command(epilog="Example: softlab demo lab-grid --backend gpu   (H in the window shows the keys)")
def demo(
    scene: SceneName = "lab-grid",
    backend: Backend = "cpu",
    threads: Threads = "1x",
    precision: Precision = "float32",
    math: Math = "fast",
    settings: Settings = None,
    frames: Annotated[int | None, typer.Option(help="Close after so many frames.")] = None,
) -> None:
    """Show a scene in a window: G toggles gravity, the mouse pulls a mass or a body, H lists the keys."""
    from app.viewer import run_demo
    from model.errors import SceneError

    if frames is not None and frames < 1:
        raise SceneError("--frames", frames, "must be at least 1")
    run_demo(_scene(scene, settings), backend=backend, threads=threads, precision=precision, math=math, frames=frames)


@app.command(epilog="Example: softlab sweep --quick --backend cpu")
def sweep(
    quick: Annotated[bool, typer.Option("--quick", help="Small sizes, about a minute.")] = False,
    backend: Annotated[list[str] | None, typer.Option(help="Only this backend. Repeatable.")] = None,
    size: Annotated[list[int] | None, typer.Option(help="Only N x N masses. Repeatable.")] = None,
    max_seconds: Annotated[float | None, typer.Option(help="The most one configuration may take.")] = None,
    total_seconds: Annotated[float | None, typer.Option(help="Start nothing new after so long.")] = None,
    graphics: Annotated[bool, typer.Option(help="Also with off-screen drawing every 10 steps.")] = True,
    repeats: Annotated[int | None, typer.Option(help="Samples of a configuration.")] = None,
    min_ms: Annotated[float | None, typer.Option("--min-ms", help="The least milliseconds of a sample.")] = None,
    precision: Annotated[list[str] | None, typer.Option(help="Only float32, or float64. Repeatable.")] = None,
    kernels: Annotated[
        bool, typer.Option("--kernels", help="Every kernel, forced, instead of the chosen one.")
    ] = False,
    kernel: Annotated[list[str] | None, typer.Option(help="With --kernels: only this one. Repeatable.")] = None,
    energy: Annotated[bool, typer.Option(help="With --kernels: joules, where the machine counts them.")] = True,
    starts: Annotated[bool, typer.Option(help="With --kernels: the time to a first step, too.")] = True,
    peers: Annotated[
        bool, typer.Option("--peers", help="Side by side with what you could use instead (NumPy, C++, CUDA C++, Warp).")
    ] = False,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Time sizes x backends x threads x precisions, with and without graphics, into the store. Resumes where it stopped."""
    from bench.store import Store
    from bench.tables import print_kernels, print_sweep

    if peers and (kernels or kernel):
        from model.errors import SceneError

        raise SceneError("--peers", True, "is a sweep of its own; leave out --kernels and --kernel")
    how: dict[str, Any] = {
        "quick": quick, "backends": backend, "sizes": size, "max_seconds": max_seconds, "total_seconds": total_seconds,
        "repeats": repeats, "min_seconds": min_ms and min_ms / 1000, "precisions": _precisions(precision),
        "command": " ".join(["softlab", *sys.argv[1:]]),
    }  # fmt: skip
    summary: Any
    with Store(store) as opened:
        if kernels:
            from bench.kernel_sweep import run_kernel_sweep

            summary = run_kernel_sweep(opened, kernels=kernel, energy=energy, starts=starts, **how)
            print_kernels(out, opened, summary.machine)
        elif peers:
            from bench.peer_results import print_peers
            from bench.peer_sweep import run_peers

            summary = run_peers(opened, **how)
            print_peers(out, opened, summary.machine)
        else:
            from bench.sweep import run_sweep

            summary = run_sweep(opened, graphics=graphics, **how)
        print_sweep(out, summary)
    if summary.interrupted:
        raise typer.Exit(130)


@app.command(epilog="Example: softlab accuracy --quick   (softlab accuracy --integrator rk4 --precision float64)")
def accuracy(
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer repeats and methods; neither exact math nor other sizes.")
    ] = False,
    integrator: Methods = None,
    backend: Annotated[list[str] | None, typer.Option(help="Only this backend. Repeatable.")] = None,
    precision: Annotated[list[str] | None, typer.Option(help="Only float32, or float64. Repeatable.")] = None,
    scene: Annotated[list[str] | None, typer.Option(help="Only S1, S2, S4, S5, S6 or S6-still. Repeatable.")] = None,
    findings: Annotated[
        bool | None,
        typer.Option(help="Also the small experiments behind single findings (default: unless a part is chosen)."),
    ] = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Hold every method, step size and precision against a converged reference: speed against error."""
    from bench.accuracy import run_accuracy
    from bench.accuracy_points import CLOTHS, SCENES
    from bench.choice import chosen
    from bench.convergence import run_convergence
    from bench.findings import run_findings
    from bench.findings_costs import run_costs
    from bench.store import Store

    how: dict[str, Any] = {"quick": quick, "backends": backend, "command": " ".join(["softlab", *sys.argv[1:]])}
    if findings is None:
        findings = not (integrator or precision or scene)
    scenes = chosen(scene, [*SCENES, *CLOTHS], "--scene") if scene else None
    with Store(store) as opened:
        summary: Any = run_accuracy(opened, integrators=integrator, precisions=precision, scenes=scenes, **how)
        out.print(str(summary), markup=False, soft_wrap=True)
        for run in (run_findings, run_costs, run_convergence) if findings else ():
            if not summary.interrupted:
                summary = run(opened, **how)
                out.print(str(summary), markup=False, soft_wrap=True)
    if summary.interrupted:
        raise typer.Exit(130)


@app.command(epilog="Example: softlab projections --quick   (softlab projections --backend cpu --size 256)")
def projections(
    quick: Annotated[bool, typer.Option("--quick", help="Two sizes, fewer repeats, nothing published.")] = False,
    backend: Annotated[list[str] | None, typer.Option(help="Only this backend. Repeatable.")] = None,
    size: Annotated[list[int] | None, typer.Option(help="Only sheets of N x N masses. Repeatable.")] = None,
    precision: Annotated[list[str] | None, typer.Option(help="float32 (the default), or float64. Repeatable.")] = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Time the position-based solvers: how many constraints a second they project, and published cloth beside ours."""
    from bench.projections import run_projections
    from bench.store import Store

    with Store(store) as opened:
        summary = run_projections(
            opened, quick=quick, backends=backend, sizes=size, precisions=precision or ("float32",),
            command=" ".join(["softlab", *sys.argv[1:]]),
        )  # fmt: skip
        out.print(str(summary), markup=False, soft_wrap=True)
    if summary.interrupted:
        raise typer.Exit(130)


@app.command(epilog="Example: softlab advise lab-curtain --error 1e-3 --write fast.toml")
def advise(
    scene: SceneName,
    error: Annotated[float, typer.Option("--error", help="The error to reach, in spacings of the grid.")],
    time: Annotated[float | None, typer.Option(help="Seconds simulated until it is judged (default 1.5).")] = None,
    backend: Annotated[list[str] | None, typer.Option(help="Only this backend. Repeatable.")] = None,
    precision: Annotated[list[str] | None, typer.Option(help="Only float32, or float64. Repeatable.")] = None,
    total_seconds: Annotated[float, typer.Option(help="Begin no new search after so long.")] = 180.0,
    write: Annotated[Path | None, typer.Option(help="Save the scene so configured (.toml).")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file of --write.")] = False,
    check: Annotated[
        bool, typer.Option("--check", help="Then measure every method and step size, to see if the advice is right.")
    ] = False,
    settings: Settings = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Measure which method, step size, precision and backend reaches an error soonest on this machine."""
    from app.scene_file import check_scene_target, write_scene
    from bench.advise import advise as find
    from bench.advise_check import brute_force
    from bench.store import Store

    if write is not None:
        check_scene_target(write, force)  # before the work whose result it holds
    with Store(store) as opened:
        advice = find(
            opened, _scene(scene, settings), error, backends=backend, time=time, precisions=_precisions(precision),
            total_seconds=total_seconds, command=" ".join(["softlab", *sys.argv[1:]]),
        )  # fmt: skip
        out.print(str(advice), markup=False, soft_wrap=True)
        if advice.best is None:
            raise typer.Exit(2)
        if check:
            chosen = _precisions(precision) or ("float32", "float64")
            out.print(
                str(brute_force(opened, advice, backends=backend, precisions=chosen, progress=True)),
                markup=False,
                soft_wrap=True,
            )
    if write is not None:
        path = write_scene(write, advice.configured(), advice.heading(), force=force)
        out.print(f"{path}: softlab run {path} {advice.options()}", markup=False, soft_wrap=True)


@app.command(epilog="Example: softlab ablate lab-curtain --backend cpu --set method.integrator=rk4")
def ablate(
    scene: SceneName,
    time: Annotated[float | None, typer.Option(help="Seconds simulated until it is judged (default 1.5).")] = None,
    backend: Annotated[list[str] | None, typer.Option(help="Only this backend. Repeatable.")] = None,
    settings: Settings = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """What does a scene need? Drop one part at a time: what that saves, and what error it causes."""
    from bench.ablate import ablate as measure
    from bench.ablation_results import print_ablation
    from bench.store import Store

    command = " ".join(["softlab", *sys.argv[1:]])
    with Store(store) as opened:
        summary = measure(opened, _scene(scene, settings), backends=backend, time=time, command=command)
    print_ablation(out, summary)
    if summary.interrupted:
        raise typer.Exit(130)


@app.command(epilog="Example: softlab stability --quick   (softlab stability --integrator rk4)")
def stability(
    quick: Annotated[bool, typer.Option("--quick", help="A coarser map, fewer edges.")] = False,
    integrator: Annotated[list[str] | None, typer.Option(help="Only this integrator. Repeatable.")] = None,
    backend: Annotated[list[str] | None, typer.Option(help="Only this backend. Repeatable.")] = None,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Find where every integrator breaks: outcomes over step size, stiffness and damping, and the edge by bisection."""
    from bench.stability import run_stability
    from bench.store import Store

    with Store(store) as opened:
        summary = run_stability(
            opened, quick=quick, integrators=integrator, backends=backend,
            command=" ".join(["softlab", *sys.argv[1:]]),
        )  # fmt: skip
        out.print(str(summary), markup=False, soft_wrap=True)
    if summary.interrupted:
        raise typer.Exit(130)


@app.command(epilog="Example: softlab hard --quick   (softlab hard --case B5 --integrator rk4)")
def hard(
    quick: Annotated[bool, typer.Option("--quick", help="The hand-out's step and velocity Verlet alone.")] = False,
    case: Annotated[list[str] | None, typer.Option(help="Only this row (B5) or case. Repeatable.")] = None,
    integrator: Methods = None,
    backend: Annotated[list[str] | None, typer.Option(help="Only this backend. Repeatable.")] = None,
    precision: Annotated[list[str] | None, typer.Option(help="Only float32, or float64. Repeatable.")] = None,
    pictures: Annotated[bool, typer.Option(help="End states as PNG, in the folder hard beside the store.")] = True,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Run the hard cases: grids collapsed, flipped, poked, far away; pass, fail, or refused with a diagnosis."""
    from bench.hard import run_hard
    from bench.hard_results import failed, print_hard
    from bench.store import Store

    with Store(store) as opened:
        summary = run_hard(
            opened, quick=quick, cases=case, integrators=integrator, backends=backend, precisions=precision,
            pictures=pictures, command=" ".join(["softlab", *sys.argv[1:]]),
        )  # fmt: skip
        print_hard(out, summary)
    if summary.interrupted:
        raise typer.Exit(130)
    if failed(summary):
        raise typer.Exit(1)


@app.command(epilog="Example: softlab figures --out figures")
def figures(
    store: StorePath = DEFAULT_STORE,
    folder: Folder = DEFAULT_FIGURES,
    energies: Annotated[
        Path | None, typer.Option(help="Only the energies of a trajectory written by run --record.")
    ] = None,
) -> None:
    """Draw every figure from the store, over the committed measurements."""
    from labbook.jobs import make_figures

    for path in make_figures(store, folder, energies):
        out.print(str(path), markup=False)


@app.command(epilog="Example: softlab labbook --out labbook.pdf")
def labbook(
    store: StorePath = DEFAULT_STORE, pdf: Annotated[Path, typer.Option("--out", help="The PDF.")] = DEFAULT_BOOK
) -> None:
    """Write the lab book (PDF) from the store."""
    from labbook.jobs import make_labbook

    if not store.exists() and store == DEFAULT_STORE:
        errors.print("nothing was measured here yet: the lab book tells of the committed measurements alone")
    out.print(str(make_labbook(store, pdf)), markup=False)


@app.command(epilog="Example: softlab lab --quick")
def lab(
    quick: Annotated[bool, typer.Option("--quick", help="Everything in under three minutes on two cores.")] = False,
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Everything: doctor, sweep, accuracy, stability, figures, lab book."""
    from labbook.jobs import whole_lab

    whole_lab(out, quick=quick, store_path=store, command=" ".join(["softlab", *sys.argv[1:]]))


@app.command(epilog="Example: softlab scenes")
def scenes() -> None:
    """List the scenes that come with the lab."""
    from app.tables import print_scenes

    print_scenes(out)


@app.command(epilog="Example: softlab plan lab-grid --measure")
def plan(
    scene: SceneName,
    backend: Annotated[str | None, typer.Option(help="Only this backend: cpu or gpu.")] = None,
    precision: Precision = "float32",
    measure: Annotated[bool, typer.Option("--measure", help="Time every stage, about a second a backend.")] = False,
    settings: Settings = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Print the stages of a step, their bytes and operations, each backend's kernel, and the stability limit."""
    from app.driver import BACKENDS
    from app.plan_report import plan_report

    wanted = BACKENDS if backend is None else (backend,)
    report = plan_report(_scene(scene, settings), precision, wanted, measure)
    if as_json:
        print(json.dumps(report.as_dict()))
    else:
        from app.plan_table import print_plan

        print_plan(out, report)


@app.command(epilog="Example: softlab doctor")
def doctor() -> None:
    """Say what works on this machine, and how to get the rest."""
    from app.doctor import examine
    from app.tables import print_findings

    print_findings(out, examine())


@app.command(epilog="Example: softlab export my-machine.csv")
def export(
    file: Annotated[Path, typer.Argument(help="A new .csv or .sqlite file.")], store: StorePath = DEFAULT_STORE
) -> None:
    """Write the store to one file, to keep or to send."""
    from bench.store import Store
    from bench.transfer import export as export_store

    with Store(store, readonly=True) as opened:
        out.print(str(export_store(opened, file)), markup=False)


@app.command(epilog="Example: softlab merge other-machine.csv")
def merge(
    other: Annotated[Path, typer.Argument(help="A .csv or .sqlite file.")], store: StorePath = DEFAULT_STORE
) -> None:
    """Take the measurements of another store into this one; doing it twice adds nothing."""
    from bench.store import Store
    from bench.transfer import merge as merge_store

    with Store(store) as opened:
        new = merge_store(opened, other)
    out.print(", ".join(f"{count} new in {table}" for table, count in new.items()))


if __name__ == "__main__":
    main()
