"""What a command's exit status tells a script: 0 done, 1 diverged, incomplete or failed, 2 bad input or no answer, 3 a
backend that is not there, 130 stopped by Ctrl-C. One table: the command, how its work (which is faked) ends, the status."""

from __future__ import annotations

import errno
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from softlab import cli
from softlab.bench.experiments.advise.advice import Advice
from softlab.bench.stress.results import HardRow, HardSummary
from softlab.model.base.errors import BackendUnavailable, Diverged, Incomplete, InputError, SceneError
from softlab.model.scene.scene import load_scene

SCENE = load_scene("lab-grid")


class Summary(SimpleNamespace):
    """Of a command that measures: what it prints."""

    interrupted = False
    machine = "m"

    def __str__(self) -> str:
        return "measured"


DONE, STOPPED = Summary(), Summary(interrupted=True)
REPORT = {"outcome": "ok", "error": None, "error_reason": "made up"}


def hard(*verdicts: str, interrupted: bool = False) -> HardSummary:
    rows = [HardRow("B4", "lab", "cpu", "float64", 0.01, verdict, "", ()) for verdict in verdicts]
    return HardSummary("m", rows=rows, interrupted=interrupted)


def ran(diverged: Diverged | None = None, incomplete: Incomplete | None = None) -> Any:
    return SimpleNamespace(
        notes=[],
        report=dict(REPORT),
        scene=SCENE,
        state=None,
        diverged=diverged,
        incomplete=incomplete,
        written=[],
        rank=0,
    )


def advice(**found: Any) -> Advice:
    return Advice(SCENE, 1e-3, 1.5, 0.1, machine="m", **found)


MEASURING = {  # command -> what does its work
    "sweep": "softlab.bench.experiments.sweep.run_sweep",
    "sweep --kernels": "softlab.bench.experiments.kernel_sweep.run_kernel_sweep",
    "sweep --peers": "softlab.bench.peers.sweep.run_peers",
    "accuracy --no-findings": "softlab.bench.experiments.accuracy.experiment.Accuracy.__call__",
    "accuracy": "softlab.bench.experiments.findings.experiment.Findings.__call__",
    "stability": "softlab.bench.experiments.stability.experiment.Stability.__call__",
    "projections": "softlab.bench.experiments.projections.Projections.__call__",
    "throughput": "softlab.bench.experiments.throughput.Throughput.__call__",
    "fluids": "softlab.bench.experiments.fluids.Fluids.__call__",
    "bar": "softlab.bench.experiments.bar_rows.BarMaterial.__call__",
    "tetrahedra": "softlab.bench.experiments.tetrahedral.decides.Tetrahedra.__call__",
    "ablate lab-grid": "softlab.bench.experiments.advise.ablate.ablate",
}
EVERY = MEASURING | {
    "hard": "softlab.bench.stress.experiment.Hard.__call__",
    "advise lab-grid --error 1e-3": "softlab.bench.experiments.advise.answer.measure_advice",
    "run lab-grid --no-judge": "softlab.app.command.run.run_scene",
    "run lab-grid": "softlab.bench.experiments.accuracy.judge.judge_run",
    "demo": "softlab.app.window.viewer.run_demo",
    "figures": "softlab.labbook.jobs.make_figures",
    "labbook": "softlab.labbook.jobs.make_labbook",
    "film": "softlab.labbook.jobs.make_film",
    "lab": "softlab.labbook.jobs.whole_lab",
    "scenes": "softlab.app.command.tables.print_scenes",
    "plan lab-grid": "softlab.app.plan.report.plan_report",
    "doctor": "softlab.app.command.doctor.examine",
    "export out.csv": "softlab.bench.store.transfer.export",
    "merge in.csv": "softlab.bench.store.transfer.merge",
}
ENDS: list[tuple[str, str, Any, int]] = [  # command, what does its work, what that returns or raises, the status
    *((command, work, DONE, 0) for command, work in MEASURING.items()),
    *((command, work, STOPPED, 130) for command, work in MEASURING.items()),
    *((command, work, KeyboardInterrupt(), 130) for command, work in EVERY.items()),
    *((command, work, SceneError("method.dt", 0, "must be greater than 0"), 2) for command, work in EVERY.items()),
    *((command, work, InputError("nothing there; give another path"), 2) for command, work in EVERY.items()),
    *((command, work, BackendUnavailable("no driver", "install one"), 3) for command, work in EVERY.items()),
    *((command, work, BrokenPipeError(errno.EPIPE, "Broken pipe"), 0) for command, work in EVERY.items()),
    ("hard", EVERY["hard"], hard("pass", "refused", "known"), 0),
    ("hard", EVERY["hard"], hard("pass", "fail"), 1),
    ("hard", EVERY["hard"], hard("pass", interrupted=True), 130),
    ("hard", EVERY["hard"], hard("fail", interrupted=True), 130),
    ("advise lab-grid --error 1e-3", EVERY["advise lab-grid --error 1e-3"], advice(why="chaos"), 2),
    ("advise lab-grid --error 1e-3 --write fast.toml", EVERY["advise lab-grid --error 1e-3"], advice(why="none"), 2),
    ("run lab-grid --no-judge --json", EVERY["run lab-grid --no-judge"], ran(), 0),
    ("run lab-grid --no-judge --json", EVERY["run lab-grid --no-judge"], ran(Diverged(3, 1, 0.1, 0.03)), 1),
    ("run lab-grid --no-judge --json", EVERY["run lab-grid --no-judge"], ran(None, Incomplete("13 inverted")), 1),
]


