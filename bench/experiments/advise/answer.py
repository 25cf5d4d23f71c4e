"""Who answers `softlab advise`: a search that measures errors, the laws of tetrahedral bodies, which have no reference, or a
search for what keeps a fluid's density."""

from __future__ import annotations

from typing import Any

from bench.experiments.advise.advice import Advice
from bench.experiments.advise.check import brute_force
from bench.experiments.advise.experiment import TOTAL_SECONDS, advise
from bench.experiments.advise.fluids import advise_fluids
from bench.experiments.advise.fluids_advice import FluidAdvice
from bench.experiments.advise.tetrahedra import advise_tetrahedra
from bench.experiments.advise.tetrahedra_advice import TetrahedraAdvice
from bench.store.database import Store
from model.core.errors import SceneError
from model.scene.scene import Scene


def answer(
    store: Store,
    scene: Scene,
    error: float,
    *,
    time: float | None = None,
    total_seconds: float = TOTAL_SECONDS,
    check: bool = False,
    **how: Any,
) -> Advice | TetrahedraAdvice | FluidAdvice:
    """See `advise`, `advise_tetrahedra`, `advise_fluids`, which take `how`. Raises SceneError, too, for options of others."""
    if scene.fluids:
        if check:
            raise SceneError(
                "--check",
                True,
                "applies to grids and cloth; use softlab fluids --truth to judge every scheme of a fluid",
            )
        return advise_fluids(store, scene, error, time=time, total_seconds=total_seconds, **how)
    if not scene.tetrahedra:
        return advise(store, scene, error, time=time, total_seconds=total_seconds, **how)
    if time is not None:
        raise SceneError(
            "--time",
            time,
            "does not apply to tetrahedral bodies, which are judged at rest and after half a vibration; leave it out",
        )
    if check:
        raise SceneError(
            "--check",
            True,
            "applies to grids and cloth; use softlab tetrahedra to compare measured bars with the error laws",
        )
    return advise_tetrahedra(store, scene, error, **how)


def checked(store: Store, advice: Advice | TetrahedraAdvice | FluidAdvice, **how: Any) -> str:
    """What brute force says of an advice. See `brute_force`."""
    assert isinstance(advice, Advice)
    return str(brute_force(store, advice, progress=True, **how))
