"""Choice of the search behind `softlab advise`.

Errors of grids and cloths are measured, tetrahedral bodies have no reference and use error laws, and fluids are
searched for the settings that keep their density.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from softlab.bench.experiments.advise.advice import Advice
from softlab.bench.experiments.advise.experiment import TOTAL_SECONDS, advise
from softlab.bench.experiments.advise.fluids import advise_fluids
from softlab.bench.experiments.advise.fluids_advice import FluidAdvice
from softlab.bench.experiments.advise.tetrahedra import advise_tetrahedra
from softlab.bench.experiments.advise.tetrahedra_advice import TetrahedraAdvice
from softlab.bench.store.database import Store
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene


def measure_advice(
    store: Store,
    scene: Scene,
    error: float,
    *,
    time: float | None = None,
    total_seconds: float = TOTAL_SECONDS,
    how: Mapping[str, Any],
) -> Advice | TetrahedraAdvice | FluidAdvice:
    """Return the advice of `advise`, `advise_tetrahedra` or `advise_fluids`, which take `how`.

    Raises SceneError for options that do not apply to the kind of scene.
    """
    if scene.fluids:
        return advise_fluids(store, scene, error, time=time, total_seconds=total_seconds, **how)
    if not scene.tetrahedra:
        return advise(store, scene, error, time=time, total_seconds=total_seconds, **how)
    if time is not None:
        raise SceneError(
            "--time",
            time,
            "does not apply to tetrahedral bodies, which are judged at rest and after half a vibration; leave it out",
        )
    return advise_tetrahedra(store, scene, error, **how)