@pytest.mark.parametrize(
    ("command", "work", "end", "status"),
    ENDS,
    ids=[f"{one[0]}: {type(one[2]).__name__} {k}" for k, one in enumerate(ENDS)],
)
def test_the_status_tells_how_it_ended(
    command: str, work: str, end: Any, status: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def worked(*_: Any, **__: Any) -> Any:
        if isinstance(end, BaseException):
            raise end
        return end

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["softlab", *command.split()])
    for path in MEASURING.values():  # what comes before or after in the same command
        monkeypatch.setattr(path, lambda *_, **__: DONE)
    monkeypatch.setattr("softlab.bench.experiments.findings.costs.Costs.__call__", lambda *_, **__: DONE)
    monkeypatch.setattr("softlab.bench.experiments.tetrahedral.meshes.Meshes.__call__", lambda *_, **__: DONE)
    monkeypatch.setattr("softlab.bench.experiments.bar_costs.BarCosts.__call__", lambda *_, **__: DONE)
    monkeypatch.setattr("softlab.bench.experiments.convergence.Convergence.__call__", lambda *_, **__: DONE)
    for path in ("softlab.bench.measure.tables.print_sweep", "softlab.bench.measure.tables.print_kernels",
                 "softlab.bench.peers.results.print_peers",
                 "softlab.bench.experiments.throughput.Throughput.show", "softlab.bench.experiments.fluids.Fluids.show",
                 "softlab.bench.experiments.advise.ablation_results.print_ablation"):  # fmt: skip
        monkeypatch.setattr(path, lambda *_: None)
    if work != EVERY["run lab-grid --no-judge"]:
        monkeypatch.setattr("softlab.app.command.run.run_scene", lambda *_: ran())
    (tmp_path / "in.csv").touch()
    (tmp_path / "softlab-results").mkdir()
    if command.startswith("export"):
        from softlab.bench.store.database import Store

        with Store() as store:
            store.add_machine("m", "Some CPU", {})
    monkeypatch.setattr(work, worked)
    if isinstance(end, BrokenPipeError):
        monkeypatch.setattr("os.dup2", lambda *_: None)  # of the test's own output
        monkeypatch.setattr(sys.stdout, "fileno", lambda: 1, raising=False)
    left = 0
    try:
        cli.main()
    except SystemExit as error:
        left = int(error.code or 0)
    told = capsys.readouterr()
    assert left == status, told.err
    assert "Traceback" not in told.err
    if status in (1, 2, 3) and isinstance(end, Exception):
        assert told.err.splitlines()[-1].startswith("softlab: ")
    if isinstance(end, KeyboardInterrupt):
        assert told.err.splitlines()[-1] == "softlab: stopped"
    assert not (tmp_path / "fast.toml").exists()


def test_a_process_that_is_asked_to_end_tidies_up_as_for_ctrl_c() -> None:
    """SIGTERM, as `timeout` and batch systems send it: one line and status 130, by way of every `finally`."""
    code = (
        "import os, signal, time\nfrom softlab import cli\n"
        "def work(**_):\n"
        "    try:\n"
        "        os.kill(os.getpid(), signal.SIGTERM), time.sleep(30)\n"
        "    finally: print('tidied')\n"
        "cli.app = work\n"
        "cli.main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr.strip()) == (130, "tidied\n", "softlab: stopped")


def test_ctrl_c_is_answered_before_all_is_imported() -> None:
    code = (
        "import os, signal, sys\n"
        "sys.argv[0] = 'bin/softlab'\n"
        "from softlab.app.command.stopping import install_interrupt_handler\n"
        "install_interrupt_handler()\n"
        "os.kill(os.getpid(), signal.SIGINT)\n"
        "print('went on')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr.strip()) == (130, "", "softlab: stopped")


@pytest.mark.parametrize(
    "line, told",
    [
        ("run lab-grid --steps 1.5", "--steps = '1.5': must be a whole number"),
        ("advise lab-grid --error abc", "--error = 'abc': must be a number"),
        ("sweep --quick --min-ms -5", "--min-ms = -5.0: must be"),
        ("sweep --quick --size 0", "--size = 0: a grid has"),
    ],
)
def test_what_was_typed_is_what_is_told(
    line: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["softlab", *line.split()])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2 and told in capsys.readouterr().err
