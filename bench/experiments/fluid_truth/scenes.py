"""Scenes with known results for fluids, each at several settings; laws.py has the results.

The schemes are those that a scene file can name, so that a new one is measured without a change here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import get_args

from softlab.bench.experiments.fluids import FRAME, pool
from softlab.model.base.table import Table
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.tables.method import SchemeName

COLUMN, TANK, DAM, VORTICES, DROP, TWO = "column", "tank", "dam", "vortices", "drop", "two fluids"
TENSION = "surface tension"
SCHEMES: tuple[str, ...] = get_args(SchemeName)
EFFORTS = ((2, 3), (4, 5), (8, 5), (8, 10))  # substeps per frame, iterations per substep
DAM_EFFORTS = ((1, 3), (2, 5), (4, 5))  # the same per step of DAM_STEP
DAM_STEP, WIDTH = 0.002, 0.05715  # s; m: a, of Martin and Moyce (n^2 = 2: twice as high)
ACROSS = (10, 20, 40)  # particles along a
DAM_VISCOSITY = 0.5  # Pa s
TANK_PARTICLES, TANK_VISCOSITY = 1000, 4.0  # Pa s: of the column by Froude's law, at a tenth of its height
SPACINGS = (0.04, 0.02, 0.01)  # m: spacings of the vortices in their box of 1 m
DROPS = (8, 12)  # particles along a cube that becomes a drop
COHESION = 5.0  # N/m
TENSIONS = {3: (8, 12, 16), 2: (16, 24, 32)}  # dimensions -> particles along a block that becomes a drop


@dataclass(frozen=True)
class Setting:
    """One scene of a `kind`; `beside`: peers run it too."""

    kind: str
    scene: Scene
    beside: bool = False


def settings(quick: bool = False, schemes: tuple[str, ...] = SCHEMES) -> Iterator[Setting]:
    """Yield all settings; `quick`: one effort of each scheme, at one spacing."""
    for scheme in schemes:
        for substeps, iterations in EFFORTS[1:2] if quick else EFFORTS:
            how = _how(scheme, substeps, iterations)
            yield Setting(COLUMN, load_scene("column").replace(how))
            yield Setting(TANK, tank().replace(how), (substeps, iterations) == EFFORTS[1])
        for across in ACROSS[:1] if quick else ACROSS:
            for substeps, iterations in DAM_EFFORTS[1:2] if quick else DAM_EFFORTS:
                scene = dam(across).replace(_how(scheme, substeps, iterations))
                yield Setting(DAM, scene, across == ACROSS[1] and (substeps, iterations) == DAM_EFFORTS[1])
        for spacing in SPACINGS[:1] if quick else SPACINGS:
            changes = {"water.viscosity": 0.0, "water.rest_distance": spacing, "method.scheme": scheme}
            yield Setting(VORTICES, load_scene("taylor-green").replace(changes))
        if not quick:
            for side in DROPS:
                yield Setting(DROP, drop(side).replace({"method.scheme": scheme}))
            for axes, sides in TENSIONS.items():
                for side in sides:
                    yield Setting(TENSION, tense_drop(side, axes).replace({"method.scheme": scheme}))
            yield Setting(TWO, load_scene("two-fluids").replace({"method.scheme": scheme}))


def _how(scheme: str, substeps: int, iterations: int) -> Table:
    return {"method.scheme": scheme, "method.substeps": substeps, "method.iterations": iterations}


def tank() -> Scene:
    """Return water at rest between four walls: the column without periodic sides."""
    return pool(TANK_PARTICLES).replace({"water.viscosity": TANK_VISCOSITY})


def dam(across: int) -> Scene:
    """Return Martin and Moyce's column in the plane, `across` particles wide, without a gate or an obstacle."""
    wall = {"kind": "plane", "thickness": 0.0}
    water = {"kind": "fluid", "dimensions": 2, "size": [WIDTH, 2 * WIDTH], "rest_distance": WIDTH / across}
    return Scene(
        {
            "water": water | {"viscosity": DAM_VISCOSITY}, "floor": wall, "left": wall | {"normal": [1.0, 0.0, 0.0]},
            "gravity": {}, "method": {"solver": "pbf", "dt": DAM_STEP},
        },
        f"a dam {across} particles wide",
    )  # fmt: skip


def drop(side: int, axes: int = 3, tension: float = 0.0) -> Scene:
    """Return a cube, or a square, of particles with cohesion, without weight."""
    distance = 0.05
    water = {
        "kind": "fluid", "dimensions": axes, "size": [side * distance] * axes, "rest_distance": distance, "viscosity": 20.0,
        "cohesion": COHESION, "surface_tension": tension,
    }  # fmt: skip
    method = {"solver": "pbf", "dt": FRAME, "substeps": 8, "iterations": 8}
    return Scene({"water": water, "method": method}, f"a drop of {side**axes} particles")


def tense_drop(side: int, axes: int) -> Scene:
    """Return the same drop with as much surface tension as cohesion."""
    return drop(side, axes, COHESION)
