"""The panel without a window: pushed events move sliders, and the worlds differ; what cannot be is refused with a line."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from softlab.app.command.dear_imgui import REMEDY
from softlab.app.window import snapshot
from softlab.app.window.panel import panel as panel_module
from softlab.app.window.panel.style import DARK, PanelStyle
from softlab.model.scene.scene import Scene, load_scene

pytest.importorskip("imgui_bundle", reason=f"the panel needs Dear ImGui: {REMEDY}")
from panel_stage import Stage

GRID: dict[str, Any] = {
    "grid": {"rows": 4, "columns": 4, "pinned": "top-corners"},
    "springs": {},
    "damping": {},
    "gravity": {},
    "method": {"dt": 0.01},
}
CLOTH: dict[str, Any] = {
    "cloth": {"rows": 4, "columns": 4, "pinned": "top"}, "structural": {}, "gravity": {}, "wind": {},
    "ball": {"kind": "sphere", "center": [0.0, -3.0, 0.0], "radius": 0.5}, "method": {"dt": 0.001},
}  # fmt: skip
JELLY: dict[str, Any] = {
    "ball": {"kind": "soft_body", "shape": {"name": "box"}, "particle_spacing": 0.3},
    "gravity": {},
}
BAR: dict[str, Any] = {
    "bar": {"kind": "tetrahedral_body", "shape": {"name": "box"}, "voxels": 2, "young_modulus": 1e5, "pinned": ["left"]},
    "gravity": {}, "method": {"solver": "xpbd", "dt": 0.01, "substeps": 2},
}  # fmt: skip


def scene(tables: dict[str, Any] = GRID, **changes: Any) -> Scene:
    return Scene(tables | changes)


# ---------------------------------------------------------------------- sliders


def test_a_dragged_slider_changes_gravity_and_the_motion() -> None:
    with Stage(scene()) as stage, Stage(scene()) as other:
        stage.drag("gravity.acceleration", 0.3, 0.9)
        moved = stage.demo.world.scene.gravity.acceleration  # type: ignore[union-attr]
        assert 25 < moved < 30, "live: while the button is down"
        stage.let_go()
        for one in (stage, other):
            one.demo.frame()
        assert stage.demo.positions[0][:, 1].mean() < other.demo.positions[0][:, 1].mean() - 1e-3
        stage.frames()
        stage.click("reset gravity.acceleration")
        assert stage.demo.world.scene.gravity.acceleration == 9.81  # type: ignore[union-attr]
        stage.frames()
        assert "reset gravity.acceleration" not in stage.state.places, "nothing is left to be taken back"


@pytest.mark.parametrize(
    ("path", "typed", "line"),
    [
        ("gravity.acceleration", "nan", "finite"), ("gravity.acceleration", "-5", "at least 0"),
        ("springs.stiffness", "0", "greater than 0"), ("method.dt", "-1", "greater than 0"),
        ("damping.coefficient", "inf", "finite"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_with_a_line(path: str, typed: str, line: str) -> None:
    with Stage(scene()) as stage:
        before = stage.demo.world.scene.canonical()
        stage.type_into(path, typed)
        assert stage.demo.world.scene.canonical() == before
        assert path in stage.demo.message and line in stage.demo.message and "\n" not in stage.demo.message


def test_a_typed_number_may_lie_beyond_the_slider() -> None:
    with Stage(scene()) as stage:
        stage.type_into("gravity.acceleration", "274")
        assert stage.demo.world.scene.gravity.acceleration == 274.0  # type: ignore[union-attr]


def test_over_the_limit_it_is_told() -> None:
    with Stage(scene()) as stage:
        stage.drag("method.dt", 0.5, 0.99)
        stage.let_go()
        assert stage.demo.over_limit and "OVER the limit" in stage.demo.message


def test_what_is_not_live_opens_the_world_anew_when_it_is_let_go() -> None:
    with Stage(scene()) as stage:
        stage.demo.frame()
        before = stage.demo.world
        stage.drag("springs.rest_length", 0.3, 0.6)
        assert stage.demo.world is before, "not yet"
        stage.let_go()
        world = stage.demo.world
        assert world is not before and world.step == 10 and world.scene.springs.rest_length > 1.5  # type: ignore[union-attr]
        assert "state kept" in stage.demo.message and stage.demo.generation == 1
        stage.demo.restart()
        assert stage.demo.world.scene.springs.rest_length == 1.0 and stage.demo.world.step == 0  # type: ignore[union-attr]


def test_other_masses_begin_at_the_start() -> None:
    with Stage(scene()) as stage:
        stage.demo.frame()
        assert stage.demo.set_field("grid.rows", 6) and len(stage.demo.position) == 24
        assert stage.demo.world.step == 0 and "restarted because" in stage.demo.message
        stage.frames()
        assert not stage.demo.set_field("grid.rows", 0) and len(stage.demo.position) == 24, stage.demo.message


def test_the_material_of_tetrahedra_has_sliders() -> None:
    with Stage(scene(BAR)) as stage:
        stage.drag("bar.young_modulus ", 0.5, 0.75)
        stage.let_go()
        assert stage.demo.world.scene.tetrahedra["bar"].young_modulus == pytest.approx(1e6, rel=0.2)
        assert stage.demo.message.startswith("E ") and "state kept" in stage.demo.message
        stage.type_into("bar.poisson_ratio ", "0.7")
        assert stage.demo.world.scene.tetrahedra["bar"].poisson_ratio == 0.45
        assert "poisson_ratio" in stage.demo.message


def test_the_wind_has_three_sliders() -> None:
    with Stage(scene(CLOTH)) as stage:
        stage.drag("wind.velocity.x", 0.5, 0.95)
        stage.let_go()
        wind = stage.demo.world.scene.wind
        assert wind is not None and wind.velocity[0] > 10 and stage.demo.message.startswith("wind.velocity = [")
        stage.demo.frame()
        assert stage.demo.world.read("velocity")[-1, 0] > 0


def test_what_one_of_two_scenes_lacks_is_changed_in_the_other() -> None:
    bare = {name: table for name, table in GRID.items() if name not in ("damping", "gravity")}
    with Stage(scene(), scene(bare)) as stage:
        assert stage.demo.set_field("damping.coefficient", 0.1) and stage.demo.set_field("gravity.acceleration", 1.0)
        assert not stage.demo.set_field("external.magnitude", 0.1) and "no such table" in stage.demo.message
        first, second = (world.scene for world in stage.demo.worlds)
        assert first.damping.coefficient == 0.1 and not {"damping", "gravity", "external"} & set(second.parts)  # type: ignore[union-attr]
        assert stage.demo.set_field("springs.stiffness", 20.0)
        assert [world.scene.springs.stiffness for world in stage.demo.worlds] == [20.0, 20.0]  # type: ignore[union-attr]


# ---------------------------------------------------------------------- the rest of it


def test_the_head_plays_steps_and_restarts() -> None:
    with Stage(scene()) as stage:
        stage.click("Step")
        assert stage.demo.paused and stage.demo.world.step == 1
        stage.click("Play")
        assert not stage.demo.paused
        stage.drag("speed", 0.2, 0.02)
        stage.let_go()
        assert stage.demo.steps_per_frame == 1
        stage.click("Restart")
        assert stage.demo.world.step == 0


@pytest.mark.parametrize("tables", [GRID, CLOTH, BAR, JELLY], ids=["grid", "cloth", "tetrahedra", "bodies"])
def test_every_section_is_laid_out_for_every_kind_of_scene(tables: dict[str, Any]) -> None:
    """In the dark, twice as large, with every section open, of one world and of two."""
    with Stage(scene(tables), look=PanelStyle(DARK, 2.0)) as stage:
        assert not stage.demo.message
        stage.demo.wants_momentum = True
        stage.demo.frame()
        stage.demo.refresh(force=True)
        stage.frames()
        assert len(stage.state.history.rows) and np.isfinite(stage.state.history.rows).all()
        assert stage.demo.compare() and len(stage.demo.worlds) == 2
        stage.viewer.views = [stage.viewer.views[0]] * 2
        stage.frames()
        assert "Changes apply to" in stage.state.places


def test_two_settings_side_by_side() -> None:
    with Stage(scene()) as stage:
        stage.demo.frame()
        stage.click("Duplicate to compare")
        assert [world.step for world in stage.demo.worlds] == [10, 10] and stage.demo.alone and stage.demo.current == 1
        stage.drag("gravity.acceleration", 0.3, 0.0)
        stage.let_go()
        first, second = (world.scene.gravity.acceleration for world in stage.demo.worlds)  # type: ignore[union-attr]
        assert first == 9.81 and second < 0.5
        stage.click("Keep only this scene")
        assert len(stage.demo.worlds) == 1 and stage.demo.world.scene.gravity.acceleration == second  # type: ignore[union-attr]


def test_layers_and_colliders() -> None:
    with Stage(scene(CLOTH)) as stage:
        stage.click("Springs", 0.05)
        stage.click("Colliders", 0.05)
        view = stage.viewer.views[0]
        assert view.lines and not view.colliders
        stage.drag("Light rotation", 0.5, 0.75)
        stage.let_go()
        assert view.light == pytest.approx([0.6, 0.8, 0.0], abs=0.05)
        stage.click("picture quick")
        assert view.detail.name == "quick"


@pytest.mark.parametrize("axes", [2, 3])
def test_layers_of_a_fluid(axes: int) -> None:
    table = {"kind": "fluid", "dimensions": axes, "size": [0.2] * axes, "rest_distance": 0.1}
    with Stage(Scene({"water": table, "method": {"solver": "pbf", "dt": 0.01}})) as stage:
        view = stage.viewer.views[0]
        for pressed, lines in (("Particles", True), ("Surface", False)):
            stage.click(pressed)
            assert view.lines == lines
        stage.click("Spray, foam, bubbles")
        assert view.foam and stage.demo.message.startswith("spray")
        stage.click("colour density")
        assert view.colouring == "density"
        stage.click("Spray, foam, bubbles")
        assert not view.foam


def test_precision_and_kernel_carry_the_state_over_and_what_a_solver_lacks_it_says() -> None:
    with Stage(scene()) as stage:
        stage.demo.frame()
        assert stage.demo.run_with({"precision": "float64"}) and stage.demo.world.step == 10
        assert stage.demo.world.options.precision == "float64"
        assert stage.demo.run_with({"kernel": "stages"}) and stage.demo.world.kernel == "stages"
        before = stage.demo.world
        assert not stage.demo.run_with({"kernel": "cooperative"}) and stage.demo.world is before
        assert "kernel = 'cooperative'" in stage.demo.message and stage.demo.options["kernel"] == "stages"


def test_the_scene_and_the_state_are_saved_and_come_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with Stage(scene()) as stage:
        stage.drag("gravity.acceleration", 0.3, 0.1)
        stage.let_go()
        stage.demo.frame()
        saved, state = snapshot.save_scene(stage.demo), snapshot.save_state(stage.demo)
        assert load_scene(saved).canonical() == stage.demo.world.scene.canonical()
        position = stage.demo.world.read("position")
        stage.demo.frame()
        assert snapshot.load_state(stage.demo, state) and stage.demo.world.step == 10
        np.testing.assert_array_equal(stage.demo.world.read("position"), position)
        assert not snapshot.load_state(stage.demo, "nowhere.npz") and "nowhere.npz" in stage.demo.message
        assert not snapshot.save_state(stage.demo, state) and "exists already" in stage.demo.message
        assert not snapshot.save_scene(stage.demo, "scene.txt") and ".toml" in stage.demo.message


def test_the_error_is_told_where_a_reference_knows_the_motion() -> None:
    judged: list[Scene] = []

    def judge(scene: Scene, state: Any, diverged: Any) -> tuple[float | None, str | None]:
        judged.append(scene)
        return 1e-3, None

    with Stage(scene(), judge=judge) as stage:
        stage.demo.frame()
        stage.click("Measure the error now")
        assert stage.state.error == "error 1.00e-03 spacings at 0.100 s" and len(judged) == 1
        stage.drag("gravity.acceleration", 0.3, 0.5)
        stage.let_go()
        stage.click("Measure the error now")
        assert "a setting was changed while it ran" in stage.state.error and len(judged) == 1
        stage.demo.restart()
        stage.click("Measure the error now")
        assert len(judged) == 2


# ---------------------------------------------------------------------- whose events are whose


def test_a_closed_panel_takes_nothing_and_an_open_one_what_is_over_it(monkeypatch: pytest.MonkeyPatch) -> None:
    with Stage(scene()) as stage:
        panel = panel_module.Panel(stage.viewer)
        assert panel.width == 0 and not panel.pressed(1190.0, 10.0, 1) and not panel.key(97, True)
        panel._context, panel._layout = stage.context, stage.layout
        panel._drawing = SimpleNamespace(draw=lambda *_: None)
        panel._buttons = {1: 0}
        panel.toggle()
        assert panel.open and panel.width == 372
        panel.lay_out()
        panel.draw()
        assert not panel.pressed(100.0, 100.0, 1) and panel.pressed(1190.0, 10.0, 1)
        assert panel.moved(100.0, 100.0), "what was pressed in it is its until it is let go"
        assert panel.released(1) and not panel.released(1)
        panel.lay_out()
        panel.lay_out()
        assert not panel.moved(100.0, 100.0)
        panel.toggle()
        assert panel.width == 0 and not stage.demo.wants_momentum


def test_without_dear_imgui_the_key_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(panel_module, "panel_available", lambda: (False, "no panel in softlab demo (ImportError)"))
    with Stage(scene()) as stage:
        panel = panel_module.Panel(stage.viewer)
        panel.toggle()
        assert not panel.open and REMEDY in stage.demo.message
