"""Figures, tables and claims of the kernels: every expected number follows from a law in tests/tools/synthetic_store.py."""

from __future__ import annotations

from dataclasses import replace

import pytest
from synthetic_store import (
    CPU_RECORD,
    GPU_RECORD,
    KERNELS,
    WATTS,
    Maker,
    cpu_store,
    gpu_store,
    kernel_seconds,
)

from softlab.bench.store.database import Store
from softlab.labbook.claims import kernels as kernel_claims
from softlab.labbook.rungs import rung as ladder_rung
from softlab.labbook.rungs import rung_tables
from softlab.model.mass_spring.plan import mass_spring_plan
from softlab.model.scene.scene import load_scene
from softlab.plots.core.data import Results
from softlab.plots.core.ladder import defaults, fastest, in_order, machine_of, rung
from softlab.plots.core.read import load
from softlab.plots.core.style import settings
from softlab.plots.figures import joules, kernels, roofline


@pytest.fixture(scope="module")
def gpu() -> Results:
    return load(gpu_store())


@pytest.fixture(scope="module")
def cpu() -> Results:
    return load(cpu_store())


def ladder_of(record: dict, sizes: tuple[int, ...] = (32, 512), **options: bool) -> Results:
    store = Store(":memory:")
    Maker(store, record, "m").ladder(sizes, **options)
    return load(store)


def test_forced_kernels_are_apart_from_the_ordinary_timings(gpu: Results) -> None:
    source = gpu.featured[0]
    assert all(t.chosen for t in source.timings) and not any(t.chosen for t in source.kernels)
    assert set(source.ladder("gpu")) == set(KERNELS["gpu"])
    assert [name for name, _ in in_order(source.ladder("cpu"))] == ["stages", "fused", "tiled", "team"]
    assert set(source.ladder("cpu", word="4x")) == {"fused", "tiled", "team"}
    assert rung("something new").label == "something new"


def test_the_default_is_the_fastest_where_the_law_says_so(gpu: Results) -> None:
    source = gpu.featured[0]
    chosen = {t.particles: t.kernel for t in defaults(source, "gpu")}
    assert chosen == {t.particles: t.kernel for t in fastest(source, "gpu")}
    assert chosen[16 * 16] == "one-block" and chosen[64 * 64] == "resident" and chosen[4096 * 4096] == "tiles"


def test_a_bandwidth_that_was_measured_beside_other_programs_is_told(gpu: Results) -> None:
    def captions(results: Results) -> list[str]:
        with settings():
            drawn = [figure.draw(results) for figure in (kernels, roofline)]
        return [one if isinstance(one, str) else one.caption for one in drawn]

    assert not any("beside other programs" in caption for caption in captions(gpu))
    beside = {"limits_suspect": "load: other programs ran"}
    doubted = (replace(s, machine=replace(s.machine, record=s.machine.record | beside)) for s in gpu.sources)
    assert all("beside other programs" in caption for caption in captions(Results(tuple(doubted))))


def test_the_figure_of_the_kernels_marks_switches_and_the_roof(gpu: Results) -> None:
    with settings():
        drawing = kernels.draw(gpu)
    assert not isinstance(drawing, str)
    on_cpu, on_gpu = drawing.figure.axes
    assert "CPU" in on_cpu.get_title() and "GPU" in on_gpu.get_title()
    assert {text.get_text() for text in on_gpu.texts} == {"one-block", "resident", "tiles"}
    (roof,) = [line for line in on_gpu.lines if line.get_label() == "one step per pass"]
    masses, seconds = (values[-1] for values in roof.get_data())
    assert seconds == pytest.approx(32 * masses / GPU_RECORD["gpu_copy_bandwidth"])
    assert "Dotted lines" in drawing.caption


def test_shares_of_the_ceilings(gpu: Results) -> None:
    """tiles runs at 1.7 of the copy bandwidth after 2 us a step; operations are the plan's."""
    source = gpu.featured[0]
    found = roofline.ceilings(source, "gpu")
    assert found is not None and found.bytes == 32
    assert found.operations == mass_spring_plan(load_scene("lab-grid")).operations
    largest = source.ladder("gpu")["tiles"][-1]
    seconds = kernel_seconds(GPU_RECORD, "gpu", "tiles", largest.particles, "float32")
    assert found.fraction(largest) == pytest.approx(32 * largest.particles / 4e12 / seconds)
    assert found.fraction(largest) > 1, "several steps per pass"
    assert found.arithmetic_fraction == pytest.approx(32 / 4e12 / (found.operations / 6e13))
    double = roofline.ceilings(source, "gpu", "float64")
    assert double is not None and double.bytes == 64 and double.rate == 3e13


