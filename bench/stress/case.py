"""What a hard case is: a scene, a law that it must keep, and the methods that it is for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from bench.experiments.accuracy.methods import FLUIDS, MATCHING, TETRAHEDRAL, XPBD
from bench.stress.laws import Law
from model.core.integrators import INTEGRATORS
from model.scene.scene import Scene, load_scene

ANY = "any"
FORCES = tuple(INTEGRATORS)
SEIDEL = XPBD[:1]
POSITIONS = XPBD[:2]  # averaged-jacobi is another material's
BODIES = (MATCHING,)


@dataclass(frozen=True)
class HardCase:
    """`name`: row and variant; `scene`: catalogue name, or what makes it; `changes`: fields replaced in it; `law`: runs a
    Trial and returns its checks, the telling one first. `expect`: the verdict that is right, `pass` or `refused`. `own_step`:
    an integrator that the scene's dt is too large for runs at 0.9 of its limit instead; else it is refused. `known`: (method,
    precision), either of them ANY -> why it fails there, which then is no bug. `methods`: those it is for, by name; a
    position-based one has the iterations and substeps of `changes`, or of the scene. `basis`: where the telling check's bound
    comes from, in words; empty where the law alone says it. `quick`: whether it is among the few of `--quick`."""

    name: str
    title: str
    scene: str | Callable[[], Scene]
    law: Law
    changes: Mapping[str, Any] = field(default_factory=dict)
    expect: str = "pass"
    own_step: bool = True
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
        """Whether it is about soft and rigid bodies, not about a sheet."""
        return self.methods == BODIES

    @property
    def of_tetrahedra(self) -> bool:
        """Whether it is about tetrahedral bodies."""
        return self.tetrahedral or self.methods == TETRAHEDRAL

    @property
    def of_fluids(self) -> bool:
        """Whether it is about fluids."""
        return self.methods == FLUIDS

    def base(self) -> Scene:
        """The scene before `changes`."""
        return load_scene(self.scene) if isinstance(self.scene, str) else self.scene()

    def known_failure(self, method: str, precision: str) -> str | None:
        """Why this case fails there by nature of the method; None where it must hold."""
        keys = ((method, precision), (method, ANY), (ANY, precision))
        return next((self.known[key] for key in keys if key in self.known), None)
