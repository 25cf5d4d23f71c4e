"""Hard cases of fluids; bench/stress/fluids.py has their laws.

The scenes are made by code. All have gravity (possibly 0), a floor and a box, which are far away where they shall not
have contact, so that the scenes share machine code.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from softlab.bench.experiments.accuracy.methods import FLUIDS
from softlab.bench.stress import fluids, vessels
from softlab.bench.stress.case import ANY, HardCase
from softlab.model.core.simulation import PRECISIONS
from softlab.model.scene.scene import Scene

FRAME, SUBSTEPS, ITERATIONS = 1 / 60, 4, 4
D, SUPPORT = 0.05, 0.05 / 0.55  # m: rest distance, and support radius
STEP = SUPPORT / 2  # m: largest displacement of a particle per substep
FASTEST = STEP * SUBSTEPS / FRAME  # m/s: 10.9
THICK = 0.01  # m: of colliders
AWAY = -1000.0  # m
# reasons of known failures
OUTRUN = "nothing is faster than half a support a substep, 10.9 m/s here: the walls of a faster cup push its fluid on"
SLOWED = "nothing is faster than half a support a substep, 10.9 m/s here; 100 m/s needs 37 substeps"
NOTHING: Mapping[str, object] = {}


def scene(parts: Mapping[str, object], substeps: int = SUBSTEPS, gravity: bool = False) -> Scene:
    """Return a scene of these parts, with a floor and a box far away unless the parts have them."""
    far = {
        "floor": {"kind": "plane", "point": [0.0, AWAY, 0.0], "thickness": THICK},
        "box": {"kind": "box", "center": [0.0, AWAY, 0.0], "half_size": [0.5, 0.5, 0.5]},
    }
    method = {"solver": "pbf", "dt": FRAME, "substeps": substeps, "iterations": ITERATIONS}
    return Scene({**far, **parts, "gravity": {} if gravity else {"acceleration": 0.0}, "method": method})


def water(
    across: tuple[int, int, int],
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    more: Mapping[str, object] = NOTHING,
) -> dict[str, object]:
    """Return a block of fluid with that many particles along each side."""
    return {"kind": "fluid", "size": [D * n for n in across], "origin": list(origin), "rest_distance": D, **more}


def cup(speed: float) -> Scene:
    """Return water in a cup of six boxes, 0.1 m thick, that move along x."""
    (x, y, z), half = fluids.INSIDE, 0.05
    wide, high, deep = x / 2 + 2 * half, y / 2 + 2 * half, z / 2 + 2 * half
    places = {
        "bottom": ((x / 2, -half, z / 2), (wide, half, deep)),
        "lid": ((x / 2, y + half, z / 2), (wide, half, deep)),
        "left": ((-half, y / 2, z / 2), (half, high, deep)),
        "right": ((x + half, y / 2, z / 2), (half, high, deep)),
        "back": ((x / 2, y / 2, -half), (wide, high, half)),
        "front": ((x / 2, y / 2, z + half), (wide, high, half)),
    }
    walls: dict[str, object] = {
        name: {"kind": "box", "center": list(center), "half_size": list(sides), "velocity": [speed, 0.0, 0.0]}
        for name, (center, sides) in places.items()
    }
    far = {"kind": "box", "center": [0.0, AWAY, 0.0], "half_size": [0.5, 0.5, 0.5], "velocity": [speed, 0.0, 0.0]}
    return scene({"water": water((8, 5, 6)), "box": far, **walls}, gravity=True)


def lone() -> Scene:
    """Return one particle, 5 m above a floor."""
    return scene(
        {"drop": water((1, 1, 1), (0.0, 5.0, 0.0)), "floor": {"kind": "plane", "thickness": THICK}}, gravity=True
    )


def stacked() -> Scene:
    """Return the heavy fluid above the light one, both 0.2 m deep, in a tank."""
    metal, gas = (water((8, 4, 4), (0.0, low, 0.0), {"density": rho}) for low, rho in ((0.2, 1000.0), (0.0, 1.0)))
    sides = {
        "floor": ([0.0, 0.0, 0.0], [0.0, 1.0, 0.0]), "left": ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
        "right": ([0.4, 0.0, 0.0], [-1.0, 0.0, 0.0]), "back": ([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
        "front": ([0.0, 0.0, 0.2], [0.0, 0.0, -1.0]),
    }  # fmt: skip
    planes: dict[str, object] = {
        name: {"kind": "plane", "point": at, "normal": n, "thickness": 0.0} for name, (at, n) in sides.items()
    }
    return scene({"metal": metal, "gas": gas, **planes}, gravity=True)


def slab(substeps: int) -> Scene:
    """Return a slab at 100 m/s, 2 m above a floor."""
    flying = water((12, 4, 12), (0.0, 2.0, 0.0), {"velocity": [0.0, -100.0, 0.0]})
    return scene({"slab": flying, "floor": {"kind": "plane", "thickness": THICK}}, substeps)


def plate(half: float, moves: bool) -> Scene:
    """Return a block that flies at a plate, or a plate at a block, at 0.9 of the speed limit.

    The plate is so wide that no particle reaches its rim.
    """
    speed, wide = 0.9 * FASTEST, fluids.FREE * FASTEST
    velocity: dict[str, object] = {"velocity": [0.0, 0.0 if moves else -speed, 0.0]}
    box = {"kind": "box", "center": [0.0, -0.3, 0.0], "half_size": [wide, half, wide], "thickness": THICK,
           "velocity": [0.0, speed if moves else 0.0, 0.0]}  # fmt: skip
    return scene({"water": water((4, 4, 4), (-0.1, 0.1, -0.1), velocity), "box": box})


def drop(more: Mapping[str, object] = NOTHING) -> Scene:
    """Return a cube of 216 particles about the origin."""
    return scene({"water": water((6, 6, 6), (-0.15, -0.15, -0.15), more)})


def mixed() -> Scene:
    """Return two halves of a cube, one of which is ten times as heavy."""
    halves: dict[str, object] = {
        name: water((3, 6, 6), (low, -0.15, -0.15), {"density": rho})
        for name, low, rho in (("oil", -0.15, 100.0), ("water", 0.0, 1000.0))
    }
    return scene(halves)


def crowded() -> Scene:
    """Return three blocks at one position."""
    return scene({"water": water((5, 5, 5), more={"blocks": [{"origin": [0.0, 0.0, 0.0], "size": [5 * D] * 3}] * 2})})


def joined_vessels() -> Scene:
    """Return, in a plane, water 0.4 m high on the left of a wall that ends 0.1 m above the floor.

    The right side is empty.
    """
    d = 0.02
    block = {"kind": "fluid", "dimensions": 2, "size": [0.3, 0.4], "rest_distance": d, "viscosity": 2.0}
    ends = {"floor": ([0.0, 0.0, 0.0], [0.0, 1.0, 0.0]), "left": ([0.0] * 3, [1.0, 0.0, 0.0]),
            "right": ([0.64, 0.0, 0.0], [-1.0, 0.0, 0.0])}  # fmt: skip
    walls: dict[str, object] = {
        name: {"kind": "plane", "point": point, "normal": normal, "thickness": 0.0}
        for name, (point, normal) in ends.items()
    }
    walls["wall"] = {"kind": "box", "center": [0.32, 0.6, 0.0], "half_size": [0.02, 0.5, 0.5], "thickness": 0.0}
    method = {"solver": "pbf", "dt": FRAME, "substeps": 6, "iterations": ITERATIONS}
    return Scene({"water": block, "gravity": {}, **walls, "method": method})


def _always(reason: str) -> dict[tuple[str, str], str]:
    """Return a failure that any scheme has in any precision."""
    return {(ANY, precision): reason for precision in PRECISIONS}


FLUID_CASES = (
    HardCase("F1", "a fast cup", partial(cup, 5.0), fluids.stays_in_its_cup, methods=FLUIDS,
             basis="Galileo: water in a cup of constant speed comes to go with it"),
    HardCase("F1 outrun", "a cup faster than the limit", partial(cup, 20.0), fluids.stays_in_its_cup, methods=FLUIDS,
             known=_always(OUTRUN),
             basis="Galileo: water in a cup of constant speed comes to go with it"),
    HardCase("F2", "a lone particle", lone, fluids.falls_alone, methods=FLUIDS,
             basis="symplectic Euler in closed form, by rounding"),
    HardCase("F3", "two particles in one place", partial(scene, {"water": water((5, 5, 5))}), fluids.parts_from_its_double,
             methods=FLUIDS,
             basis="Newton's third law; half a rest distance"),
    HardCase("F3 alone", "the same, and nothing else", partial(scene, {"water": water((2, 1, 1))}), fluids.two_alone,
             methods=FLUIDS,
             basis="Newton's third law: their mean stays"),
    HardCase("F4", "density 1000 over 1", stacked, fluids.changes_places, methods=FLUIDS, quick=False,
             basis="Archimedes; section F: mean density within 1 %"),
    HardCase("F5", "a slab hits at 100 m/s", partial(slab, 40), fluids.hits_the_floor, methods=FLUIDS,
             basis="half a support a substep; a hit makes no energy"),
    HardCase("F5 slowed", "the same in 4 substeps", partial(slab, SUBSTEPS), fluids.hits_the_floor, methods=FLUIDS,
             known=_always(SLOWED),
             basis="half a support a substep; a hit makes no energy"),
    HardCase("F6", "a still drop", drop, fluids.keeps_still, methods=FLUIDS,
             basis="A12: the lattice that kernels are scaled by"),
    HardCase("F6 drawn", "a drop that is drawn together", partial(drop, {"cohesion": 0.5, "surface_tension": 0.3}),
             fluids.keeps_still, methods=FLUIDS, quick=False,
             basis="forces in pairs"),
    HardCase("F7", "momentum without walls", drop, fluids.keeps_momentum, methods=FLUIDS,
             basis="Newton's third law"),
    HardCase("F7 two", "the same, of two fluids", mixed, fluids.keeps_momentum, methods=FLUIDS, quick=False,
             basis="Newton's third law"),
    HardCase("F8", "a plate at the speed limit", partial(plate, STEP - THICK, False), fluids.stops_at_a_plate,
             methods=FLUIDS,
             basis="half a support a substep, the depth of half a plate"),
    HardCase("F8 moving", "a plate that moves so", partial(plate, STEP - THICK, True), fluids.stops_at_a_plate,
             methods=FLUIDS,
             basis="half a support a substep, the depth of half a plate"),
    HardCase("F8 thin", "a plate a centimetre thick", partial(plate, 0.005, False), fluids.stops_at_a_plate, methods=FLUIDS,
             basis="no way leads through a box"),
    HardCase("F8 sheet", "a plate a tenth of a millimetre thick that moves", partial(plate, 5e-5, True),
             fluids.stops_at_a_plate, methods=FLUIDS,
             basis="no way leads through a box"),
    HardCase("F9", "three blocks in one place", crowded, fluids.reports_lost_neighbours, methods=FLUIDS,
             basis="a count of every pair in NumPy"),
    HardCase("F10", "two vessels that communicate", joined_vessels, vessels.levels_out, methods=FLUIDS, quick=False,
             basis="Torricelli: one level, that of the volume, to half a layer"),
)  # fmt: skip
