"""The cloths of the catalogue: what their comments say of step sizes and variants holds."""

import re
from pathlib import Path

import numpy as np
import pytest

from softlab.labbook.claims.findings import CLOTH
from softlab.model.core.build import pinned_indices
from softlab.model.core.families import stability_limit
from softlab.model.scene.reader import catalogue, parse_settings
from softlab.model.scene.scene import Scene, load_scene

CLOTHS = [name for name in catalogue() if "/" not in name and load_scene(name).cloth]


def variants(name: str) -> list[dict[str, object]]:
    """What the comments of a scene offer to `--set`, several on a line together."""
    comments = [
        line for line in Path(catalogue()[name]).read_text(encoding="utf-8").splitlines() if line.startswith("#")
    ]
    found = [re.findall(r'--set (?:"([^"]+)"|([^\s`"]+))', line) for line in comments]
    return [parse_settings([quoted or plain for quoted, plain in line]) for line in found if line]


def limit(name: str, **changes: object) -> float:
    return stability_limit(load_scene(name).replace({path.replace("__", "."): v for path, v in changes.items()}))


def test_all_cloths_are_there():
    asked = {
        "cloth-compute",
        "cloth-flag",
        "cloth-hanging",
        "cloth-sphere",
        "cloth-twist",
        "cloth-warp",
        "cloth-wind",
        "rope",
    }
    assert asked <= set(CLOTHS)


@pytest.mark.parametrize("name", CLOTHS)
def test_step_sizes_hold(name):
    """Below the limit, whose bound holds in any state; so do those of the variants that the comments offer."""
    scene = load_scene(name)
    assert scene.method.dt < stability_limit(scene)
    for changes in variants(name):
        varied = scene.replace(changes)
        assert varied.method.dt < stability_limit(varied), changes


def test_the_compute_shaders_cloth_is_as_close_to_its_limit_as_told():
    """96 % of it; the limit of semi-implicit Euler is 391 times as large; with twelve springs the step is too large."""
    scene = load_scene("cloth-compute")
    own = stability_limit(scene)
    assert scene.method.dt / own == pytest.approx(0.96, abs=0.005)
    assert limit("cloth-compute", method__integrator="semi-implicit-euler") / own == pytest.approx(391, abs=0.5)
    assert limit("cloth-compute", bending__stiffness=8000.0) < scene.method.dt
    assert {"bending.stiffness": 8000.0, "method.dt": 3.5e-6} in variants("cloth-compute")


def test_the_lab_books_cloth_is_the_catalogues():
    """The claim on limits is made from constants that are this scene's."""
    scene = load_scene("cloth-compute")
    assert scene.damping is not None and scene.cloth is not None
    springs = [scene.cloth_springs[kind].stiffness for kind in ("structural", "shear")]
    assert springs == 2 * [CLOTH["stiffness"]]
    told = (scene.cloth.mass, scene.damping.coefficient, scene.method.dt)
    assert told == (CLOTH["mass"], CLOTH["damping"], CLOTH["dt"])
    assert scene.cloth.spacing * 49 == pytest.approx(2.0, rel=1e-15)


def test_pins_of_the_hanging_cloth():
    """Two corners; by the variants of its comment three and four masses of the top row, as far apart as they can be."""
    scene = load_scene("cloth-hanging")
    pins = [pinned_indices(scene.replace(changes).grid) for changes in ({}, *variants("cloth-hanging"))]
    assert [len(each) for each in pins] == [2, 3, 4]
    for each in pins:
        assert each[0] == 0 and each[-1] == 31 and np.ptp(np.diff(each)) <= 1


def test_the_flag_is_held_along_its_side_at_any_size():
    flag: Scene = load_scene("cloth-flag").replace({"cloth.rows": 5, "cloth.columns": 7})
    assert pinned_indices(flag.grid).tolist() == [0, 7, 14, 21, 28]
