"""What readers are told: commands without paths, measurements of changed files, and marks of older measurements."""

from __future__ import annotations

from pathlib import Path

import pytest
from synthetic_store import CPU_RECORD, Maker

from softlab.app.command import command_line
from softlab.bench.keys import carried
from softlab.bench.keys.carried import Carried, Group, read_map
from softlab.bench.store import versions
from softlab.bench.store.database import Store
from softlab.bench.store.transfer import export, load_text
from softlab.bench.store.versions import digest_of, refuse_changed_files
from softlab.labbook.build import CLAIMS, OLDER, marked_claim, notices
from softlab.model.base.digest import ROOT
from softlab.model.base.errors import InputError
from softlab.plots.core.older import without_older
from softlab.plots.core.read import load

OLD = "0123456789abcdef"


def test_exports_do_not_say_where_a_store_lay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store(":memory:")
    maker = Maker(store, CPU_RECORD, "c")
    maker.run = store.start_run("c", "softlab sweep --store /home/somebody/results.sqlite --backend cpu")
    maker.timing((16, 16), 1e-5, backend="cpu", threads=2, layer="omp", wait_policy="passive")
    for name in ("a.csv", "a.csv.gz"):
        exported = load_text([export(store, tmp_path / name)])
        commands = [command for (command,) in exported.query("SELECT command FROM run")]
        assert "softlab sweep --backend cpu" in commands and "somebody" not in " ".join(commands)
    monkeypatch.setattr(
        command_line.sys, "argv", ["softlab", "hard", "--store=a b.sqlite", "--case", "B5", "--store", "c"]
    )
    assert command_line.typed() == "softlab hard --case B5"


def test_changed_files_are_not_measured_unasked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(versions, "_revision", lambda: "9613136a2b1c+")
    with pytest.raises(InputError, match=r"differ from commit 9613136a2b1c.*--allow-dirty"):
        refuse_changed_files(False)
    refuse_changed_files(True)
    assert versions.code_version().startswith("9613136a2b1c+ "), "every run is marked"
    for clean in ("9613136a2b1c", None):
        monkeypatch.setattr(versions, "_revision", lambda clean=clean: clean)
        refuse_changed_files(False)


def test_a_file_that_is_no_code_changes_no_revision(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import subprocess

    monkeypatch.delenv(versions.COMMIT, raising=False)
    monkeypatch.setattr(versions, "ROOT", tmp_path)
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "one.py").write_text("")

    def git(*words: str) -> None:
        identity = ("-c", "user.name=n", "-c", "user.email=e")
        subprocess.run(["git", "-C", str(tmp_path), *identity, *words], check=True, capture_output=True)

    git("init")
    git("add", ".")
    git("commit", "-m", "one")
    (tmp_path / "results.sqlite").write_text("")
    clean = versions._revision()
    assert clean and not clean.endswith("+")
    (tmp_path / "model" / "one.py").write_text("x = 1")
    assert versions._revision() == f"{clean}+"


# ---------------------------------------------------------------------- older measurements


def measured(tmp_path: Path) -> Path:
    """An export with times of 2 threads under today's sources, and of 1 thread under older ones."""
    store = Store(":memory:")
    maker = Maker(store, CPU_RECORD, "c")
    now = digest_of("cpu")
    host = {"backend": "cpu", "layer": "omp", "wait_policy": "passive"}
    maker.run = store.start_run("c", "softlab sweep", f"abc123def456 cpu:{now} gpu:{now}")
    for n in (16, 64, 256):
        maker.sources = f"{now}-1"
        maker.timing((n, n), 1e-5, **host, threads=2, precision="float32")
        maker.timing((n, n), 3e-5, **host, threads=2, precision="float64")
    maker.run = store.start_run("c", "softlab sweep --kernels", f"fed654cba321 cpu:{OLD} gpu:{now}")
    maker.sources = f"{OLD}-1"
    maker.timing((64, 64), 2e-5, **host, threads=2, precision="float32", kernel="stages")
    return export(store, tmp_path / "data.csv")


def test_what_rests_on_older_measurements_is_marked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(carried, "proved", frozenset)
    results = load(None, [measured(tmp_path)])
    (source,) = results.sources
    assert "2 of its" in source.older, "a time and its error"
    assert "commit fed654cba321" in source.provenance
    current = without_older(results)
    assert current.sources[0].timings == source.timings and not current.sources[0].kernels
    assert OLDER not in marked_claim(results, "cpu-float64").sentence
    assert "are older than this code" in source.provenance and any(OLDER in notice for notice in notices(results))
    monkeypatch.setitem(CLAIMS, "cpu-float64", lambda found: told_of(found.sources[0].kernels))
    assert marked_claim(results, "cpu-float64").sentence.endswith(OLDER)


def told_of(kernels: tuple) -> object:
    from softlab.labbook.claims.claim import Claim

    return Claim(f"{len(kernels)} kernels.", {"kernels": len(kernels)}, True)


def test_proved_measurements_are_not_older(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = measured(tmp_path)
    (timing,) = load(None, [path]).sources[0].kernels
    group = Group(OLD, "cpu", "k", "a", "source", (timing.configuration,))
    known = Carried({"cpu": digest_of("cpu")}, {OLD: ("fed654cba321", "2026-11-23")}, (group,))
    for as_of, older in ((known.as_of, False), ({"cpu": OLD}, True)):
        file = tmp_path / "map.json"
        Carried(as_of, known.commits, known.groups).write(file)
        assert read_map(file) == Carried(as_of, known.commits, known.groups)
        monkeypatch.setattr(carried, "read_map", lambda file=file: read_map(file))
        carried.proved.cache_clear()
        results = load(None, [path])
        assert (without_older(results) is not results) == older
    carried.proved.cache_clear()


def test_the_map_beside_the_data_names_what_the_data_hold() -> None:
    found = read_map()
    assert set(found.as_of) == {"cpu", "gpu"}
    with load_text(sorted((ROOT / "labbook" / "data").glob("*.csv.gz"))) as store:
        held = {
            (sources.partition("-")[0], name)
            for sources, name in store.query(
                "SELECT sources, configuration FROM sample UNION SELECT sources, configuration FROM measure"
            )
        }
    listed = [(group.sources, name) for group in found.groups for name in group.configurations]
    assert listed and len(listed) == len(set(listed)) and set(listed) <= held
    assert {group.sources for group in found.groups} <= set(found.commits)