def test_a_machine_without_an_arithmetic_rate_has_one_roof() -> None:
    results = ladder_of(CPU_RECORD | {"arithmetic": None}, (32, 512, 2048))
    with settings():
        drawing = roofline.draw(results)
    assert not isinstance(drawing, str) and "not measured" in drawing.caption
    made = kernel_claims.roof(results, "cpu")
    assert made.supported and "arithmetic" not in made.numbers
    assert made.numbers["masses"] == 2048**2, (
        "what stays in the last cache, of 32 MiB, is no share of the memory's bandwidth"
    )
    small = kernel_claims.roof(ladder_of(CPU_RECORD, (32, 512)), "cpu")
    assert not small.supported and "beyond the caches was not measured" in small.sentence


def test_joules_are_power_times_time(gpu: Results, cpu: Results) -> None:
    source = gpu.featured[0]
    timing = source.ladder("gpu")["graph"][0]
    assert joules.joules(source, timing) == pytest.approx(1e6 * WATTS * timing.median / timing.particles, rel=0.01)
    assert joules.watts(source, timing) == pytest.approx(WATTS)
    with settings():
        assert not isinstance(joules.draw(gpu), str)
        assert isinstance(joules.draw(cpu), str), "that machine counts none"
    made = kernel_claims.energy(gpu)
    assert made.supported and "tiles" in made.sentence and made.numbers["gpu least"] < made.numbers["gpu most"]


def test_rungs_are_held_against_the_one_below(gpu: Results) -> None:
    made = ladder_rung(gpu, "graph")
    ratio = kernel_seconds(GPU_RECORD, "gpu", "launch", 256, "float32") / kernel_seconds(
        GPU_RECORD, "gpu", "graph", 256, "float32"
    )
    assert made is not None and made.best is not None and made.best.particles == 256
    assert made.gain == pytest.approx(ratio)
    tiles, largest = ladder_rung(gpu, "tiles"), max(t.particles for t in gpu.sources[0].ladder("gpu")["tiles"])
    ratio = kernel_seconds(GPU_RECORD, "gpu", "graph", largest, "float32") / kernel_seconds(
        GPU_RECORD, "gpu", "tiles", largest, "float32"
    )
    assert tiles is not None and tiles.best is not None and tiles.best.particles == largest
    assert tiles.gain == pytest.approx(ratio)
    (table,) = rung_tables(gpu)
    rows = {row[0]: row for row in table["rows"]}
    assert rows["graph (GPU)"][1:3] == ["launch", "256"] and rows["graph (GPU)"][-3] == "none of 9"
    assert rows["one-block (GPU)"][-3:] == ["2 of 9", "256", "1024"]
    assert kernel_claims.choice(gpu, "gpu").numbers == {"good": 9, "sizes": 9}


def test_a_rung_that_gains_nothing_is_not_praised() -> None:
    store = Store(":memory:")
    maker = Maker(store, CPU_RECORD, "c")
    for kernel, seconds in (("fused", 1e-5), ("team", 2e-5), ("tiled", 1.01e-5)):
        made = maker.timing(
            (16, 16), seconds, backend="cpu", kernel=kernel, threads=2, layer="omp", wait_policy="passive"
        )
        store.add_measure(maker.run, made, "sources", "default", float(kernel == "team"), "", "made up")
    results = load(store)
    for kernel in ("team", "tiled"):
        made = ladder_rung(results, kernel)
        assert made is not None and made.gain is None
    (table,) = rung_tables(results)
    assert [row[-4:-2] for row in table["rows"]] == [["not faster", "none of 1"]] * 2
    poor = kernel_claims.choice(results, "cpu")
    assert poor.numbers["good"] == 0 and poor.numbers["worst"] == pytest.approx(2)
    assert "2.0 times as long as fused" in poor.sentence.replace("\N{NO-BREAK SPACE}", " ")


def test_what_more_threads_than_cores_cost(cpu: Results) -> None:
    source = cpu.featured[0]
    fused, team = (source.ladder("cpu", word="4x")[name][0] for name in ("fused", "team"))
    alone = source.ladder("cpu")["fused"][0]
    assert kernel_claims.crowded(cpu, "fused").numbers["ratio"] == pytest.approx(fused.median / alone.median)
    assert kernel_claims.crowded(cpu, "team", "fused").numbers["ratio"] == pytest.approx(team.median / fused.median)
    policies = kernel_claims.policies(cpu)
    assert "Spinning is faster as long as each thread has a core" in policies.sentence


def test_the_first_step(gpu: Results) -> None:
    made = kernel_claims.CLAIMS["starts"](gpu)
    assert made.numbers == {"cpu cold": 4.3, "cpu warm": 1.1, "gpu cold": 4.3, "gpu warm": 1.1}


def test_a_backend_is_shown_by_the_users_own_machine_first(gpu: Results, cpu: Results) -> None:
    committed = replace(gpu.sources[0], by_user=False)
    both = Results((*cpu.sources, committed))
    on_cpu, on_gpu = machine_of(both, "cpu"), machine_of(both, "gpu")
    assert on_cpu is cpu.sources[0] and on_gpu is committed
    with settings():
        drawing = kernels.draw(both)
    assert not isinstance(drawing, str) and drawing.figure.axes[1].get_title().endswith("(committed)")
    (table,) = rung_tables(both)
    assert f"GPU: {committed.gpu} (committed)" in table["title"]
