"""Which timings may be set side by side: those of one version of the code, and no others."""

from __future__ import annotations

import pytest
from synthetic_store import CPU_RECORD, GPU_RECORD, Maker, cpu_seconds, gpu_seconds

from softlab.bench.store import versions
from softlab.bench.store.database import Store
from softlab.bench.store.results import Timing, timings
from softlab.bench.store.versions import COMMIT, Version, code_version, digest_of, of_one_version, read_version
from softlab.labbook.build import notices
from softlab.labbook.claims import claim as claims
from softlab.labbook.claims import comparison
from softlab.plots.core.read import load
from softlab.plots.figures import crossover

WIDE = {"backend": "cpu", "threads": 16, "layer": "omp", "wait_policy": "passive"}


def measured(*runs: tuple[str | None, str, str, tuple[int, ...]]) -> Store:
    """A machine's runs, each (what it says of the code, digest, backend, sizes)."""
    store = Store(":memory:")
    maker = Maker(store, GPU_RECORD, "m")
    for version, digest, backend, sizes in runs:
        maker.run = store.start_run("m", "softlab sweep", version)
        maker.sources = f"{digest}-7"
        for n in sizes:
            seconds = (
                gpu_seconds(GPU_RECORD, n * n, "float32")
                if backend == "gpu"
                else cpu_seconds(GPU_RECORD, 16, n * n, "float32")
            )
            maker.timing((n, n), seconds, **(WIDE if backend == "cpu" else {"backend": "gpu"}))
    return store


def kept(store: Store) -> set[tuple[str, str]]:
    return {(t.backend, t.sources) for t in load(store).featured[0].timings}


def test_a_run_says_what_it_is_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(COMMIT, "0123456789ab")
    told = read_version(code_version())
    assert told == Version("0123456789ab", digest_of("cpu"), digest_of("gpu"))
    assert str(told) == "commit 0123456789ab"
    monkeypatch.setattr(versions, "ROOT", versions.ROOT / "tests")
    monkeypatch.delenv(COMMIT)
    assert read_version(code_version()).commit is None, "a copy without a history"
    assert str(read_version(f"- cpu:{'a' * 16} gpu:{'b' * 16}")) == "sources aaaaaaaa and bbbbbbbb"
    assert str(read_version(None)) == "commit unknown" and str(read_version("abc")) == "commit abc"


def test_one_run_or_runs_of_the_same_sources_are_compared() -> None:
    both = "c1 cpu:x gpu:y"
    store = measured((both, "x", "cpu", (16, 64)), (both, "y", "gpu", (16, 64)))
    assert kept(store) == {("cpu", "x-7"), ("gpu", "y-7")}
    claim = comparison.overtakes(load(store))
    assert claim.supported and claim.numbers["masses"] == 64 * 64
    # the GPU's sources changed, the CPU's did not: the newer run names them side by side
    later = measured(
        (both, "x", "cpu", (16, 64)), (both, "y", "gpu", (16, 64)), ("c2 cpu:x gpu:z", "z", "gpu", (16, 64, 128))
    )
    assert kept(later) == {("cpu", "x-7"), ("gpu", "z-7")}


def test_two_generations_of_code_are_not_compared() -> None:
    """The CPU's times are of sources that lay beside other ones of the GPU: no sentence, no line."""
    store = measured(("c1 cpu:x gpu:y", "x", "cpu", (16, 64)), ("c2 cpu:w gpu:z", "z", "gpu", (16, 64)))
    results = load(store)
    assert kept(store) == {("gpu", "z-7")} and results.featured[0].left_out == 2
    assert not comparison.overtakes(results).supported
    assert "one version of the code" in comparison.overtakes(results).sentence
    assert isinstance(crossover.draw(results), str)
    assert "2 times" in notices(results)[-1] and "another version of the code" in notices(results)[-1]
    assert "2 more are of another version" in comparison.trust(results).sentence


def test_labs_that_did_not_tell_are_not_compared_across_backends() -> None:
    store = measured((None, "x", "cpu", (16, 64)), (None, "y", "gpu", (16, 64, 128)))
    assert kept(store) == {("gpu", "y-7")}


def test_of_one_backend_the_version_with_most_timings_stays() -> None:
    first, second = "c1 cpu:x gpu:y", "c2 cpu:w gpu:y"
    store = measured((first, "x", "cpu", (16, 32, 64)), (second, "w", "cpu", (128,)))
    assert kept(store) == {("cpu", "x-7")}
    store = measured((first, "x", "cpu", (16, 32)), (second, "w", "cpu", (64, 128)))
    assert kept(store) == {("cpu", "w-7")}, "of equally many those measured last"


def test_of_the_readers_own_those_of_the_code_that_runs_now_stay() -> None:
    store = measured(("c1 cpu:x gpu:y", "x", "cpu", (16, 32, 64)), ("c2 cpu:n gpu:m", digest_of("cpu"), "cpu", (128,)))
    assert {t.rows for t in load(store).featured[0].timings} == {128}
    everything: list[Timing] = timings(store)
    assert len(of_one_version(everything, [], here=False)) == 3


def test_a_stalled_sample_is_no_speed_up() -> None:
    """What is marked as suspect is set beside nothing while there is anything else, and else with the word."""
    store = Store(":memory:")
    maker = Maker(store, CPU_RECORD, "c")
    host = WIDE | {"threads": 2}
    for n, seconds, suspect in ((16, 5e-3, "load: busy"), (64, 2e-5, None)):
        maker.timing((n, n), 1e-5, **host, precision="float32")
        maker.timing((n, n), seconds, **host, precision="float64", suspect=suspect)
    made = claims.CLAIMS["cpu-float64"](load(store))
    assert made.numbers == {"ratio": pytest.approx(2), "masses": 64 * 64} and "suspect" not in made.sentence
    assert "Made-up CPU" in made.sentence
    only = Store(":memory:")
    maker = Maker(only, CPU_RECORD, "c")
    for precision, seconds in (("float32", 1e-5), ("float64", 5e-3)):
        maker.timing((16, 16), seconds, **host, precision=precision, suspect="load: busy")
    assert "marked as suspect" in claims.CLAIMS["cpu-float64"](load(only)).sentence
