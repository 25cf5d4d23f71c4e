"""Ranks of MPI: processes on this machine, started as a user starts them. Without mpi4py these are skipped."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from softlab.model.domains.shared_fluid import BALANCED_EVERY

ROOT = Path(__file__).resolve().parents[2]
ALIKE = ["--math", "exact", "--no-judge", "--threads", "1"]
COMMAND = ["-m", "softlab", "run", "lab-grid", *ALIKE]
needs_mpi = pytest.mark.skipif(find_spec("mpi4py") is None, reason='mpi4py is not installed: pip install -e ".[mpi]"')


def softlab(*arguments, scene="lab-grid", **environment):
    done = subprocess.run(
        [sys.executable, "-m", "softlab", "run", scene, *ALIKE, *map(str, arguments)],
        cwd=ROOT, capture_output=True, text=True, timeout=500, env={**os.environ, **environment},
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


def states(folder, arguments, *, ranks, scene="lab-grid", **environment):
    """The files of positions and velocities that one process and `ranks` leave."""
    found = []
    for count in (1, ranks):
        out = folder / f"{count}.npz"
        status, _, told = softlab(*arguments, "--ranks", count, "--out", out, scene=scene, **environment)
        assert status == 0, told
        with np.load(out) as state:
            found.append((state["position"], state["velocity"], int(state["step"])))
    return found


def assert_same(found):
    (position, velocity, step), (other_position, other_velocity, other_step) = found
    assert np.array_equal(position, other_position) and np.array_equal(velocity, other_velocity)
    assert step == other_step


@needs_mpi
def test_processes_have_the_bits_of_one_after_1_000_steps(tmp_path):
    """The gate: exact math, whatever the number of processes (of threads: test_shares.py); one of them has neighbours on both
    sides, and rows do not divide evenly."""
    assert_same(states(tmp_path, ["--steps", 1000, "--set", "grid.rows=40"], ranks=3))


@needs_mpi
def test_processes_have_the_bits_of_one_of_bodies(tmp_path):
    """Clay, putty and jelly on the ground after 80 steps; their rotations and what clay was bent into are gathered, too."""
    assert_same(states(tmp_path, ["--steps", 80], ranks=2, scene="plastic"))
    with np.load(tmp_path / "1.npz") as one, np.load(tmp_path / "2.npz") as two:
        assert all(np.array_equal(one[name], two[name]) for name in ("rotation", "plastic", "inverse_mass"))
        assert np.abs(one["plastic"] - np.eye(3)).max() > 1e-3


@needs_mpi
def test_processes_have_the_bits_of_one_of_a_fluid(tmp_path):
    """A dam break along the floor of a narrow tank; slabs are balanced anew (three times: test_shared_fluid.py)."""
    pool = {
        "water.size": [1.2, 0.05, 0.05],
        "water.rest_distance": 0.05,
        "right.point": [3, 0, 0],
        "method.substeps": 1,
    }
    pool |= {"front.point": [0, 0, 0.05], "method.iterations": 1}
    settings = [word for field, value in pool.items() for word in ("--set", f"{field}={value}")]
    steps = BALANCED_EVERY + 2
    assert_same(states(tmp_path, ["--steps", steps, *settings], ranks=3, scene="dam-break", SOFTLAB_PLAIN_PYTHON="1"))


@needs_mpi
def test_processes_have_the_bits_of_one_of_a_mesh(tmp_path):
    """A cantilever in three partitions after 5 steps of 60 substeps."""
    assert_same(states(tmp_path, ["--steps", 5], ranks=3, scene="fem-cantilever"))


@needs_mpi
def test_two_processes_write_one_file_and_print_one_report(tmp_path):
    out = tmp_path / "end.npz"
    arguments = ["--steps", 20, "--out", out, "--json", "--set", "grid.rows=16", "--set", "grid.columns=16"]
    status, printed, told = softlab(*arguments, "--ranks", 2, SOFTLAB_PLAIN_PYTHON="1")
    assert status == 0 and told.count("half of the acceleration") == told.count("\n") == 1  # a note, once
    assert printed.count('"ranks": 2') == 1 and printed.count("\n") == 1
    assert out.exists()


@needs_mpi
def test_a_divergence_is_told_once_and_is_exit_status_1():
    arguments = ["--steps", 4000, "--set", "grid.rows=8", "--set", "grid.columns=8", "--set", "method.dt=0.07"]
    status, _, told = softlab(*arguments, "--allow-unstable", "--ranks", 2, SOFTLAB_PLAIN_PYTHON="1")
    assert status == 1
    assert told.count("diverged at step") == 1


@pytest.mark.parametrize(
    "arguments, said",
    [
        pytest.param(["--ranks", "33"], "at most 32", marks=needs_mpi),
        (["--ranks", "0"], "at least 1"),
        (["--ranks", "2", "--backend", "gpu"], "--gpus"),
        (["--gpus", "2"], "--backend gpu"),
        pytest.param(["--ranks", "2", "--exchange-every", "17"], "at most 16", marks=needs_mpi),
        (["--ranks", "2", "--render", "clip.mp4"], "--ranks 1"),
        (["--gpus", "2", "--backend", "gpu", "--link", "string"], "flags, nccl"),
    ],
)
def test_bad_input_is_one_line_and_exit_status_2(arguments, said):
    status, printed, told = softlab(*arguments, NUMBA_ENABLE_CUDASIM="1")
    assert status == 2 and not printed
    assert told.count("\n") == 1 and said in told


def test_without_mpiexec_one_line_says_how_to_get_it(tmp_path):
    """A Python that has no mpiexec beside it, and a path without one."""
    python = tmp_path / "python"
    python.symlink_to(sys.executable)
    code = "import sys; sys.executable = sys.argv.pop(1)\nfrom softlab import cli; sys.argv[0] = 'softlab'; cli.main()"
    done = subprocess.run(
        [sys.executable, "-c", code, str(python), *COMMAND[2:], "--ranks", "2"],
        cwd=ROOT, capture_output=True, text=True, timeout=100, env={**os.environ, "PATH": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 3
    assert "mpiexec" in done.stderr and "pip install" in done.stderr and done.stderr.count("\n") == 1


def test_processes_are_started_by_the_package_s_name(monkeypatch):
    """By its path, `python -m softlab` in a checkout that is not installed would not find the package again."""
    from softlab.app.command import ranks

    started = []
    monkeypatch.setattr(ranks, "check_launcher", lambda: "mpiexec")
    monkeypatch.setattr(
        ranks.subprocess, "run", lambda words, **_: started.extend(words) or SimpleNamespace(returncode=0)
    )
    assert ranks.start_ranks(2, ["run", "rope"]) == 1  # none of them has left a status
    assert started == ["mpiexec", "-n", "2", sys.executable, "-m", "softlab", "run", "rope"]
