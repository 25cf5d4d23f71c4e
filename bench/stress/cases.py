"""The hard cases: rows B1 to B24 of the lab's collection and F1 to F10, as scenes with a law that each must satisfy.

Cases of the mass-spring grid and cloth have a scene in the catalogue under `hard/` and a law in laws.py, numbers.py,
stiff.py, cloth.py or xpbd.py here. Cases of bodies are in body_cases.py, of tetrahedra in tetrahedral_cases.py, of
fluids in fluid_cases.py. docs/method/cases.md names the rows.
"""

from __future__ import annotations

from softlab.bench.stress import laws, numbers
from softlab.bench.stress.body_cases import BODY_CASES
from softlab.bench.stress.case import ANY, FORCES, POSITIONS, SEIDEL, HardCase
from softlab.bench.stress.cloth import ball_inside, comes_to_rest_in_layers, fast_ball
from softlab.bench.stress.fluid_cases import FLUID_CASES
from softlab.bench.stress.stiff import stiff_chain_hangs, too_stiff
from softlab.bench.stress.tetrahedral_cases import TETRAHEDRAL_CASES
from softlab.bench.stress.xpbd import bounded, heavy_end, one_iteration, small_steps_rope, tethered_chain

LAB_FAR = "the hand-out's velocity is the difference of two rounded positions over dt: an ulp becomes ulp / dt"
FAR_KNOWN = {("lab", ANY): LAB_FAR}
# Visible as a vibration whose accelerations stay at an ulp / dt^2: the half still acts on larger ones.
REST_KNOWN = {
    (
        "taylor",
        "float32",
    ): "float32 rounds a dt^2 / 2, under half an ulp of the position, away; what is left is explicit "
    "Euler, over its own limit"
}
STANDS = {
    ("lab", "float32"): "float32 rounds a dt^2 / 2, under half an ulp of the position, away: nothing moves at all"
}

FAR = (1e3, 1e4, 1e5)  # m
CASES = (
    HardCase("B1", "stiffness ratio 1e6", "hard/b1", too_stiff, expect="refused", limited_step=False),
    HardCase("B1 hanging", "the same, under its limit", "hard/b1", stiff_chain_hangs, known=STANDS),
    HardCase("B1 implicit", "the same, by constraints", "hard/b1", stiff_chain_hangs, {"method.iterations": 20},
             methods=POSITIONS),
    HardCase("B2", "mass ratio 1:1000", "hard/b2", heavy_end, methods=POSITIONS),
    HardCase("B3", "mass ratio 1:1e5", "hard/b3", small_steps_rope, methods=POSITIONS),
    HardCase("B4", "two masses in one place", "hard/b4", laws.coincident, methods=FORCES + POSITIONS),
    HardCase("B4 zero", "the same, no rest length", "hard/b4", laws.coincident, {"springs.rest_length": 0.0},
             methods=FORCES + POSITIONS),
    HardCase("B5 line", "collapsed to a line", "hard/b5", laws.folded_line),
    HardCase("B5 disturbed", "the same, disturbed", "hard/b5", laws.comes_to_rest(laws.to_a_disturbed_line),
             known=REST_KNOWN),
    HardCase("B5 point", "collapsed to a point", "hard/b5", laws.comes_to_rest(laws.to_a_point), known=REST_KNOWN),
    HardCase("B6", "turned upward, disturbed", "hard/b6", laws.flipped, known=REST_KNOWN),
    HardCase("B7 mirrored", "mirrored in x", "hard/b7", laws.comes_to_rest(laws.mirrored), known=REST_KNOWN),
    HardCase("B7 random", "scattered in a box", "hard/b7", laws.comes_to_rest(laws.scattered), known=REST_KNOWN),
    HardCase("B8", "ten times the step size", "hard/b8", laws.ten_times_too_large, expect="refused", limited_step=False),
    HardCase("B8 implicit", "the same, by constraints", "hard/b8", bounded, {"method.iterations": 60},
             methods=POSITIONS),
    HardCase("B9 below", "0.99 of the limit", "hard/b9", laws.beside_the_limit(0.99)),
    HardCase("B9 above", "1.01 of the limit", "hard/b9", laws.beside_the_limit(1.01)),
    HardCase("B10 100", "poke of 100 m/s", "hard/b10", laws.violent(speed=100.0), known=REST_KNOWN),
    HardCase("B10 1000", "poke of 1000 m/s", "hard/b10", laws.violent(speed=1000.0), known=REST_KNOWN),
    HardCase("B10 drag", "corner let go 707 m away", "hard/b10", laws.violent(drag=500.0), known=REST_KNOWN),
    HardCase("B11", "gravity toggled each step", "hard/b11", laws.toggled, limited_step=False),
    HardCase("B12", "hung by one corner", "hard/b12", laws.one_pin),
    HardCase("B13", "chain of 4096 links", "hard/b13", numbers.long_chain, known={("lab", "float32"): LAB_FAR}),
    HardCase("B13 inextensible", "the same without give, tethered", "hard/b13", tethered_chain,
             {"springs.compliance": 0.0, "attachments.anchors": 1}, methods=POSITIONS),
    *(
        HardCase(f"B14 {offset:.0e}".replace("e+0", "e"), f"chain {offset:g} m away", "hard/b14",
                 numbers.far_away(offset, False), limited_step=False, known=FAR_KNOWN)
        for offset in FAR
    ),
    HardCase("B14 swinging", "the same, swinging", "hard/b14", numbers.far_away(1e5, True), limited_step=False,
             known=FAR_KNOWN),
    HardCase("B15", "denormal numbers", "hard/b15", numbers.denormals),
    HardCase("B16", "a fast ball through a cloth", "hard/b16", fast_ball, limited_step=False),
    HardCase("B17", "a ball inside a cloth", "hard/b17", ball_inside, limited_step=False),
    HardCase("B18", "eight layers fall on a floor", "hard/b18", comes_to_rest_in_layers, limited_step=False, methods=SEIDEL),
    HardCase("B19", "two layers in one place", "hard/b19", comes_to_rest_in_layers, limited_step=False, methods=SEIDEL),
    HardCase("B23", "a poke, and one iteration", "hard/b10", one_iteration, methods=POSITIONS),
    HardCase("B24 one", "1 x 1 masses", "hard/b24", laws.like_the_reference, methods=FORCES + POSITIONS),
    HardCase("B24 row", "1 x 7 masses", "hard/b24", laws.like_the_reference, {"grid.columns": 7}, methods=FORCES + POSITIONS),
    HardCase("B24 column", "7 x 1 masses", "hard/b24", laws.like_the_reference, {"grid.rows": 7, "grid.pinned": "top"},
             methods=FORCES + POSITIONS),
    HardCase("B24 pinned", "every mass pinned", "hard/b24", laws.like_the_reference,
             {"grid.rows": 2, "grid.columns": 3, "grid.pinned": "edges"}, methods=FORCES + POSITIONS),
    HardCase("B24 empty", "no masses", "hard/b24", laws.empty, expect="refused", methods=FORCES + POSITIONS),
    *BODY_CASES,
    *TETRAHEDRAL_CASES,
    *FLUID_CASES,
)  # fmt: skip
