"""The lab book's sentences against numbers worked out by hand from the laws of the made-up measurements, at the size and in
the direction that they tell; wrong answers change none of them, and each condition is tried on both of its sides."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import pytest
from synthetic_store import (
    CPU_RECORD,
    GPU_RECORD,
    SIZES,
    WATTS,
    Maker,
    cpu_seconds,
    cpu_store,
    gpu_seconds,
    gpu_store,
    kernel_seconds,
)  # fmt: skip

from softlab.bench.store.database import Store
from softlab.bench.stress.results import HardRow
from softlab.labbook.build import CLAIMS
from softlab.labbook.claims import comparison as comparison_claims
from softlab.labbook.claims import hard as hard_claims
from softlab.labbook.claims.claim import Claim
from softlab.plots.core.data import Results, is_wrong
from softlab.plots.core.read import load

LARGEST = 4096 * 4096
WIDE = {"backend": "cpu", "layer": "omp", "wait_policy": "passive"}


@cache
def measured() -> Results:
    return load(gpu_store())


def told(name: str) -> Claim:
    return CLAIMS[name](measured())


def cpu(masses: int, threads: int = 16, precision: str = "float32") -> float:
    return cpu_seconds(GPU_RECORD, threads, masses, precision)


def gpu(masses: int, precision: str = "float32") -> float:
    return gpu_seconds(GPU_RECORD, masses, precision)


def rung(kernel: str, masses: int, backend: str = "gpu") -> float:
    return kernel_seconds(GPU_RECORD, backend, kernel, masses, "float32")


def picture(masses: int) -> float:
    return 2e-4 + 4e-9 * masses


BY_HAND: dict[str, dict[str, float]] = {  # claim -> numbers
    "threads-small": {"2x": cpu(256, 32) / cpu(256), "4x": cpu(256, 64) / cpu(256), "masses": 256},
    "threads-large": {"2x": cpu(LARGEST, 32) / cpu(LARGEST), "4x": cpu(LARGEST, 64) / cpu(LARGEST), "masses": LARGEST},
    # of one session, so that the largest size, where 4x threads are 11 % slower, does not count
    "threads-best": {"sizes": 10, "faster": 0, "slower": 9},
    "region-cost": {"few": 5e-6, "many": 2e-4},
    "cpu-bandwidth": {"share": 32 * LARGEST / cpu(LARGEST) / 2e11, "masses": LARGEST},
    "gpu-bandwidth": {"share": 32 * LARGEST / gpu(LARGEST) / 4e12, "masses": LARGEST},
    "cpu-float64": {"ratio": cpu(LARGEST, precision="float64") / cpu(LARGEST), "masses": LARGEST},
    "gpu-float64": {"ratio": gpu(LARGEST, "float64") / gpu(LARGEST), "masses": LARGEST},
    "gpu-flat": {"masses": 256**2, "factor": 256},  # 2 us + 8e-12 s a mass: by less than half of the start's 2 us
    "gpu-growth": {"masses": 4, "time": gpu(LARGEST) / gpu(LARGEST // 4)},
    "launch-cost": {"seconds": 9e-6},
    "overtakes": {"ratio": cpu(LARGEST) / gpu(LARGEST), "masses": LARGEST, "crossing": 0, "first": cpu(256) / gpu(256)},
    "drawing": {"cpu": 1 + picture(LARGEST) / cpu(LARGEST), "gpu": 1 + picture(LARGEST) / gpu(LARGEST)},
    "overtakes-drawing": {
        "ratio": (cpu(LARGEST) + picture(LARGEST)) / (gpu(LARGEST) + picture(LARGEST)), "masses": LARGEST, "cpu ahead": 0,
    },
    # 12 shapes, 2 precisions, 2 pictures, 4 ways
    "trust": {"timed": 192, "wrong": 0, "suspect": 0, "checked": 192, "left out": 0},
    "choice-gpu": {"good": 9, "sizes": 9},
    "energy": {
        "gpu least": 1e6 * WATTS * rung("tiles", LARGEST) / LARGEST,
        "gpu most": 1e6 * WATTS * rung("stages", LARGEST) / LARGEST,
    },
    "lab-newton": {"order": 0, "coarse": 0.3, "fine": 0.3},
    "lab-half": {"order": 1, "fine": 0.3 / 20 / 4},
    "orders": {"semi-implicit-euler": 1, "velocity-verlet": 2, "rk4": 4},
    "broken": {"diverged": 4 * 2 * 2},  # step sizes, precisions, backends
    "float32-floor": {"float32": 5e-5, "float64": 2e-5 / 4**4},
    "fastest": {"seconds": 2e-6 / 0.01, "error": 5e-4, "next": 4 * 2e-6 / 0.02},
    "equal-error": {"ratio": 10, "copied": (2e-5 / 0.01 + 2e-5 / 1.5) / (2e-6 / 0.01 + 2e-5 / 1.5)},  # copied once in 1.5 s
    "verlet-damping": {"implicit": 2, "explicit": 1, "ratio": 4},
    "far-away": {"lab": 1e-5 * (1 + 1e5 / 100), "velocity-verlet": 1e-7 * (1 + 1e5 / 100)},
    "exact-cost": {"cpu": 1.25, "gpu": 1.25},
    "growth": {"growth": 0.09},
}  # fmt: skip


@pytest.mark.parametrize("name", BY_HAND)
def test_numbers_are_those_worked_out_by_hand(name: str) -> None:
    assert dict(told(name).numbers) == pytest.approx(BY_HAND[name], rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "size"),
    [(name, numbers["masses"]) for name, numbers in BY_HAND.items() if numbers.get("masses", 0) > 4 and name != "gpu-flat"]
    + [("drawing", LARGEST), ("overtakes-drawing", LARGEST), ("energy", LARGEST)],
)  # fmt: skip
def test_the_size_that_is_told_is_in_the_sentence(name: str, size: int) -> None:
    assert f"{size}masses" in "".join(told(name).sentence.split())  # whatever the spaces


def test_coarse_and_fine_steps_are_told_apart() -> None:
    """The hand-out's errors are the same at all of them: which is which is in the words."""
    words = " ".join(told("lab-newton").sentence.split())
    assert "0.30 spacings at 20 ms and 0.30 at 2.5 ms" in words
    assert "0.0037 spacings at 2.5 ms" in " ".join(told("lab-half").sentence.split())


