"""The command line: what it prints, what it writes, and one clear line with the right exit status for every mistake."""

from __future__ import annotations

import json
import os
import re
import sqlite3
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.main import get_command

from softlab import cli

KEYS = """
    scene backend device threads threads_reason precision math kernel method particles dimensions steps dt substeps iterations
    time seconds compile_seconds particle_steps_per_second kinetic_energy potential_energy conserved max_speed max_strain
    error error_reason outcome resolution
""".split()  # noqa: SIM905
SMALL = "--set grid.rows=6 --set grid.columns=6"


class Outcome:
    """Exit status, standard output and standard error of one command."""

    def __init__(self, status: int, out: str, err: str):
        self.status, self.out, self.err = status, out, err


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """command("run lab-grid ...") runs the command line in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run(line: str | list[str]) -> Outcome:
        words = line.split() if isinstance(line, str) else line
        monkeypatch.setattr(sys, "argv", ["softlab", *words])
        status = 0
        try:
            cli.main()
        except SystemExit as error:
            status = int(error.code or 0)
        captured = capsys.readouterr()
        return Outcome(status, captured.out, captured.err)

    return run


def refused(outcome: Outcome, status: int, *words: str) -> None:
    """One line on standard error that holds the words, nothing on standard output, no traceback."""
    assert outcome.status == status, outcome.err
    assert "Traceback" not in outcome.err
    assert outcome.out == ""
    for word in words:
        assert word in outcome.err, outcome.err
    if outcome.err.startswith("softlab: "):
        assert len(outcome.err.strip().splitlines()) == 1, outcome.err


def test_run_prints_what_the_design_promises(command) -> None:
    outcome = command("run lab-grid --steps 1000 --json --no-judge")
    assert outcome.status == 0
    report = json.loads(outcome.out)
    assert list(report) == KEYS
    assert report["particles"] == 1024 and report["steps"] == 1000 and report["outcome"] == "ok"
    assert report["time"] == pytest.approx(10.0) and report["error"] is None and report["error_reason"]


def test_run_tells_its_error(command) -> None:
    outcome = command(f"run lab-curtain {SMALL} --time 0.5 --json --precision float64")
    report = json.loads(outcome.out)
    assert report["error_reason"] is None
    assert 1e-8 < report["error"] < 0.01  # velocity Verlet, second order


def test_the_random_force_has_no_reference(command) -> None:
    report = json.loads(command(f"run lab-grid {SMALL} --set external.magnitude=0.1 --steps 5 --json").out)
    assert report["error"] is None and "random force" in report["error_reason"]


def test_every_promised_path_can_be_set(command) -> None:
    values = {
        "grid.rows": "4",
        "grid.columns": "5",
        "grid.spacing": "0.5",
        "grid.mass": "0.02",
        "grid.pinned": "[[0, 0], [1, 2]]",
        "springs.stiffness": "5",
        "springs.rest_length": "0.4",
        "damping.coefficient": "0.01",
        "gravity.enabled": "true",
        "gravity.acceleration": "1.62",
        "external.magnitude": "0.01",
        "external.seed": "7",
        "method.integrator": "rk4",
        "method.dt": "0.001",
    }
    words = [word for path, value in values.items() for word in ("--set", f"{path}={value}")]
    outcome = command(["run", "lab-grid", "--steps", "3", "--json", *words])
    assert outcome.status == 0, outcome.err
    assert json.loads(outcome.out)["particles"] == 20


def test_a_state_is_written_and_continued_bit_for_bit(command, tmp_path: Path) -> None:
    exact = f"run lab-grid {SMALL} --math exact --no-judge"
    assert command(f"{exact} --steps 30 --out whole.npz").status == 0
    assert command(f"{exact} --steps 10 --out part.npz").status == 0
    assert command(f"{exact} --steps 20 --initial part.npz --out rest.npz").status == 0
    whole, rest = np.load(tmp_path / "whole.npz"), np.load(tmp_path / "rest.npz")
    assert set(whole.files) == {"position", "velocity", "inverse_mass", "time", "step"}
    assert np.array_equal(whole["position"], rest["position"])
    assert int(rest["step"]) == 30 and float(rest["time"]) == pytest.approx(0.3)


def test_a_trajectory_is_recorded(command, tmp_path: Path) -> None:
    assert command(f"run lab-grid {SMALL} --steps 25 --record every=10 traj.npz --no-judge").status == 0
    with np.load(tmp_path / "traj.npz") as archive:
        assert archive["position"].shape == (3, 36, 2)
        assert list(archive["step"]) == [0, 10, 20]
        assert json.loads(str(archive["scene"]))["grid"]["rows"] == 6


def test_a_time_is_rounded_aloud(command) -> None:
    outcome = command(f"run lab-grid {SMALL} --time 0.055 --json --no-judge")
    assert "rounded" in outcome.err
    assert json.loads(outcome.out)["steps"] in (5, 6)


def test_a_divergence_is_reported_and_the_last_good_state_kept(command, tmp_path: Path) -> None:
    outcome = command(
        f"run lab-grid {SMALL} --set method.dt=0.06 --set external.magnitude=0.1 --steps 5000 --allow-unstable --json "
        "--out last.npz"
    )
    assert outcome.status == 1
    assert json.loads(outcome.out)["outcome"] == "diverged"
    assert "diverged at step" in outcome.err and "0.03125" in outcome.err
    with np.load(tmp_path / "last.npz") as archive:
        assert np.isfinite(archive["position"]).all()


@pytest.mark.parametrize(
    "name", ["scenes", "plan lab-grid", "doctor", "--help", "run --help", "lab --help", "throughput --help"]
)
def test_what_only_tells(command, name: str) -> None:
    outcome = command(name)
    assert outcome.status == 0 and outcome.out


def test_help_names_values_and_prints_no_types(command) -> None:
    for name in ("", *get_command(cli.app).commands):  # type: ignore[attr-defined]
        text = command(f"{name} --help").out
        assert not re.search(r"<(bool|str|int|float|path|list)|\{\w", text.replace("{frame:04d}", "")), text
    run = command("run --help").out
    assert all(re.search(rf"--{line}\b", run) for line in (r"steps +N", r"time +NUMBER", r"out +FILE", r"math +MATH"))
    assert "run [OPTIONS] SCENE " in run


def test_a_version_is_told(command) -> None:
    told = command("--version")
    assert told.status == 0 and told.out.startswith("softlab 0."), told.out


def test_help_needs_no_heavy_library() -> None:
    import subprocess

    code = "import sys, softlab; print([m for m in ('numba', 'pyglet', 'matplotlib', 'typst') if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


BAD = [
    ("run", "lab-gird", ["unknown scene", "lab-grid"]),
    ("run", "no/such/file.toml", ["no such file"]),
    ("run", ".", ["directory"]),
    ("plan lab-grid", "--backend tpu", ["--backend"]),
    ("run lab-grid", "--set grid.rows=0", ["grid.rows", "at least 1"]),
    ("run lab-grid", "--set grid.rows=-3", ["grid.rows", "at least 1"]),
    ("run lab-grid", "--set grid.rows=many", ["grid.rows", "whole number"]),
    ("run lab-grid", "--set grid.rows=1.5", ["grid.rows", "whole number"]),
    ("run lab-grid", "--set grid.rows=99999999 --set grid.columns=99999999", ["PiB", "free"]),
    ("run lab-grid", "--set grid.mass=0", ["grid.mass", "greater than 0"]),
    ("run lab-grid", "--set grid.mass=-1", ["grid.mass"]),
    ("run lab-grid", "--set grid.mass=nan", ["grid.mass"]),
    ("run lab-grid", "--set grid.mass=inf", ["grid.mass", "finite"]),
    ("run lab-grid", "--set grid.mass=1e-60", ["grid.mass = 1e-60 is too small", "--allow-unstable"]),
    ("run lab-grid", "--set gravity.acceleration=1e60", ["float32"]),
    ("run lab-grid", "--set springs.stiffness=0", ["springs.stiffness"]),
    ("run lab-grid", "--set springs.stiffness=nan", ["springs.stiffness"]),
    ("run lab-grid", "--set method.dt=0", ["method.dt"]),
    ("run lab-grid", "--set method.dt=-inf", ["method.dt"]),
    ("run lab-grid", "--set method.dt=0.04", ["0.03125", "--allow-unstable"]),
    ("run lab-grid", "--set method.integrator=euler", ["method.integrator", "rk4"]),
    ("run lab-grid", "--set grid.colour=red", ["unknown key"]),
    ("run lab-grid", "--set grd.rows=3", ["unknown part", "grid"]),
    ("run lab-grid", "--set grid.rows", ["key=value"]),
    ("run lab-grid", "--set grid.pinned=[[0,99]]", ["outside the grid"]),
    ("run lab-grid", "--set grid.pinned=sideways", ["grid.pinned", "top-corners"]),
    ("run lab-grid", "--backend tpu", ["--backend", "cpu, gpu"]),
    ("run lab-grid", "--threads 3x", ["--threads", "1x, 2x, 4x"]),
    ("run lab-grid", "--threads 0", ["--threads"]),
    ("run lab-grid", "--threads 100000", ["NUMBA_NUM_THREADS"]),
    ("run lab-grid", "--precision float16", ["--precision"]),
    ("run lab-grid", "--math quick", ["--math"]),
    ("run lab-grid", "--kernel fastest", ["--kernel", "fused"]),
    ("run lab-grid", "--steps -1", ["--steps"]),
    ("run lab-grid", "--steps some", ["--steps"]),
    ("run lab-grid", "--time nan", ["--time"]),
    ("run lab-grid", "--time 1 --steps 1", ["--time"]),
    ("run lab-grid", "--out nowhere/state.npz", ["does not exist"]),
    ("run lab-grid", "--out state.txt", [".npz"]),
    ("run lab-grid", "--render picture.gif", [".png"]),
    ("run lab-grid", "--record every=0 t.npz", ["every=N"]),
    ("run lab-grid", "--record often t.npz", ["every=N"]),
    ("run lab-grid", f"--record every={'9' * 5000} t.npz", ["every=N"]),
    ("run lab-grid", "--render=", ["empty name", ".png"]),
    ("run lab-grid", "--initial none.npz", ["no such file"]),
    ("plan", "lab-grid --precision half", ["--precision"]),
    ("sweep", "--backend tpu", ["--backend"]),
    ("sweep", "--kernel fused", ["--kernel", "add --kernels"]),
    ("throughput", "--kind gas", ["--kind", "soft, rigid, heap, grid"]),
    ("busy", "--scene gas", ["--scene", "lab-grid", "soft-pile"]),
    ("throughput", "--precision half", ["--precision", "float32"]),
    ("throughput", "--backend tpu", ["--backend"]),
    ("throughput", "5", ["unexpected argument"]),
    ("projections", "--precision half", ["--precision", "float32"]),
    ("demo lab-grid", "cloth-hanging", ["SCENE", "lab-grid", "masses in a plane"]),
    ("demo lab-grid", "lab-gird", ["unknown scene"]),
    ("demo lab-grid", "--frames 0", ["--frames"]),
    ("figures", "--store nothing.sqlite", ["nothing.sqlite"]),
    ("figures", "--energies none.npz", ["none.npz", "--record every=N"]),
    ("export", "file.csv --store nothing.sqlite", ["nothing.sqlite"]),
    ("merge", "nothing.csv --store new.sqlite", ["nothing.csv"]),
    ("frobnicate", "", ["frobnicate"]),
    ("run lab-grid", "--record every=1", ["--record every=N FILE.npz", "softlab run --help"]),
    ("run lab-grid", "--set title=x", ["the key 'title'", "grid.rows"]),
    ("run lab-grid", "--set grid.mass=1e-320", ["stiffness over mass", "larger mass"]),
    ("run lab-grid", "--link foo", ["--link", "flags, nccl"]),
    (
        "run lab-grid",
        "--backend gpu --gpus 2 --link peer",
        ["--link", "was removed; use flags, which is faster, or nccl"],
    ),
    ("run lab-grid", "--link nccl", ["--link", "add --gpus or --ranks"]),
    ("run lab-grid", "--exchange-every 3", ["--exchange-every", "add --gpus or --ranks"]),
    ("run lab-grid", "--ranks 4 --backend gpu", ["--ranks", "--backend cpu"]),
    ("run lab-grid", "--ranks 2 --gpus 2", ["--gpus", "mutually exclusive"]),
    ("run float", "--gpus 3", ["--gpus", "a world is not supported on several", "leave --gpus out"]),
    ("plan dam-break", "--gpus 2", ["--gpus", "thinner than their halo"]),
    ("plan lab-grid", "--exchange-every 4", ["--exchange-every", "--gpus"]),
    ("sweep", "--link nccl", ["--link", "add --gpus"]),
    ("sweep", "--exchange-every 3", ["--exchange-every", "add --gpus"]),
    ("sweep", "--gpus 0", ["--gpus", "at least 1"]),
    ("fluids", "--peers", ["--peers", "applies to --truth and --rest"]),
    ("advise lab-curtain", "--error 0.1 --force", ["--force", "add --write"]),
    ("advise lab-curtain", "--error 0.1 --check", ["--check", "was removed", "softlab run with --set"]),
    ("scale", "--exchange-every 0", ["--exchange-every"]),
    ("scale", "--exchange-every 100000", ["--exchange-every", "use at most"]),
    ("scale", "--jitter nan", ["--jitter"]),
    ("scale", "--per-host 0", ["--per-host"]),
    ("scale", "--latency -1", ["--latency = -1.0"]),
    ("scale", "--gpus 10000000000", ["--gpus"]),
]


@pytest.mark.parametrize("start,options,words", BAD, ids=[f"{start} {options}".strip() for start, options, _ in BAD])
def test_bad_input_gets_one_line_and_leaves_nothing(
    command, tmp_path: Path, start: str, options: str, words: list[str]
) -> None:
    before = set(tmp_path.iterdir())
    refused(command(f"{start} {options}"), 2, *words)
    left = {path.name for path in set(tmp_path.iterdir()) - before}
    assert left <= {"new.sqlite", "new.sqlite-wal", "new.sqlite-shm"}, left


@pytest.mark.skipif(os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("0", ""), reason="the simulator is a GPU here")
def test_a_missing_gpu_is_exit_3_with_the_remedy(command) -> None:
    from softlab.gpu_backend.core.device import gpu_available

    if gpu_available()[0]:
        pytest.skip("there is a GPU")
    refused(command("run lab-grid --backend gpu"), 3, "pip install")


def test_bad_states(command, tmp_path: Path) -> None:
    def saved(name: str, **arrays: object) -> str:
        np.savez(tmp_path / name, **arrays)  # type: ignore[arg-type]
        return name

    good = np.zeros((36, 2))
    cases = {
        saved("shape.npz", position=np.zeros((35, 2))): "shape",
        saved("nan.npz", position=np.full((36, 2), np.nan)): "finite",
        saved("huge.npz", position=np.full((36, 2), 1e300)): "float32",
        saved("text.npz", position=np.full((36, 2), "a")): "numbers",
        saved("none.npz", velocity=good): "position",
        saved("mass.npz", position=good, inverse_mass=np.ones(36)): "inverse_mass",
        saved("when.npz", position=good, time=np.inf): "time",
    }
    (tmp_path / "noise.npz").write_bytes(b"PK\x03\x04 not really a zip")
    (tmp_path / "array.npz").write_bytes(b"\x93NUMPY")
    cases |= {"noise.npz": "npz", "array.npz": "npz"}
    for name, word in cases.items():
        refused(command(f"run lab-grid {SMALL} --initial {name}"), 2, word)


def test_a_store_that_is_none(command, tmp_path: Path) -> None:
    (tmp_path / "noise.sqlite").write_bytes(b"no database at all, just text that goes on for a while" * 50)
    refused(command("sweep --quick --store noise.sqlite"), 2, "noise.sqlite")
    refused(command("labbook --store noise.sqlite"), 2, "noise.sqlite")
    with sqlite3.connect(tmp_path / "future.sqlite") as database:
        database.executescript("CREATE TABLE schema_version (version INTEGER); INSERT INTO schema_version VALUES (99);")
    refused(command("accuracy --quick --store future.sqlite"), 2, "version")


KNOWN_WORDS = """
    run plan scenes export merge lab-grid --set grid.rows=2 grid.rows= = --steps 1 -1 --json --threads --time 1e999 nan
    --out x.npz --record every=1 --precision --help
""".split()  # noqa: SIM905
WORDS = st.one_of(
    st.sampled_from(KNOWN_WORDS),
    st.text(alphabet=st.characters(blacklist_categories=("Cs",), blacklist_characters="\0"), max_size=12),
)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(WORDS, max_size=6))
def test_nonsense_never_shows_a_traceback(command, words: list[str]) -> None:
    if words and words[0] in ("demo", "sweep", "accuracy", "lab", "labbook", "figures", "doctor"):
        return
    outcome = command(words)
    assert outcome.status in (0, 1, 2, 3)
    assert "Traceback" not in outcome.err
