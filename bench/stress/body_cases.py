"""Hard cases of bodies: rows A8, A10, B16 to B18 and B20 of the lab's collection, and its scene S7, by shape matching.

The laws are in bench/stress/bodies.py, piles.py and rotations.py. The scenes are made by code and not read from files,
because a deformed or mirrored start, or clusters by hand, have no field in a scene.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from softlab.bench.experiments.body_laws import FLIGHT, SPIN, law_scene
from softlab.bench.experiments.body_scenes import (
    BRICK,
    SOFT,
    ball_in_a_body,
    heap,
    inside_each_other,
    load,
    meeting,
    shot,
    stack,
    thrown_at_a_box,
    thrown_at_a_plane,
)
from softlab.bench.stress import bodies
from softlab.bench.stress.case import BODIES, HardCase
from softlab.bench.stress.piles import bears, heaps_up, lies_still, stands
from softlab.bench.stress.rotations import finds_rotations, goals_are_exact

SHAPES = {  # name -> key of CHANGED, title
    "A10 plane": ("into its own plane", "a jelly squashed flat"),
    "A10 line": ("onto a line across", "squashed onto a line"),
    "A10 point": ("into a point", "squashed into a point"),
    "A10 mirrored": ("mirrored", "mirrored"),
    "A10 inside out": ("inside out", "turned inside out"),
}
HEAVY = BRICK | {"density": 1e5}
ASIDE, DEEP = (0.0, 0.2, 0.0), (0.02, 0.1, 0.03)  # m

OF_THE_TURN = "N substeps of a turn that lags by 8 eps, over the first turn"
OF_A_STEP = "roundings of places over h in each substep"
OF_SHAPES = "another shape, twisted or inside out, is half a spacing off"
OF_A_PUSH = "a rounding of the place that a particle is put to"
OF_PARTING = "a mass on a spring whose end moves at v goes at 2 v at most"


def _case(name: str, title: str, scene: Any, law: Any, basis: str) -> HardCase:
    return HardCase(name, title, scene, law, methods=BODIES, basis=basis)


BODY_CASES = (
    *(
        _case(f"S7 {substeps}", f"spin, {substeps} substep{'s' * (substeps > 1)} a frame",
              partial(law_scene, SPIN, substeps), bodies.spins, OF_THE_TURN)
        for substeps in (1, 4, 16)
    ),
    _case("A8 flight", "thrown and spinning", partial(law_scene, FLIGHT, 4), bodies.flies, OF_A_STEP),
    *(
        _case(name, title, partial(meeting, body=SOFT), bodies.finds_its_shape(how), OF_SHAPES)
        for name, (how, title) in SHAPES.items()
    ),
    _case("A10 rigid", "all of it done to a rigid body", partial(meeting, body=BRICK), bodies.is_whole_at_once,
          "goals of half a metre, some 60 operations"),
    _case("B16 jelly", "a jelly shot at a plane at 100 m/s", partial(thrown_at_a_plane, SOFT), bodies.is_stopped_by_a_plane,
          OF_A_PUSH),
    _case("B16 brick", "a rigid brick", partial(thrown_at_a_plane, BRICK), bodies.is_stopped_by_a_plane, OF_A_PUSH),
    _case("B16 box", "at a box", thrown_at_a_box, bodies.is_stopped_by_a_box, OF_A_PUSH),
    _case("B16 body", "at a body", partial(shot, 0.125, BRICK, 25.0, 0.03), bodies.is_stopped_by_a_body,
          "a layer of the other's particles"),
    _case("B17 jellies", "two jellies in each other", partial(inside_each_other, SOFT, SOFT, ASIDE), bodies.parts,
          OF_PARTING),
    _case("B17 bricks", "two rigid bricks", partial(inside_each_other, BRICK, BRICK, ASIDE), bodies.parts, OF_PARTING),
    _case("B17 deep", "deep in each other", partial(inside_each_other, SOFT, SOFT, DEEP),
          bodies.is_let_go_slowly, OF_PARTING),
    _case("B17 heavy", "one a hundred times as heavy", partial(inside_each_other, BRICK, HEAVY, DEEP),
          bodies.is_let_go_slowly, OF_PARTING),
    _case("B17 ball", "a ball in a jelly", ball_in_a_body, bodies.is_pushed_out_in_place,
          "what the ways out bend the clusters by, w² m d² / 2 each"),
    _case("B18 stack", "ten bricks, 10 s", partial(stack, 4), stands,
          "the weight above over what a projection moves"),
    _case("B18 load", "a brick on one of a hundredth", partial(load, 100.0, 16), bears,
          "the weight above over what a projection moves"),
    _case("B18 drop", "a jelly dropped, 10 s", partial(heap, 1, 4), lies_still, "the energy of the drop"),
    _case("B18 heap", "eight jellies in a heap, 10 s", partial(heap, 8, 4), heaps_up, "the row's own"),
    _case("B20", "the worst matrices", partial(meeting, body=BRICK), finds_rotations(),
          "what counts as reached, in units of rounding"),
    _case("B20 flat", "flat, straight, paired and single clusters", partial(meeting, body=BRICK), goals_are_exact(),
          "the row's own"),
)  # fmt: skip
