"""CUDA kernels of all solvers, in plain Python: they diverge where the CPU's do, and refuse what they cannot run."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from kernel_scenes import DIVERGING, REFUSED, first_diverged
from tetrahedra_scenes import slab_scene

from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene


@pytest.mark.parametrize("name", DIVERGING)
def test_a_divergence_is_the_cpus(name: str) -> None:
    """Step, particle and cause."""
    make, kernels = DIVERGING[name]
    expected = first_diverged(make(), "cpu")
    for kernel in kernels:
        assert first_diverged(make(), "gpu", kernel) == expected, kernel


@pytest.mark.parametrize("make, kernel, words", [pytest.param(*case, id=f"{case[1]}-{case[2]}") for case in REFUSED])
def test_a_kernel_that_cannot_run_is_refused_with_the_reason(
    make: Callable[[], Scene], kernel: str | None, words: str
) -> None:
    with pytest.raises(SceneError, match=words):
        open_simulation(make(), "gpu", kernel=kernel)


@pytest.mark.parametrize("limits, words", [((1, 1 << 20), "at once"), ((64, 500), "shared memory")])
def test_a_body_too_large_for_the_chip_is_refused(
    limits: tuple[int, int], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("softlab.gpu_backend.tetrahedra.resident_launch.device_limits", lambda: limits)
    with pytest.raises(SceneError, match=words):
        open_simulation(slab_scene(), "gpu", kernel="resident:2")
