"""The judge is judged first: known answers, energy gradients, closed forms, published control values."""

import ast
from pathlib import Path

import numpy as np
import pytest

from softlab.bench.reference import cache
from softlab.bench.reference import mass_spring as reference
from softlab.bench.reference.philox import philox4x32, random_directions
from softlab.model.core.energy import energies
from softlab.model.scene.scene import Scene, load_scene

# Gauss-Seidel is judged in the same order: which edges and hinges a mesh has, at which lengths, and their greedy colours have
# tests of their own (test_mesh_edges.py, test_colouring.py, test_bending.py). So have the clusters of shape matching: which
# masses, in which shares (test_matching.py, test_soft_body.py); their goals here are by singular values, as no kernel's are.
# Of a mesh collider the triangles are shared, not their tree; of a distance field the samples, not what lies between them.
SHARED = {
    "xpbd_mesh.py": {
        "softlab.model.position_based.mesh_constraints",
        "softlab.model.geometry.topology",
        "softlab.model.core.build",
    },
    "tetrahedra_newton.py": {"softlab.model.particles.tetrahedra_set"},
    "self_contacts.py": {"softlab.model.tables.self_collision"},
    "shape_matching.py": {"softlab.model.assets.clusters", "softlab.model.shape_matching.matching"},
    "cluster_material.py": {"softlab.model.assets.clusters"},
    "cloth.py": {  # what a scene says of colliders
        "softlab.model.tables.cloth",
        "softlab.model.tables.colliders.mesh_collider",
        "softlab.model.tables.colliders.distance_field",
    },
    "steps.py": {"softlab.model.base.pins"},  # the type of what a scene says of pins
    "mesh_collider.py": {"softlab.model.tables.colliders.mesh_collider"},
    "distance_field.py": {"softlab.model.tables.colliders.distance_field"},
    "surface_contacts.py": {"softlab.model.contact.attachments"},  # who is tied to whom
    "tetrahedra_cloth.py": {
        "softlab.model.contact.attachments",
        "softlab.model.tetrahedra.constraints",
    },  # and in which order of colours
    "fluid.py": {"softlab.model.fluid.measure"},  # who is near to whom, by a k-d tree, which no solver asks
    "fluid_world.py": {
        "softlab.model.geometry.particle_row",
        "softlab.model.tables.cloth",
        "softlab.model.tables.colliders.mesh_collider",
        "softlab.model.tables.colliders.distance_field",
    },
    "fluid_solids.py": {"softlab.model.fluid.samples"},  # where they lie
    "world.py": {  # triangles, who is tied to whom, who meets whom, what is sampled
        "softlab.model.contact.attachments",
        "softlab.model.world.plan",
        "softlab.model.world.solids",
    },
}