# ---------------------------------------------------------------------- wrong answers


def test_wrong_answers_change_no_sentence() -> None:
    """Every curve gets a size that is larger than all, and one that is smaller, done in no time but for a wrong answer."""
    store = gpu_store()
    maker = Maker(store, GPU_RECORD, "gpu000000000")
    with store.transaction():
        for n in (8, 8192):
            for precision in ("float32", "float64"):
                how = {"precision": precision, "error": float("inf")}
                for drawn in (False, True):
                    for threads in (16, 32, 64):
                        maker.timing((n, n), 1e-10, threads=threads, graphics=drawn, **WIDE, **how)
                    maker.timing((n, n), 1e-10, backend="gpu", graphics=drawn, **how)
                for kernel in ("fused", "tiled"):
                    maker.timing((n, n), 1e-10, threads=16, kernel=kernel, **WIDE, **how)
                for kernel in ("graph", "tiles"):
                    maker.timing((n, n), 1e-10, backend="gpu", kernel=kernel, **how)
    results = load(store)
    assert sum(is_wrong(timing) for timing in results.featured[0].timings) == 2 * 2 * 2 * 4
    for name, claim in CLAIMS.items():
        if name != "trust":  # which counts them
            assert claim(results).sentence == told(name).sentence, name


def test_the_shape_of_a_wrong_answer_takes_no_part() -> None:
    store = Store(":memory:")
    maker = Maker(store, CPU_RECORD, "c")
    maker.sweep((32, 64, 128), graphics=False)
    before = comparison_claims.shape(load(store))
    maker.timing((16, 256), 1e-10, threads=2, error=float("inf"), **WIDE)
    assert comparison_claims.shape(load(store)).sentence == before.sentence


# ---------------------------------------------------------------------- conditions, on both of their sides


def of_two(cpu_time: float, gpu_time: float, **how: Any) -> Any:
    """The results of a machine with one grid on either backend."""
    store = Store(":memory:")
    maker = Maker(store, GPU_RECORD, "g")
    maker.timing((64, 64), cpu_time, threads=16, **WIDE, **how)
    maker.timing((64, 64), gpu_time, backend="gpu", **how)
    return load(store)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        ((3e-5, 1e-5), "the smallest size, where it is 3.0\N{NO-BREAK SPACE}times as fast"),
        ((1e-5, 3e-5), "the GPU's step takes 3.0\N{NO-BREAK SPACE}times as long as the CPU's"),
        ((1e-5, 1.01e-5), "no difference beyond measurement noise"),
    ],
)
def test_which_backend_is_faster(seconds: tuple[float, float], words: str) -> None:
    assert words in comparison_claims.overtakes(of_two(*seconds)).sentence


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        ((3e-5, 1e-5), "the GPU's step is 3.0\N{NO-BREAK SPACE}times as fast as the CPU's"),
        ((1e-5, 3e-5), "the largest size that both ran, there 3.0\N{NO-BREAK SPACE}times as fast"),
        ((1e-5, 1.01e-5), "differ by no more than measurement noise"),
    ],
)
def test_which_backend_is_faster_with_graphics(seconds: tuple[float, float], words: str) -> None:
    assert words in comparison_claims.overtakes_drawing(of_two(*seconds, graphics=True)).sentence


