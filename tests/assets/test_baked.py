"""Bodies kept on disk: the same bits, found by what made them, and never worse than making them again."""

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest
from closed_meshes import ball, box
from test_mesh import binary_stl, write

import softlab.model.assets.baked
import softlab.model.base.disk_cache
from softlab.model.assets.baked import PACKAGES, baked, body_key
from softlab.model.assets.baked_body import BakedBody
from softlab.model.assets.soft_body import MATERIAL, RigidBody, SoftBody
from softlab.model.base.digest import ROOT
from softlab.model.base.disk_cache import cache_folder, read_arrays, write_arrays
from softlab.model.base.errors import InputError, SceneError
from softlab.model.geometry.mesh import TriangleMesh, triangle_mesh
from softlab.model.geometry.shapes import Shape

PARAMETERS = SoftBody(particle_spacing=0.2, link_radius=0.25, link_stiffness=10.0)
BEAM = Shape(name="beam", resolution=8)


def assert_same_bits(one, other) -> None:
    """Everything in it, by fields: arrays by their bytes and types."""
    assert type(one) is type(other)
    if isinstance(one, np.ndarray):
        assert (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    elif dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            assert_same_bits(getattr(one, field.name), getattr(other, field.name))
    else:
        assert one == other


@pytest.fixture
def bakes(monkeypatch) -> list[int]:
    """Grows by one for every body that is made."""
    made: list[int] = []
    for kind in (SoftBody, RigidBody):
        real = kind.bake

        def counted(self, mesh, real=real):
            made.append(1)
            return real(self, mesh)

        monkeypatch.setattr(kind, "bake", counted)
    return made


def files(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


@pytest.mark.parametrize("parameters", [PARAMETERS, RigidBody(particle_spacing=0.3, mass=2.0)])
def test_the_same_bits(tmp_path, bakes, parameters):
    made = baked(parameters, BEAM, folder=tmp_path)
    loaded = baked(parameters, BEAM, folder=tmp_path)
    assert len(bakes) == 1
    assert files(tmp_path) == [f"body-{body_key(parameters, BEAM)}.npz"]
    assert isinstance(loaded, BakedBody)
    assert_same_bits(made, loaded)
    assert_same_bits(made, parameters.bake(BEAM.mesh()))
    assert made.report.lines() == loaded.report.lines()


def test_every_source_of_a_mesh(tmp_path, bakes):
    stl = write(tmp_path, "ball.stl", binary_stl(*ball()))
    folder = tmp_path / "kept"
    for mesh in (stl, str(stl), ball(), triangle_mesh(*ball()), BEAM):
        before = len(bakes)
        first, second = (baked(PARAMETERS, mesh, folder=folder) for _ in range(2))
        assert_same_bits(first, second)
        known = isinstance(mesh, TriangleMesh) or mesh == str(stl)  # there was nothing to mend
        assert len(bakes) - before == (0 if known else 1)
    doubled = baked(PARAMETERS, stl, scale=2.0, folder=folder)
    assert np.allclose(np.ptp(doubled.skin.position, axis=0), 2.0)


def test_what_differs_is_made_anew(tmp_path):
    """Each field, the kind of body, the mesh, the code."""
    keys = [body_key(PARAMETERS, BEAM)]
    for name, value in {
        "particle_spacing": 0.21,
        "volume_sampling": 1.0,
        "surface_sampling": 3.0,
        "density": 999.0,
        "mass": 5.0,
        "cluster_spacing": 0.5,
        "cluster_radius": 0.7,
        "cluster_stiffness": 1.0,
        "link_radius": 0.3,
        "link_stiffness": 11.0,
        "fill_holes": True,
    }.items():
        fields = PARAMETERS.model_dump() | {name: value}
        if name == "mass":
            del fields["density"]
        keys.append(body_key(SoftBody(**fields), BEAM))
    assert len(keys) == 1 + len(SoftBody.model_fields) - len(MATERIAL)  # which no mesh has a say in
    keys += [body_key(PARAMETERS, Shape(name="beam", resolution=9)), body_key(PARAMETERS, Shape(name="star"))]
    plain = RigidBody(particle_spacing=0.2)
    keys += [body_key(plain, BEAM), body_key(SoftBody(particle_spacing=0.2), BEAM)]
    position, triangles = box()
    for mesh in ((position, triangles), (position, triangles[::-1]), (position + 1, triangles)):
        keys.append(body_key(plain, mesh))
    one = write(tmp_path, "a.stl", binary_stl(*ball()))
    keys += [body_key(plain, one), body_key(plain, one, scale=2.0)]
    write(tmp_path, "a.stl", binary_stl(*box()))
    keys.append(body_key(plain, one))
    assert len(set(keys)) == len(keys)


def test_other_code_makes_other_bodies(monkeypatch):
    key = body_key(PARAMETERS, BEAM)
    monkeypatch.setattr(softlab.model.assets.baked, "VERSION", softlab.model.assets.baked.VERSION + 1)
    assert body_key(PARAMETERS, BEAM) != key
    monkeypatch.undo()
    monkeypatch.setattr(softlab.model.assets.baked, "_sources", lambda: "other")
    assert body_key(PARAMETERS, BEAM) != key


@pytest.mark.parametrize("kind", [SoftBody, RigidBody])
def test_what_does_nothing_is_told_once(kind, tmp_path):
    """Made, read, or made without a file: each sentence stands once."""
    parameters, box = (
        kind(particle_spacing=0.25, volume_sampling=1.5, surface_sampling=3.0),
        Shape(name="box", resolution=4),
    )
    for keep in (True, True, False):
        told = baked(parameters, box, folder=tmp_path, use_cache=keep).report.notes
        assert [sentence.split()[0] for sentence in told] == ["volume_sampling", "surface_sampling"]


def test_the_rooms_are_those_that_bake():
    """What baking a body imports of the lab, but for what only describes scenes and errors."""
    import ast

    described = {"base", "tables", "formulas"}  # rooms: kept, checked, computed elsewhere
    found, waiting = (
        set(),
        [f"assets/{name}" for name in ("baked", "soft_lattice", "soft_sheet")],
    )  # classes of parameters
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        found.add(name)
        for node in ast.walk(ast.parse((ROOT / "model" / f"{name}.py").read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("softlab.model."):
                module = node.module.removeprefix("softlab.model.").replace(".", "/")
                if module.split("/")[0] not in described:
                    waiting.append(module)
    assert {name.split("/")[0] for name in found} == set(PACKAGES)


def test_damaged_files_are_made_anew(tmp_path, bakes):
    """Cut short anywhere, any byte changed, emptied, another body under its name: the body is right, and so is the file
    afterwards. Of bytes, those that the archive's checksums do not cover are looked at by name and shape."""
    parameters = RigidBody(particle_spacing=0.5)
    made = baked(parameters, BEAM, folder=tmp_path)
    file = tmp_path / files(tmp_path)[0]
    whole = file.read_bytes()
    baked(PARAMETERS, BEAM, folder=tmp_path)
    other = (tmp_path / f"body-{body_key(PARAMETERS, BEAM)}.npz").read_bytes()
    cut = [whole[: int(part * len(whole))] for part in (0, 0.01, 0.3, 0.7, 0.99, 0.999)]
    bent = [whole[:k] + bytes([whole[k] ^ 0x41]) + whole[k + 1 :] for k in range(0, len(whole), 97)]
    for damaged in [*cut, b"nonsense", other]:
        file.write_bytes(damaged)
        bakes.clear()
        assert_same_bits(baked(parameters, BEAM, folder=tmp_path), made)
        assert len(bakes) == 1
        assert_same_bits(baked(parameters, BEAM, folder=tmp_path), made)
        assert len(bakes) == 1
    for damaged in bent:
        file.write_bytes(damaged)
        assert_same_bits(baked(parameters, BEAM, folder=tmp_path), made)
    assert not [name for name in files(tmp_path) if name.endswith(".tmp")]


def test_a_file_of_other_arrays_is_no_body(tmp_path, bakes):
    """As an older or a newer lab might have left under the same name."""
    made = baked(PARAMETERS, BEAM, folder=tmp_path)
    file = tmp_path / files(tmp_path)[0]
    held = read_arrays(file)
    changes = [
        {"offsets": held["offsets"] + 1},
        {"coefficients": held["coefficients"] * 2},
        {"mass": held["mass"][1:]},
        {"links": held["links"][1:]},
        {"skin_weights": held["skin_weights"][:, :3]},
        {"report": np.array("{}")},
        {"report": np.array("no json")},
        {"key": np.array("0" * 32)},
    ]
    for change in [*changes, *({name: None} for name in held)]:
        write_arrays(file, {name: value for name, value in {**held, **change}.items() if value is not None})
        bakes.clear()
        assert_same_bits(baked(PARAMETERS, BEAM, folder=tmp_path), made)
        assert len(bakes) == 1


def test_a_body_without_a_place_to_be_kept(tmp_path, bakes):
    occupied = tmp_path / "file"
    occupied.write_text("in the way")
    for _ in range(2):
        baked(PARAMETERS, BEAM, folder=occupied)
    assert len(bakes) == 2
    baked(PARAMETERS, BEAM, folder=tmp_path / "new", use_cache=False)
    assert files(tmp_path) == ["file"]


def test_a_kill_leaves_no_half_of_a_file(tmp_path, monkeypatch):
    """Killed between writing and renaming: nothing under the body's name."""

    def killed(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", killed)
    with pytest.raises(KeyboardInterrupt):
        baked(PARAMETERS, BEAM, folder=tmp_path)
    assert not [name for name in files(tmp_path) if name.endswith(".npz")]


def test_bad_input_is_not_kept(tmp_path):
    with pytest.raises(SceneError, match="larger than the mesh"):
        baked(RigidBody(particle_spacing=5.0), BEAM, folder=tmp_path)
    with pytest.raises(InputError, match=r"gone\.obj cannot be read: No such file"):
        baked(PARAMETERS, tmp_path / "gone.obj", folder=tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        baked(PARAMETERS, tmp_path, folder=tmp_path)
    assert files(tmp_path) == []


def test_the_users_cache(tmp_path, monkeypatch):
    cache_folder.cache_clear()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder("bodies") == tmp_path / "softlab" / "bodies"
    baked(PARAMETERS, BEAM)
    assert len(files(tmp_path / "softlab" / "bodies")) == 1
    cache_folder.cache_clear()
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    private = cache_folder("bodies")
    assert private.is_dir()
    assert private == cache_folder("bodies")
    if os.name == "posix":
        assert private.stat().st_mode & 0o077 == 0
    cache_folder.cache_clear()
