"""What starts workers: submitit, Slurm by what it is handed, Dask; and what is told where one of them is not there."""

from __future__ import annotations

import os
import signal
import stat
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from fake_cluster import REPEATS, logged, run_fake, sampled
from typer.testing import CliRunner

from softlab import cli
from softlab.app.command.command_line import exit_status
from softlab.bench.cluster import dask_pool
from softlab.bench.cluster.pools import Where, where_of
from softlab.bench.cluster.start import FOLDER, on_cluster, pool_of
from softlab.bench.store.database import Store
from softlab.model.base.errors import BackendUnavailable, SceneError

ROOT = Path(__file__).parents[2]
GROUPS = [[2], [3], [4]]


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """By workers, what the tests measure."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(ROOT / "tests" / "cluster")]))


def measured(tmp_path: Path, where: Where, losses: Sequence[str] = (), **how: Any) -> None:
    """Workers of a real pool measure all, once, those that were lost for such reasons none the less."""
    (tmp_path / "log").mkdir()
    how |= {"groups": GROUPS, "log": str(tmp_path / "log")}
    with Store(tmp_path / "results.sqlite") as store:
        summary = on_cluster(store, run_fake, where, timed=False, command="fake", progress=False, beat=0.1, how=how)
        assert summary.measured == len(GROUPS) and not summary.abandoned, summary
        assert len(summary.losses) == len(losses), summary
        assert all(why in told for why, told in zip(losses, summary.losses, strict=True)), summary
        assert len(sampled(store)) == REPEATS * len(GROUPS)
    assert not (tmp_path / f"results{FOLDER}").exists()


def test_workers_by_submitit(tmp_path: Path) -> None:
    pytest.importorskip("submitit", reason='pip install -e ".[cluster]"')
    measured(tmp_path, Where("local", workers=2), ["killed by signal 9"], dies_once=3)


def test_workers_by_dask(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason='pip install -e ".[cluster]"')
    with distributed.LocalCluster(
        n_workers=2, processes=False, threads_per_worker=1, dashboard_address=":0", host="127.0.0.1", protocol="tcp"
    ) as cluster:
        measured(tmp_path, Where("dask", cluster.scheduler_address.removeprefix("tcp://")))


def test_a_dask_worker_that_is_gone_is_replaced(tmp_path: Path) -> None:
    """Its process dies under the lab's worker, which stops; Dask starts another, and so does the sweep."""
    distributed = pytest.importorskip("distributed", reason='pip install -e ".[cluster]"')
    with distributed.LocalCluster(
        n_workers=1, processes=True, threads_per_worker=1, dashboard_address=":0", host="127.0.0.1", protocol="tcp"
    ) as cluster:
        (worker,) = cluster.workers.values()

        def kill() -> None:
            while len(logged(tmp_path / "log", "sample") if (tmp_path / "log").exists() else ()) < 2:
                time.sleep(0.02)
            os.kill(worker.process.process.pid, signal.SIGKILL)

        thread = threading.Thread(target=kill, daemon=True)
        thread.start()
        where = Where("dask", cluster.scheduler_address.removeprefix("tcp://"))
        measured(tmp_path, where, ["the process that started it is gone"], seconds=0.5)
        thread.join()


SBATCH = """#!/bin/sh
for file; do :; done  # the last one, of which Slurm keeps a copy: it is moved away as soon as this ends
cp "$file" {folder}/handed.sh
echo "$file" >> {folder}/files
number=$(wc -l < {folder}/files)
cp "$file" {folder}/job$number.sh
SLURM_JOB_ID=$number SLURM_JOB_NODELIST=here sh {folder}/job$number.sh > {folder}/out 2>&1 &
echo "Submitted batch job $number"
"""
SACCT = """#!/bin/sh
echo 'JobID|State|NodeList'
for number in 1 2 3; do echo "$number|RUNNING|here"; done
"""


@pytest.fixture
def slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Commands of Slurm's names, which keep what they are handed, as handed.sh, and run it here."""
    pytest.importorskip("submitit", reason='pip install -e ".[cluster]"')
    here = tmp_path / "bin"
    here.mkdir()
    for name, text in {"sbatch": SBATCH, "srun": "#!/bin/sh", "sacct": SACCT, "scancel": "#!/bin/sh"}.items():
        (here / name).write_text(text.format(folder=tmp_path))
        (here / name).chmod(stat.S_IRWXU)
    monkeypatch.setenv("PATH", f"{here}{os.pathsep}{os.environ['PATH']}")
    return tmp_path / "handed.sh"


@pytest.mark.parametrize(("timed", "backends"), [(True, None), (True, ("gpu",)), (False, ())])
def test_slurm_is_handed_jobs_with_a_node_each_where_something_is_timed(
    tmp_path: Path, slurm: Path, timed: bool, backends: Sequence[str] | None
) -> None:
    pool = pool_of(where_of("slurm", 2, ["partition=fast", "time=30"]), tmp_path / "folder", backends)
    pool.start(0, tmp_path / "folder", "1.1")
    handed = slurm.read_text().splitlines()
    assert ("#SBATCH --exclusive" in handed) == timed
    assert {"#SBATCH --partition=fast", "#SBATCH --time=30", "#SBATCH --nodes=1"} <= set(handed)
    assert not any("srun" in line for line in handed), "a step of srun's would have one core"
    assert pool.slots == 2