def row(case: str, verdict: str, backend: str = "cpu", integrator: str = "lab") -> HardRow:
    return HardRow(case, integrator, backend, "float64", 0.01, verdict, "", ())


def test_a_failed_hard_case_is_called_a_bug() -> None:
    rows = [row("B4", "pass"), row("B5", "refused"), row("B6", "known"), row("B7", "fail"), row("B9", "fail")]
    made = hard_claims.count_verdicts(rows)
    assert not made.supported and "2 failed otherwise, which is a bug of this lab: “B7” and “B9”." in made.sentence
    assert "1 passed, 1 was refused with a diagnosis and 1 failed as its method implies" in made.sentence
    assert made.numbers == {"pass": 1, "refused": 1, "known": 1, "fail": 2, "runs": 5}
    good = hard_claims.count_verdicts(rows[:3])
    assert good.supported and good.sentence.endswith("none failed otherwise.")


def test_backends_that_disagree_are_called_a_bug() -> None:
    same = [row("B4", "pass"), row("B4", "pass", "gpu"), row("B5", "fail"), row("B5", "fail", "gpu")]
    made = hard_claims.compare_backends(same)
    assert made.supported and "same in all 2 combinations" in made.sentence
    made = hard_claims.compare_backends([*same, row("B6", "pass"), row("B6", "fail", "gpu")])
    assert not made.supported and made.numbers == {"different": 1, "pairs": 3, "alone": 0}
    where = "turned upward, disturbed, lab, float64: pass on the cpu, fail on the gpu."
    assert f"CPU and GPU differ in 1, a bug of this lab: {where}" in made.sentence
    made = hard_claims.compare_backends([*same, row("B6", "fail"), row("B7", "pass", "gpu")])
    assert made.numbers == {"different": 0, "pairs": 2, "alone": 2}
    assert "same in all 2 combinations" in made.sentence and made.sentence.endswith("2 more ran on one backend alone.")


def test_cost_and_speed_up_by_state_and_length() -> None:
    """4 % between motion and rest; 15 steps of 10 us against 1 ms and 15 steps of 1 us: 0.15 / 1.015; 15 000: 150 / 16."""
    results = load(gpu_store())
    made = CLAIMS["cost-steady"](results)
    assert made.supported and made.numbers == pytest.approx({"cpu": 0.04, "gpu": 0.04})
    made = CLAIMS["run-length"](results)
    assert made.numbers["32 15"] == pytest.approx(0.15 / 1.015) and made.numbers["32 15000"] == pytest.approx(150 / 16)
    assert "0.15 for 150" in made.sentence and "9.4 for 150" in made.sentence
    assert not CLAIMS["run-length"](load(cpu_store())).supported


# ---------------------------------------------------------------------- thin air


@pytest.mark.parametrize("name", sorted(set(CLAIMS) - {"cloth-limit"}))
def test_of_nothing_it_is_said_that_there_is_nothing(name: str) -> None:
    """No number, nothing supported, and in words: was not, were not, no."""
    made = CLAIMS[name](load(None))
    assert not made.supported and not made.numbers
    assert re.search(r"\bnot\b|\bNo\b|\bNothing\b", made.sentence) and made.sentence.endswith(".")
    assert not re.search(r"\d", re.sub(r"float(32|64)", "", made.sentence))


def test_all_that_was_measured_is_told_of() -> None:
    """Of the full synthetic machine, every claim but those about experiments it has not run has numbers."""
    elsewhere = (
        "looks-", "determinism-", "xpbd-", "hard-", "ablation-", "projection-", "discretisation", "throughput-", "bar-",
        "body-", "stability-precisions", "busy", "families", "rope", "tetrahedra-", "fluids-", "gpus-",
        "game-cloth", "renderer",
    )  # fmt: skip
    assert {name for name in CLAIMS if not told(name).numbers} == {n for n in CLAIMS if n.startswith(elsewhere)}
    assert len(SIZES) == 6  # what the laws above were worked out for
