"""The cloth on CPU threads: near the reference, every part is felt, normals, what is refused."""

import numpy as np
import pytest
from cloth_scenes import BODIES, POKE, cloth_scene

from softlab.app.driver import open_simulation
from softlab.bench.reference import mass_spring as reference
from softlab.model.base.errors import SceneError
from softlab.model.core.build import build
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.simulation import State
from softlab.model.geometry.normals import vertex_normals
from softlab.model.scene.scene import Scene


def table(rows=5, columns=7, integrator="semi-implicit-euler", dt=0.002, **parts):
    """A flat sheet of 0.1 m cells, crumpled by a tenth of that, pinned at its far corners, with the parts named."""
    sheet = {
        "rows": rows,
        "columns": columns,
        "spacing": 0.1,
        "mass": 0.01,
        "placement": "flat",
        "pinned": "top-corners",
    }
    tables = {"cloth": sheet, "perturbation": {"amplitude": 0.01}, **parts}
    return Scene(tables | {"method": {"integrator": integrator, "dt": dt}})


NET = {"structural": {"stiffness": 100.0}}
SPRINGS = NET | {"shear": {"stiffness": 80.0}, "bending": {"stiffness": 10.0}, "gravity": {}}


def stepped(scene, batches=(30,), **options) -> State:
    with open_simulation(scene, allow_unstable=True, **({"math": "exact"} | options)) as simulation:
        for steps in batches:
            simulation.advance(steps)
        return simulation.state()


def same(a: State, b: State) -> bool:
    return np.array_equal(a.position, b.position) and np.array_equal(a.velocity, b.velocity)


def test_every_part_of_the_scene_that_holds_them_all_is_felt():
    """So that the comparison below compares something: without any one part the state is another."""
    tables = cloth_scene("everything", "semi-implicit-euler").as_dict()

    def state(left_out=None):
        scene = Scene({name: table for name, table in tables.items() if name != left_out})
        return stepped(scene, (15,), kernel="stages", precision="float64")

    whole = state()
    for part in tables.keys() - {"cloth", "method", "title"}:
        assert not same(state(part), whole), part


@pytest.mark.parametrize("bullet, steps", [(False, 20), (True, 2)])
@pytest.mark.parametrize("name", list(INTEGRATORS))
def test_stages_follow_the_reference(name, bullet, steps):
    """Everything at once, and a poke, in float64: the two differ by rounding alone.

    A step rounds coordinates and ways of 1 m some ten times, 2^-53 each, and a difference grows no faster than the square
    of the steps on so short a time (dt w < 0.2): 20^2 * 10 * 2^-53 = 4e-13; speeds come from that over dt. The bullet,
    which sweeps 0.2 m a step, is held for two steps alone: a mass it carries along is caught again or not by the last bit.
    With explicit Euler so does a mass that touched anything: it moves on exactly at the thickness; there nothing is touched.
    """
    scene = cloth_scene("everything", name)
    left_out = set(BODIES) if name == "explicit-euler" else set() if bullet else {"bullet"}
    scene = Scene({key: part for key, part in scene.as_dict().items() if key not in left_out})
    particle, force = POKE
    options = {"kernel": "stages", "precision": "float64", "math": "exact", "live": ("poke",), "allow_unstable": True}
    with open_simulation(scene, threads=2, **options) as simulation:
        simulation.poke(particle, force)
        simulation.advance(steps)
        state = simulation.state()
    position, velocity = reference.simulate(scene, steps, poke=POKE)
    assert np.abs(position - build(scene).position).max() > 1e-6
    assert np.abs(state.position - position).max() < 4e-13
    assert np.abs(state.velocity - velocity).max() < 4e-13 / scene.method.dt


def test_normals_are_those_of_the_triangles():
    """Against model/geometry/normals.py in float64: a unit vector from differences of coordinates of 1 m over cells of 0.1
    m loses three or four bits of 24 to each of some ten roundings; and a flat sheet's point up, a mass alone has none."""
    scene = table(6, 5, **SPRINGS)
    with open_simulation(scene, precision="float32", math="exact") as simulation:
        simulation.advance(20)
        normal, position = simulation.read("normal"), simulation.read("position")
        into = np.zeros((30, 3))
        assert simulation.read("normal", into) is into and np.array_equal(into, normal)
    expected = vertex_normals(position, 6, 5)
    assert normal.dtype == np.float32 and np.abs(normal - expected).max() < 10 * 2**4 * 2**-24 * 10
    flat = scene.replace({"perturbation.amplitude": 1e-12})
    with open_simulation(flat, precision="float64") as simulation:
        assert np.allclose(simulation.read("normal"), [0.0, 1.0, 0.0], atol=1e-9)
    with open_simulation(table(1, 4, **NET)) as simulation:
        assert not simulation.read("normal").any()


def test_what_a_cloth_cannot_be_run_with_is_refused():
    scene = table(4, 4, **NET)
    with pytest.raises(SceneError, match=r"^kernel.*fused, stages"):
        open_simulation(scene, kernel="team")
    with open_simulation(scene) as simulation:
        assert simulation.kernel == "fused"
        with pytest.raises(SceneError, match="position, velocity, strain, normal"):
            simulation.read("colour")
        with pytest.raises(SceneError, match="not live"):
            simulation.poke(3, (0.0, 1.0))
        with pytest.raises(SceneError, match="not live; open the simulation with this value"):
            simulation.set("cloth.mass", 1.0)
        with pytest.raises(SceneError, match=r"unknown key \(did you mean mass"):
            simulation.set("cloth.masss", 1.0)
    with open_simulation(scene, live=("poke",)) as simulation, pytest.raises(SceneError, match="3 finite numbers"):
        simulation.poke(3, (0.0, 1.0))
    with open_simulation("lab-grid") as simulation, pytest.raises(SceneError, match="normal"):
        simulation.read("normal")
