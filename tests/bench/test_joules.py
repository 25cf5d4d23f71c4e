"""Energy that a processor takes: counters of GPU and CPU, joules beside the times of kernels."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from test_kernel_sweep import SMALL

from softlab.bench.experiments import kernel_runner, kernel_sweep
from softlab.bench.experiments.kernel_sweep import run_kernel_sweep
from softlab.bench.measure.energy import Energy, energy_counter, measure_energy, nvml_counter, rapl_counter
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures, timings

# ---------------------------------------------------------------------- joules


class FakeNvml:
    """An NVML whose counter rises by 7 J every third look: 300 W, say, and slow updates."""

    def __init__(self, count: int = 1):
        self.looks, self.count = 0, count

    def module(self) -> Any:
        def energy(handle: str) -> int:
            assert handle == "first"
            self.looks += 1
            return 7000 * (self.looks // 3)

        return SimpleNamespace(
            nvmlInit=lambda: None,
            nvmlDeviceGetCount=lambda: self.count,
            nvmlDeviceGetHandleByIndex=lambda index: "first" if index == 0 else "other",
            nvmlDeviceGetTotalEnergyConsumption=energy,
        )


def test_nvml_counts_millijoules_and_its_absence_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pynvml", FakeNvml().module())
    counter = nvml_counter()
    assert counter is not None
    assert [counter() for _ in range(4)] == [0.0, 7.0, 7.0, 7.0]  # looking once to see whether it works is one look
    broken = FakeNvml().module()
    broken.nvmlDeviceGetTotalEnergyConsumption = lambda handle: 1 / 0
    monkeypatch.setitem(sys.modules, "pynvml", broken)
    assert nvml_counter() is None
    monkeypatch.setitem(sys.modules, "pynvml", None)  # importing it raises
    assert nvml_counter() is None and energy_counter("gpu") is None


def test_rapl_adds_packages_and_survives_their_end(tmp_path: Path) -> None:
    assert rapl_counter(tmp_path / "none") is None and rapl_counter(tmp_path) is None
    for name in ("intel-rapl:0", "intel-rapl:1", "intel-rapl:0:0"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "energy_uj").write_text("900000\n")
        (tmp_path / name / "max_energy_range_uj").write_text("999999\n")
    counter = rapl_counter(tmp_path)
    assert counter is not None and counter() == 0.0
    (tmp_path / "intel-rapl:0" / "energy_uj").write_text("950000")
    (tmp_path / "intel-rapl:1" / "energy_uj").write_text("100000")  # went round
    assert counter() == pytest.approx(0.05 + 0.2)
    (tmp_path / "intel-rapl:0" / "max_energy_range_uj").unlink()
    assert rapl_counter(tmp_path) is None


class Metered:
    """A device of 1 ms a step and 300 W whose counter jumps every 0.1 s, and loses 20 ms to each look at it."""

    seconds_per_step, lost, clock, looks = 0.001, 0.02, 0.0, 0

    def restore(self) -> None:
        self.clock += 0.01

    def run(self, steps: int) -> float:
        self.clock += steps * self.seconds_per_step
        return steps * self.seconds_per_step

    def counter(self) -> float:
        self.looks += 1
        self.clock += self.lost
        return 300.0 * 0.1 * math.floor(10 * self.clock)


def test_joules_lie_between_two_jumps_and_the_counter_is_read_at_the_ends_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from softlab.bench.measure import energy

    device: Any = Metered()
    monkeypatch.setattr(energy, "time", SimpleNamespace(perf_counter=lambda: device.clock))
    found = measure_energy(device, device.counter)
    assert found is not None and device.looks < 12
    reach = energy.BATCH_SECONDS + device.lost  # of an end, which is seen so much later at most
    assert energy.LOOP_SECONDS < found.seconds < energy.LOOP_SECONDS + 0.1 + 2 * reach
    assert found.watts == pytest.approx(300, rel=2 * reach / found.seconds)
    assert found.joules == pytest.approx(found.watts * found.seconds)
    assert found.suspect(0.001, 700.0) is None, "looks at the ends take less than a tenth"
    assert "1.50 times as long" in str(Energy(30.0, 1.5, 1000).suspect(0.001, None))
    assert "W of a device" in str(Energy(800.0, 1.0, 1000).suspect(0.001, 700.0))
    assert measure_energy(device, lambda: 1.0) is None, "a counter that stands still tells nothing"
    device.seconds_per_step = 1.0
    assert measure_energy(device, device.counter) is None, "too slow for a second"


def test_joules_stand_beside_the_times_and_are_resumed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_sweep, "energy_counter", lambda backend: lambda: 0.0)
    monkeypatch.setattr(kernel_runner, "energy_counter", lambda backend: lambda: 0.0)
    answers = iter([Energy(30.0, 0.5, 1000), None])
    monkeypatch.setattr(kernel_runner, "measure_energy", lambda *_: next(answers))
    with Store(":memory:") as store:
        without = run_kernel_sweep(store, sizes=[8], **SMALL)
        assert without.measured == 4 and not timings(store, stage="energy")  # a busy machine takes samples twice
        options = SMALL | {"energy": True}
        run_kernel_sweep(store, sizes=[8], **options)
        (sample,) = timings(store, stage="energy")
        assert sample.kernel == "fused" and sample.joules_per_step == pytest.approx(0.03)
        (reason,) = measures(store, "energy_skipped")
        assert reason.description["kernel"] == "stages" and "too rarely" in (reason.reason or "")
        assert all(t.joules_per_step is None for t in timings(store))
        assert run_kernel_sweep(store, sizes=[8], **options).run == "", "both are settled"
