"""A fluid must not resist shear: moduli of its lattice under pressure, and what a wide enough support sets free."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.fluid.shear import FLOWS, shear_lines, shear_over_pressure
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.tables.fluid import AMONG_BODIES, SUPPORT

D, ROWS, ACROSS = 0.05, 5, 10  # m; layers of each fluid, particles along a side


def energy(across: float, change: np.ndarray) -> float:
    """Sum of (1 - r / support)^3 over the neighbours of a lattice's particle, moved by the matrix `change`."""
    axes = len(change)
    places = np.array([p for p in product(range(-4, 5), repeat=axes) if any(p)], float) @ change.T
    return float((np.maximum(1 - np.linalg.norm(places, axis=1) / across, 0) ** 3).sum())


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("across", [1.5, SUPPORT, AMONG_BODIES, 2.3])
def test_moduli_are_slopes_of_the_energy(across: float, axes: int) -> None:
    """Second differences by a shear g along axes and diagonals, over minus the first by the volume. Their error is of order
    g where neighbours lie at the end of the support, whose third derivative jumps there, else of g^2."""
    step = 1e-4
    grown = [energy(across, np.eye(axes) * (1 + sign * step)) for sign in (1, -1)]
    pressure = (grown[1] - grown[0]) / (2 * step * axes)
    turned = np.eye(axes)
    turned[:2, :2] = np.array([[1, -1], [1, 1]]) / np.sqrt(2)
    for modulus, turn in zip(shear_over_pressure(across, axes), (np.eye(axes), turned), strict=True):
        sheared = []
        for g in (step, 0.0, -step):
            stretch = np.eye(axes)
            stretch[0, 0], stretch[1, 1] = np.exp(g / 2), np.exp(-g / 2)
            sheared.append(energy(across, turn @ stretch @ turn.T))
        second = (sheared[0] - 2 * sheared[1] + sheared[2]) / step**2
        assert modulus == pytest.approx(second / pressure, abs=1e-3 if across == 2.0 else 1e-5)


def test_the_default_among_bodies_hardly_resists() -> None:
    """The lattice is stable in space, and a twelfth as stiff as with the usual support."""
    wide, usual = shear_over_pressure(AMONG_BODIES, 3), shear_over_pressure(SUPPORT, 3)
    assert 0 < min(wide) < max(wide) < FLOWS < max(usual)
    assert max(wide) < max(usual) / 12


def stack(support: float | None, top: float = 1000.0) -> Scene:
    """Water of the density `top` on 600 kg/m^3, five layers each on one lattice, undisturbed, between five planes."""
    wall, side = {"kind": "plane", "thickness": 0.0}, ACROSS * D
    fluid: dict[str, Any] = {"kind": "fluid", "rest_distance": D, "size": [side, ROWS * D, side], "support": support}
    return Scene(
        {
            "oil": fluid | {"density": 600.0},
            "water": fluid | {"density": top, "origin": [0.0, ROWS * D, 0.0]},
            "floor": wall,
            "left": wall | {"normal": [1.0, 0.0, 0.0]},
            "right": wall | {"normal": [-1.0, 0.0, 0.0], "point": [side, 0.0, 0.0]},
            "back": wall | {"normal": [0.0, 0.0, 1.0]},
            "front": wall | {"normal": [0.0, 0.0, -1.0], "point": [0.0, 0.0, side]},
            "gravity": {},
            "method": {"solver": "pbf", "dt": 1 / 60, "substeps": 4, "iterations": 10},
        }
    )


@pytest.mark.rest
@pytest.mark.parametrize(("support", "sinks"), [(AMONG_BODIES * D, True), (None, False)])
def test_water_sinks_through_oil(support: float | None, sinks: bool) -> None:
    """With the wide support water is below the oil after 4 s, though nothing disturbed it; with the usual one it has not
    left its place: difference of mean heights over that at the start (-0.4 and 0.98 measured)."""
    scene = stack(support)
    fluid = scene.fluid_set.fluid
    with open_simulation(scene, precision="float32", math="fast") as simulation:
        simulation.advance(240)
        height = simulation.read("position")[:, 1]
    left = float(height[fluid == 1].mean() - height[fluid == 0].mean()) / (ROWS * D)
    assert left < -0.2 if sinks else left > 0.9
    assert bool(shear_lines(scene)) != sinks


def test_a_run_notes_what_may_stay() -> None:
    (line,) = shear_lines(stack(None))
    assert line.startswith("water: ") and "may stay above oil" in line and "support = 0.1" in line
    assert shear_lines(stack(None, 500.0)) == [] == shear_lines(stack(None).replace({"gravity.enabled": False}))
    assert shear_lines(load_scene("two-fluids")) == [], "they stand side by side"


def test_fluids_among_bodies_have_a_wide_support() -> None:
    """Unless one is stated; the table does not hold it, so that it follows the rest distance."""
    scene = load_scene("float")
    assert scene.parts["water"].support == AMONG_BODIES * 0.025 == scene.members["fluid"].fluids["water"].support  # type: ignore[attr-defined]
    assert "support" not in scene.as_dict()["water"] and shear_lines(scene) == []
    stated = scene.replace({"water.support": 0.045})
    assert stated.members["fluid"].fluids["water"].support == 0.045
    assert "bodies rise and sink in it too slowly" in shear_lines(stated)[0]
    assert load_scene("wet-cloth").members["fluid"].fluids["water"].support is None, "a cloth is no body"
