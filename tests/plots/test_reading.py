"""Reading a store: no scene is built of what it holds, and no body; what a stored scene tells without."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest

from softlab.bench.experiments import projections, throughput
from softlab.bench.experiments.projections import sheet
from softlab.bench.experiments.scaling import experiment as scaling
from softlab.bench.experiments.stability import points as stability_points
from softlab.bench.experiments.throughput import bodies, cube, heap, jelly
from softlab.labbook.build import book_data, committed_data
from softlab.model.particles import body_set
from softlab.model.scene.scene import Scene, load_scene
from softlab.plots.core import accuracy_points
from softlab.plots.core.data import Results
from softlab.plots.core.read import load
from softlab.plots.core.style import settings
from softlab.plots.draw import FIGURES
from softlab.plots.figures import roofline


def refuse(*_: Any, **__: Any) -> None:
    raise AssertionError("a scene or a body was built")


@pytest.fixture(scope="module")
def committed() -> Results:
    """The measurements that come with the lab, of every kind, read while no scene can be built."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Scene, "__init__", refuse)
        return load(None, committed_data())


READERS: dict[str, Callable[[Any], Any]] = {
    "accuracy": accuracy_points.points,
    "throughput": lambda source: throughput.Throughput().rows(source.measures),
    "projections": lambda source: projections.Projections().rows(source.measures),
    "gpus": lambda source: scaling.Scaling().rows(source.measures),
    "stability": lambda source: stability_points.stability_of(source.measures),
    "ceilings": lambda source: roofline.ceilings(source, "cpu"),
}


@pytest.mark.parametrize("reader", READERS)
def test_points_are_read_without_building_a_scene(
    reader: str, committed: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Scene, "__init__", refuse)
    assert any(READERS[reader](source) for source in committed.sources)


def test_neither_figures_nor_sentences_make_a_body(committed: Results, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(body_set, "make_body_set", refuse)
    monkeypatch.setattr("softlab.model.scene.scene_parts.make_body_set", refuse)
    assert book_data(committed)["claims"]
    with settings():
        undrawn = {name for name, draw in FIGURES.items() if isinstance(draw(committed), str)}
    assert undrawn == {"fluids-truth", "fluids-phases"}  # the data of the old kernel are gone


@pytest.mark.parametrize(
    "scene",
    [
        load_scene("lab-curtain"), load_scene("cloth-drop"), sheet(16, 12, "jacobi", 10, 2), jelly(12, 2), cube(6, 2),
        bodies(50, True), heap(50),
    ],
)  # fmt: skip
def test_a_stored_scene_tells_what_the_built_one_tells(scene: Scene) -> None:
    stored = Scene.stored(json.loads(scene.canonical()))
    assert stored.kinds == scene.kinds and stored.method == scene.method
    assert (stored.springs, stored.damping, stored.gravity) == (scene.springs, scene.damping, scene.gravity)
    assert stored.cloth_springs == scene.cloth_springs
    assert {name: body.count for name, body in stored.bodies.items()} == {n: b.count for n, b in scene.bodies.items()}
    assert throughput.region_of(stored) == throughput.region_of(scene)
    if not scene.bodies:
        assert (stored.grid.rows, stored.grid.columns) == (scene.grid.rows, scene.grid.columns)