def test_workers_by_slurm(tmp_path: Path, slurm: Path) -> None:
    measured(tmp_path, Where("slurm", workers=1), ["killed by signal 9"], dies_once=3)


@pytest.mark.parametrize(
    ("typed", "status", "said"),
    [
        ("--cluster cloud", 2, "must be local, slurm, or dask://"),
        ("--cluster dask://nowhere", 2, "must be local, slurm, or dask://"),
        ("--cluster local --workers 0", 2, "--workers = 0: must be at least 1"),
        ("--workers 3", 2, "goes with --cluster"),
        ("--sbatch partition=x", 2, "goes with --cluster"),
        ("--cluster local --sbatch partition=x", 2, "needs --cluster slurm"),
        ("--cluster slurm --sbatch partition", 2, "must be NAME=VALUE"),
        ("--cluster local --peers", 2, "cannot be combined with --peers"),
        ("--cluster slurm", 3, "sbatch is not on the PATH"),
        ("--cluster dask://127.0.0.1:9", 3, "no Dask scheduler answers"),
    ],
)
def test_bad_input_is_one_line_and_its_exit_status(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    typed: str,
    status: int,
    said: str,
) -> None:
    monkeypatch.setattr(dask_pool, "DASK_SECONDS", 0.3)
    if "127" in typed:
        pytest.importorskip("distributed", reason='pip install -e ".[cluster]"')
    if status == 3:
        pytest.importorskip("submitit", reason='pip install -e ".[cluster]"')
    store = tmp_path / "results.sqlite"
    words = ["sweep", "--quick", *typed.split(), "--store", str(store)]
    assert exit_status(lambda: cli.app(words, standalone_mode=False)) == status
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert said in line
    assert not store.exists() and not store.with_suffix(FOLDER).exists()


@pytest.mark.parametrize(("cluster", "missing"), [("local", "submitit"), ("dask://localhost:1", "distributed")])
def test_what_is_not_installed_is_named_with_the_way_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cluster: str, missing: str
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    with Store(tmp_path / "results.sqlite") as store, pytest.raises(BackendUnavailable, match=r"\[cluster\]") as told:
        on_cluster(store, run_fake, where_of(cluster, None, None), command="fake", progress=False, how={})
    assert told.value.exit_status == 3 and not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / f"results{FOLDER}").write_text("a file is there")
    words = ["sweep", "--quick", "--cluster", "local", "--store", str(tmp_path / "results.sqlite")]
    assert exit_status(lambda: cli.app(words, standalone_mode=False)) == 2
    assert "make its folder writable" in capfd.readouterr().err


def test_the_help_has_an_example(monkeypatch: pytest.MonkeyPatch) -> None:
    said = CliRunner().invoke(cli.app, ["sweep", "--help"]).output
    assert "--cluster" in said and "softlab sweep --cluster slurm" in " ".join(said.split())


def test_options_of_jobs_are_read() -> None:
    assert where_of("slurm", 3, ["gres=gpu:1", "mail-user=a=b"]) == Where(
        "slurm", workers=3, sbatch={"gres": "gpu:1", "mail-user": "a=b"}
    )
    assert where_of("dask://host:8786", None, None) == Where("dask", "host:8786")
    with pytest.raises(SceneError):
        where_of("dask://host", None, None)


def test_two_real_workers_time_what_one_process_would(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole way: the command, its workers, the store; each size once, by machines alike."""
    import subprocess

    from softlab.bench.store.results import timings

    pytest.importorskip("submitit", reason='pip install -e ".[cluster]"')
    store = tmp_path / "results.sqlite"
    sizes = [word for size in (8, 9, 10) for word in ("--size", str(size))]
    words = ["sweep", *sizes, "--backend", "cpu", "--threads", "1", "--precision", "float32", "--no-graphics"]
    words += ["--repeats", "2", "--min-ms", "1", "--no-again", "--store", str(store)]
    done = [
        subprocess.run(
            [sys.executable, "-m", "softlab", *words, *extra], capture_output=True, text=True, cwd=tmp_path,
            env=os.environ | {"SOFTLAB_PLAIN_PYTHON": "1"},
        )
        for extra in (["--cluster", "local", "--workers", "2"], [])
    ]  # fmt: skip
    assert [one.returncode for one in done] == [0, 0], [one.stderr for one in done]
    assert "3 configurations measured (6 samples" in done[0].stdout
    assert "0 configurations measured" in done[1].stdout and "3 already in the store" in done[1].stdout
    with Store(store, readonly=True) as opened:
        assert [(t.rows, t.count, t.error is not None) for t in timings(opened)] == [(n, 2, True) for n in (8, 9, 10)]
