"""Colours that colour-blind readers can distinguish (Okabe and Ito, 2008), and the colour of each method in all figures."""

from __future__ import annotations

BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILLION, PURPLE = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7",
)  # fmt: skip
GREY = "#8A8A8A"
BROWN, PINK, VIOLET = "#7A5230", "#B0305C", "#5E3C99"

METHODS = {  # one colour for one method; its marker may depend on the figure
    "lab": VERMILLION,
    "semi-implicit-euler": ORANGE,
    "velocity-verlet": BLUE,
    "rk4": GREEN,
    "explicit-euler": PURPLE,
    "taylor": SKY,
    "implicit-euler": VIOLET,
    "implicit-euler-linear": VIOLET,
    "newton": VIOLET,  # implicit Euler, solved to the end
    "newton of order 2": PINK,
    "xpbd gauss-seidel": BLACK,
    "xpbd jacobi": BROWN,
    "xpbd averaged-jacobi": PINK,
    "xpbd": BLACK,
    "vertex block descent": SKY,
    "shape-matching": ORANGE,
}
