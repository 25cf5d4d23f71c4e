"""Definition of a hard case: a scene, a law that it must satisfy, and the methods that it applies to."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from softlab.bench.experiments.accuracy.methods import FLUIDS, MATCHING, TETRAHEDRAL, XPBD
from softlab.bench.stress.laws import Law
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.scene.scene import Scene, load_scene

ANY = "any"
FORCES = tuple(INTEGRATORS)
SEIDEL = XPBD[:1]
POSITIONS = XPBD[:2]  # without averaged-jacobi, which has another material
BODIES = (MATCHING,)


@dataclass(frozen=True)
class HardCase:
    """One hard case.

    `name`: row and variant; `scene`: catalogue name, or a function that makes it; `changes`: fields replaced in it;
    `law`: runs a Trial and returns its checks, the decisive one first. `expect`: the correct verdict, `pass` or
    `refused`. `limited_step`: an integrator for which the scene's dt is too large runs at 0.9 of its limit; otherwise it is
    refused. `known`: (method, precision), either of them ANY -> reason of a failure there, which then is not a bug.
    `methods`: names of the methods it applies to; a position-based one has the iterations and substeps of `changes`, or
    of the scene. `basis`: origin of the decisive check's bound, in words; empty where the law itself gives it. `quick`:
    part of `--quick`.
    """

    name: str
    title: str
    scene: str | Callable[[], Scene]
    law: Law
    changes: Mapping[str, object] = field(default_factory=dict)
    expect: str = "pass"
    limited_step: bool = True
    known: Mapping[tuple[str, str], str] = field(default_factory=dict)
    methods: tuple[str, ...] = FORCES
    basis: str = ""
    quick: bool = True
    tetrahedral: bool = False

    @property
    def row(self) -> str:
        return self.name.split()[0]

    @property
    def of_bodies(self) -> bool:
        """True if the case is about soft and rigid bodies, not about a sheet."""
        return self.methods == BODIES

    @property
    def of_tetrahedra(self) -> bool:
        """True if the case is about tetrahedral bodies."""
        return self.tetrahedral or self.methods == TETRAHEDRAL

    @property
    def of_fluids(self) -> bool:
        """True if the case is about fluids."""
        return self.methods == FLUIDS

    def base(self) -> Scene:
        """Return the scene before `changes`."""
        return load_scene(self.scene) if isinstance(self.scene, str) else self.scene()

    def known_failure(self, method: str, precision: str) -> str | None:
        """Return the reason why the method inevitably fails this case; None if it must pass."""
        keys = ((method, precision), (method, ANY), (ANY, precision))
        return next((self.known[key] for key in keys if key in self.known), None)