def test_independent_of_what_it_judges():
    """It imports neither the formulas nor the arrays' builder nor a backend: a mistake must be made twice to pass."""
    for file in Path(reference.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            for name in names:
                if name.split(".")[0] == "softlab":
                    allowed = {
                        "softlab.model.scene.scene",
                        "softlab.model.base.errors",
                        "softlab.model.base.disk_cache",
                        *SHARED.get(file.name, ()),
                    }
                    assert name.startswith("softlab.bench.reference") or name in allowed, (file, name)


@pytest.mark.parametrize(
    ("counter", "key", "words"),
    [
        ([0] * 4, (0, 0), "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
        ([0xFFFFFFFF] * 4, (0xFFFFFFFF, 0xFFFFFFFF), "408f276d 41c83b0e a20bc7c6 6d5451fd"),
        (
            [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
            (0xA4093822, 0x299F31D0),
            "d16cfe09 94fdcceb 5001e420 24126ea1",
        ),
    ],
)
def test_philox_known_answers(counter, key, words):
    """The known-answer vectors of Random123 (D. E. Shaw Research), file kat_vectors, philox4x32 10."""
    assert " ".join(f"{int(word):08x}" for word in philox4x32(np.array(counter), key)) == words


def test_random_directions_are_uniform():
    """Mean 0 and variance 1/3 of uniform (-1, 1), each within 5 standard errors; axes and steps uncorrelated."""
    n = 40_000
    a, b = random_directions(3, 10, n), random_directions(3, 11, n)
    assert np.abs(a).max() < 1
    assert np.abs(a.mean(axis=0)).max() < 5 * np.sqrt(1 / 3 / n)
    assert np.abs((a**2).mean(axis=0) - 1 / 3).max() < 5 * np.sqrt(4 / 45 / n)
    for pair in ((a[:, 0], a[:, 1]), (a[:, 0], b[:, 0])):
        assert abs(np.corrcoef(*pair)[0, 1]) < 5 / np.sqrt(n)


def test_forces_are_minus_the_energys_gradient():
    """F = -dE/dp by central differences of model/core/energy.py (another author's formula): truncation ~ h^2 E''' / 6."""
    scene = load_scene("lab-hammock").replace({"grid.rows": 4, "grid.columns": 5})
    position, velocity = reference.start(scene)
    force = reference.spring_forces(scene, position.reshape(4, 5, 2)).reshape(-1, 2)
    force[:, 1] -= scene.grid.mass * scene.gravity.acceleration
    h = 1e-5
    for particle, axis in [(0, 0), (7, 1), (12, 0), (19, 1)]:
        ends = []
        for sign in (1, -1):
            moved = position.copy()
            moved[particle, axis] += sign * h
            ends.append(energies(scene, moved, velocity)["potential"])
        assert force[particle, axis] == pytest.approx(-(ends[0] - ends[1]) / (2 * h), abs=1e-8)


PENDULUM = {"springs": {}, "gravity": {}, "method": {"integrator": "rk4", "dt": 1 / 400}}
DOP853 = {  # docs/method/cases.md A6: elastic pendulum from (0.6, -0.9) at rest, T = 1, by an order-8 integrator to 2e-14
    (0.0, 1.0): (-0.596183852986, -0.898957849069),
    (0.03, 1.0): (-0.087108010821, -1.022365327709),
    (0.0, 2.0): (-0.305973032169, -0.894087872796),
    (0.03, 2.0): (-0.031319545471, -0.977372662787),
}


@pytest.mark.parametrize(("damping", "inertia"), DOP853)
def test_rk4_with_richardson_reaches_another_integrators_answer(damping, inertia):
    """RK4 at h, h/2 removes the h^4 term: what is left is O(h^5), here under 1e-11 at h = 1/3200 (rk4: 5e-11)."""
    scene = Scene(PENDULUM | {"grid": {"rows": 2, "columns": 1, "pinned": "top"}, "damping": {"coefficient": damping}})
    ends = []
    for steps in (3200, 6400):
        refined = scene.replace({"method.dt": 1 / steps})
        ends.append(reference.simulate(refined, steps, [[0, 0], [0.6, -0.9]], np.zeros((2, 2)), inertia=inertia)[0][1])
    assert ends[1] + (ends[1] - ends[0]) / 15 == pytest.approx(DOP853[damping, inertia], abs=1e-11)


@pytest.mark.parametrize(
    ("name", "total", "corner", "middle"),
    [
        ("lab-curtain", (15872.01274624, -18183.98254505), (-0.0027886611, -34.3919787), (15.99844527, -18.60855794)),
        ("lab-hammock", (15871.99440841, -19584.838461), (0.03758698, -34.42557982), (16.00178375, -19.82948522)),
    ],
)
def test_control_values_of_the_accuracy_scenes(name, total, corner, middle):
    """docs/method/cases.md C, scenes S1 and S2 at 1.5 s: sum of positions, mass [31, 0], mass [16, 16]; to 8 digits."""
    position, _, estimate = reference.converged(load_scene(name), 1.5, tolerance=1e-8)
    assert estimate < 1e-8
    assert position.sum(axis=0) == pytest.approx(total, abs=1e-5)  # 1024 terms of 1e-8
    assert position[31 * 32] == pytest.approx(corner, abs=1e-7)
    assert position[16 * 32 + 16] == pytest.approx(middle, abs=1e-7)


def test_the_error_estimate_is_honest():
    """Against a ten times tighter solution, the error is under the estimate (which is that before extrapolation)."""
    scene = load_scene("lab-curtain").replace({"grid.rows": 8, "grid.columns": 8})
    rough, _, estimate = reference.converged(scene, 0.5, tolerance=1e-6)
    fine, _, _ = reference.converged(scene, 0.5, tolerance=1e-11)
    assert np.hypot(*(rough - fine).T).max() < estimate < 1e-6


def test_first_bad_counts_steps_done():
    """Free fall 4.905 t^2 (vv is exact) passes 1000 m at t = 14.28 s: step 143 of dt = 0.1 is the first beyond."""
    scene = Scene({"grid": {"rows": 1, "columns": 2}, "gravity": {}, "method": {"dt": 0.1}})
    assert reference.first_diverged(scene, 200, 1000.0) == (143, 0)
    assert reference.first_diverged(scene, 100, 1000.0) is None


def test_kept_references_are_those_of_all_their_sources(tmp_path, monkeypatch):
    """Another line, another name, a file more, in the folder or below it: another key. What is no source changes nothing."""
    (tmp_path / "below").mkdir()
    (tmp_path / "one.py").write_text("a = 1")
    (tmp_path / "below" / "two.py").write_text("b = 2")
    read = cache.sources.__wrapped__
    monkeypatch.setattr(cache, "sources", lambda: read(tmp_path))

    def key() -> str:
        return cache.key(load_scene("lab-curtain"), 1.0, 1.0, 1e-9)

    seen = [key()]
    (tmp_path / "notes.txt").write_text("no source")
    assert key() == seen[-1]
    (tmp_path / "one.py").write_text("a = 2")
    seen.append(key())
    (tmp_path / "below" / "two.py").write_text("b = 3")
    seen.append(key())
    (tmp_path / "below" / "two.py").rename(tmp_path / "below" / "three.py")
    seen.append(key())
    (tmp_path / "below" / "four.py").touch()
    seen.append(key())
    assert len(set(seen)) == len(seen)
    assert {b"richardson.py", b"cache.py"} <= set(read().split(b"\0"))


def test_a_kept_reference_is_of_its_scene_time_and_tolerance():
    """But not of the method, which the reference does not use."""
    scene = load_scene("lab-curtain")
    first = cache.key(scene, 1.0, 1.0, 1e-9)
    assert cache.key(scene.replace({"method.dt": 0.002, "method.integrator": "rk4"}), 1.0, 1.0, 1e-9) == first
    others = [
        cache.key(scene.replace({"springs.stiffness": 11.0}), 1.0, 1.0, 1e-9),
        cache.key(scene, 1.5, 1.0, 1e-9),
        cache.key(scene, 1.0, 2.0, 1e-9),
        cache.key(scene, 1.0, 1.0, 1e-8),
    ]
    assert len({first, *others}) == 5
