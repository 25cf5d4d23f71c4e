"""Tetrahedral bodies as they are shown: stress against closed forms, colours and legends, the window's keys for what they are
made of and how they look."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from real_window import StillWindow, display, needs_display  # noqa: F401
from test_view3d import drawing  # noqa: F401  # a fixture

from softlab.app.output.offscreen import OffscreenRenderer, Picture, render_frame
from softlab.app.render import colours
from softlab.app.render.tetrahedra_view import COLOURINGS, outer_faces
from softlab.app.window.demo import Demo
from softlab.app.window.keys import keys_of, keys_text
from softlab.app.window.materials import FIRST_DAMPING, material_changes, material_text
from softlab.model.base.errors import InputError
from softlab.model.scene.scene import Scene
from softlab.model.tables.tetrahedra import LARGEST_RATIO
from softlab.model.tetrahedra.material import at_particles, largest_strain, von_mises

BODY = {"kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.2, 0.1, 0.1]}, "edge": 0.1, "poisson_ratio": 0.3,
        "young_modulus": 1e5}  # fmt: skip
METHOD = {"solver": "xpbd", "dt": 1 / 60, "substeps": 2}


def scene(**fields: Any) -> Scene:
    return Scene({"bar": BODY | fields, "method": METHOD, "gravity": {"enabled": False}})


PULLED = {  # material -> (stretch across, P11 [Pa]) of uniaxial tension to 1.1, E 1e5 Pa, nu 0.3
    "fixed-corotated": (0.970730046, 9679.246404), "corotated": (0.97, 1e4), "neo-hookean": (0.970643477, 9365.428),
}  # fmt: skip


@pytest.mark.parametrize("material", PULLED)
def test_the_stress_of_a_pulled_bar_is_what_pulls(material: str) -> None:
    """True stress along it: the force over the area that is left. The strain is that of its length."""
    found, (across, pull) = scene(material=material).tetrahedra_set, PULLED[material]
    turned = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    position = found.position * [1.1, across, across] @ turned.T
    if np.linalg.det(turned) < 0:
        position[:, 2] *= -1
    np.testing.assert_allclose(von_mises(found, position), pull / across**2, rtol=2e-6)
    np.testing.assert_allclose(largest_strain(found, position), 0.1, rtol=1e-6)
    assert von_mises(found, found.position).max() < 1e-6
    pressed = von_mises(found, 0.9 * found.position)  # alike from all sides: nothing to tell
    assert pressed.max() < 1e-6


def test_levels_of_particles_are_means_by_volume() -> None:
    found = scene().tetrahedra_set
    np.testing.assert_allclose(at_particles(found, np.full(len(found.tetrahedra), 7.0)), 7.0)
    some = np.random.default_rng(0).random(len(found.tetrahedra))
    here = (found.tetrahedra == 3).any(axis=1)
    assert at_particles(found, some)[3] == pytest.approx(np.average(some[here], weights=found.volume[here]))
    bad = found.position.copy()
    bad[0] = np.nan
    assert np.isnan(von_mises(found, bad)).any() and np.isfinite(von_mises(found, bad)).any()


def test_colours_of_levels_grow_darker() -> None:
    shown = colours.level_colours(np.linspace(0, 1, 33), 1.0)
    assert (np.diff(shown @ [0.3, 0.6, 0.1]) < 0).all()
    np.testing.assert_array_equal(colours.level_colours(np.array([5.0, np.nan]), 1.0), np.tile(shown[-1], (2, 1)))
    assert [colours.round_up(x) for x in (0.011, 0.2, 3.1e4)] == [0.02, 0.2, 5e4]


def test_outer_faces_are_the_particles_own() -> None:
    found = scene().tetrahedra_set
    skin = outer_faces(found)
    np.testing.assert_array_equal(skin.points(found.position), found.position)
    assert sum(len(faces) for faces in skin.triangles) == len(found.surface)


# ---------------------------------------------------------------------- what keys change of the material


def test_a_press_changes_a_material_by_its_factor() -> None:
    made = scene()
    assert material_changes(made, "young_modulus", 1) == {"bar.young_modulus": 1.25e5}
    assert material_changes(made, "poisson_ratio", 1)["bar.poisson_ratio"] == pytest.approx(0.34)
    assert material_changes(made, "poisson_ratio", 99)["bar.poisson_ratio"] == LARGEST_RATIO
    assert material_changes(made, "poisson_ratio", -99)["bar.poisson_ratio"] == 0.0
    assert material_changes(made, "damping", 1) == {"bar.damping": FIRST_DAMPING}
    assert material_changes(made, "damping", -1) == {"bar.damping": 0.0}
    assert material_changes(scene(damping=1.5e-4), "damping", -1) == {"bar.damping": 0.0}
    assert material_text(made, "young_modulus") == "E 1e+05 Pa"


@pytest.fixture
def demo() -> Iterator[Demo]:
    with Demo([scene(velocity=[1.0, 0.0, 0.0])], precision="float64", math="exact", threads="1") as opened:
        yield opened


def test_the_state_goes_on_in_another_material(demo: Demo) -> None:
    demo.frame()
    before = demo.world.state()
    demo.change_stiffness(1)
    demo.change_material("poisson_ratio", -1)
    demo.change_material("damping", 1)
    bar = demo.world.scene.tetrahedra["bar"]
    assert (bar.young_modulus, bar.damping) == (1.25e5, FIRST_DAMPING) and bar.poisson_ratio == pytest.approx(0.25)
    assert demo.message == "damping 0.001 s, state kept"
    after = demo.world.state()
    np.testing.assert_array_equal(after.position, before.position)
    np.testing.assert_array_equal(after.velocity, before.velocity)
    assert (after.time, after.step) == (before.time, before.step)
    demo.frame()
    demo.restart()
    assert demo.world.scene.tetrahedra == demo.scenes[0].tetrahedra and demo.world.step == 0


def test_what_cannot_be_is_a_message(demo: Demo) -> None:
    demo.change_material("young_modulus", 3150)
    assert demo.world.scene.tetrahedra["bar"].young_modulus == 1e5 and "young_modulus" in demo.message
    grid = Scene({"grid": {"rows": 2, "columns": 2}, "springs": {}})
    with Demo([grid], threads="1") as other:
        other.change_material("damping", 1)
        assert other.message == "this scene has no tetrahedra"


def test_keys_of_tetrahedra_are_told() -> None:
    text, keys = keys_text(1200, "tetrahedra", True), keys_of("tetrahedra", True)
    assert all(meaning in text for _, meaning in keys) and "( )" not in keys_text(1200, space=True)
    assert all(len(meaning) < 33 and len(key) < 8 for key, meaning in keys)
    assert {key for key, _ in keys_of("sheet", True)} < {key for key, _ in keys}


# ---------------------------------------------------------------------- pictures


BENT = scene().tetrahedra_set.position * [1.2, 1.0, 1.0]


@pytest.mark.usefixtures("drawing")
def test_a_picture_of_stress_has_its_legend(tmp_path: Path) -> None:
    with OffscreenRenderer(scene(), 480, 360, view_options=("stress",)) as renderer:
        renderer.fit(BENT)
        renderer.draw(BENT)
        told = renderer._view.level_legend()
        stress = renderer.image()
        renderer._view.set_view_options(("strain", "mesh"))
        renderer.draw(BENT)
        assert renderer._view.level_legend() == ("largest strain of a tetrahedron", 0.2)
        assert not np.array_equal(renderer.image(), stress)
        renderer._view.set_view_options(("edges",))
        renderer.draw(BENT)
        assert renderer._view.level_legend() is None
        with pytest.raises(InputError, match="must be one of"):
            renderer._view.set_view_options(("heat",))
    title, most = told
    assert title == "von Mises stress / kPa"
    assert most >= von_mises(scene().tetrahedra_set, BENT).max() / 1e3
    picture = Picture(320, 240, view_options=("stress", "mesh"))
    assert render_frame(scene(), BENT, tmp_path / "bar.png", picture).exists()
    with pytest.raises(InputError, match="applies to tetrahedral bodies"):
        render_frame(Scene({"grid": {"rows": 2, "columns": 2}, "springs": {}}), np.zeros((4, 2)), tmp_path / "g.png",
                     Picture(view_options=("stress",)))  # fmt: skip


@pytest.mark.usefixtures("drawing")
def test_colours_are_those_of_the_legend() -> None:
    """One stretch everywhere, one level; light and shade leave most of it."""
    with OffscreenRenderer(scene(), 480, 360, legend=False, view_options=("strain",)) as renderer:
        renderer.fit(BENT)
        renderer.draw(BENT)
        image = renderer.image()[:, :, :3] / 255
        middle = renderer.camera.to_window(BENT.mean(axis=0))
        seen = image[renderer.height - 1 - round(middle[1]), round(middle[0])]
        want = colours.level_colours(np.array(0.2), 0.2)
    assert np.abs(seen - want).max() < 0.15


@pytest.mark.display
@needs_display
def test_window_keys_change_looks_and_material(tmp_path: Path, display: str) -> None:  # noqa: F811
    with StillWindow(tmp_path, display, scene()) as window:
        for key, name, shown in (("o", "colouring", COLOURINGS[1]), ("k", "skin", False), ("o", "colouring", COLOURINGS[2]),
                                 ("l", "lines", True), ("l", "lines", False), ("o", "colouring", COLOURINGS[0])):  # fmt: skip
            window.key(key)
            window.wait(f"{name} {shown}", lambda state, name=name, shown=shown: state[name] == shown)
        for key, message in (
            ("braceright", "E 1.25e+05 Pa"),
            ("parenright", "Poisson's ratio 0.34"),
            ("greater", "damping 0.001 s"),
        ):
            window.key(key)
            window.wait(message, lambda state, message=message: state["message"] == f"{message}, state kept")
        window.key("r")
        window.wait("a restart", lambda state: state["message"].startswith("restarted"))
