"""The registry of solver families: each scene has one, and all that an entry names is there."""

from __future__ import annotations

import pytest

from softlab.app.presentation import Presentation
from softlab.model.base.components import named
from softlab.model.base.errors import SceneError
from softlab.model.core.families import families, family_of, scene_plan, stability_limit
from softlab.model.core.family import SolverFamily
from softlab.model.mass_spring.plan import mass_spring_plan
from softlab.model.scene.reader import catalogue
from softlab.model.scene.scene import load_scene
from softlab.model.tables.kinds import KINDS

ONES = {family.name: family for family in families()}


def test_each_scene_of_the_catalogue_has_one_family_and_each_family_a_scene() -> None:
    accepted = {name: [one.name for one in families() if one.accepts(load_scene(name))] for name in catalogue()}
    assert all(len(found) == 1 for found in accepted.values()), accepted
    assert {found for (found,) in accepted.values()} == set(ONES)


@pytest.mark.parametrize("family", families(), ids=ONES)
def test_what_an_entry_names_is_there(family: SolverFamily) -> None:
    assert callable(named(f"{family.reference}:simulate"))
    assert isinstance(named(family.presentation), Presentation)
    assert set(family.solvers) == set(family.passes)
    assert set(family.solvers) == {"cpu", "gpu"} or family.name == "fluid"  # whose kernels for a GPU are to come
    for backend in family.solvers:
        if backend == "gpu":
            pytest.importorskip("numba_cuda", reason="needs numba-cuda")
        assert named(family.solvers[backend]).backend == backend
        assert callable(named(family.passes[backend]))
        assert callable(named(family.clusters.get(backend, family.solvers[backend])))


def test_the_scenes_plan_and_limit_are_the_familys() -> None:
    scene = load_scene("lab-grid")
    assert family_of(scene) is ONES["mass-spring grid"]
    assert scene_plan(scene) == mass_spring_plan(scene)
    assert stability_limit(scene, 200.0) == pytest.approx(2 * stability_limit(scene, 400.0), rel=0.1)


def test_a_part_that_a_solver_does_not_know_is_refused_and_not_ignored() -> None:
    """Families list what they know, not what they do not: a new kind is refused until it is there."""
    assert set(KINDS) == set().union(*(family.knows for family in families()))
    for name in catalogue():
        scene = load_scene(name).replace({})
        assert set(scene.kinds.values()) <= family_of(scene).knows
        scene.parts["lure"], scene.kinds["lure"] = scene.method, "trap"
        with pytest.raises(SceneError, match=r"^lure\.kind = 'trap': is not supported by the solver of"):
            family_of(scene)
