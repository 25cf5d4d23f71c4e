"""What the rest of the lab needs to know of a solver family, in one entry (model/core/families.py lists them)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from model.core.clock import Clock
from model.core.plan import Plan
from model.domains.bodies import Apart
from model.domains.decomposition import Reach
from model.scene.scene import Scene


@dataclass(frozen=True)
class SolverFamily:
    """One way to step one structure of particles, on every backend.

    `accepts(scene)`: whether it is this one that solves the scene; of all families exactly one does.
    `knows`: the kinds of tables that a scene of it may have; others are refused, not ignored.
    `plan(scene, live)`: the stages of a step. `record(scene, real, poke, clock)`: the constants that kernels read.
    `limit(scene, frequency)` [s]: the largest stable step size; `frequency` [1/s]: what no vibration exceeds, where more is
    known of it than model/core/integrators.py's `frequency_bound`. `limited_by_net`: whether that limit hangs on the springs'
    largest frequency. `note(scene)`: a line on what the method does to a motion.
    `stored(scene, position, plastic)` [J]: the energy in springs or clusters, and of a cloth's springs by kind as well.
    `strain(scene, position, kind, plastic)`: (springs,) or (entries,), what read("strain") tells.
    `spring_count(scene)`: springs, or what takes their place.
    `solvers`, `passes`: where the class that a backend opens, and the function that tells `softlab plan` what the backend
    makes of a step, are found: `module:name`, as they lie above the model. `reference`: the module in bench/reference/ whose
    `simulate` judges it. `unknown`: why no converged reference of the motion is known, and what to ask instead; None: one is.
    `reach(scene)`: how far a step reads along the rows of its sheet, so that several can share it (model/domains); raises
    SceneError for a part that cannot be shared; None: no scene of the family can yet.
    `apart(scene)`: the bodies of a scene in which none acts on another, so that several share them body by body
    (model/domains/bodies.py); raises SceneError for what lets them; None: no scene of the family can yet.
    `halo(scene)` [m]: how far a substep reads, so that several share the scene by slabs of space (model/domains/slabs.py);
    raises SceneError for a part that cannot be shared; None: no scene of the family can yet.
    """

    name: str
    accepts: Callable[[Scene], bool]
    knows: frozenset[str]
    plan: Callable[[Scene, frozenset[str]], Plan]
    record: Callable[[Scene, Any, tuple[float, ...], Clock], np.ndarray]
    limit: Callable[[Scene, float | None], float]
    limited_by_net: bool
    note: Callable[[Scene], str]
    stored: Callable[[Scene, np.ndarray, np.ndarray | None], tuple[float, dict[str, float]]]
    strain: Callable[[Scene, np.ndarray, str, np.ndarray | None], np.ndarray]
    spring_count: Callable[[Scene], int]
    solvers: Mapping[str, str]
    passes: Mapping[str, str]
    reference: str
    unknown: str | None = None
    reach: Callable[[Scene], Reach] | None = None
    apart: Callable[[Scene], Apart] | None = None
    halo: Callable[[Scene], float] | None = None


ANY_SHEET = frozenset({"damping", "gravity", "external", "perturbation", "method"})  # kinds that go with every sheet


def named(place: str) -> Any:
    """What lies at `module:name`, imported now. Raises ImportError."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)
