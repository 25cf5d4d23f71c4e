"""What does not fit, reaches nobody, or cannot move: refused with the field and the reason before anything is allocated."""

from __future__ import annotations

import inspect
import json
import os
import subprocess
import sys
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from softlab import cli
from softlab.model.assets.soft_body import SoftBody
from softlab.model.base import memory
from softlab.model.base.errors import InputError, SceneError
from softlab.model.core import build as build_module
from softlab.model.core.build import build
from softlab.model.geometry.shapes import Shape
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.tables.particle_contact import Contact
from softlab.model.tables.self_collision import CONTACT_BYTES, SelfCollision

STAR = Shape(name="star").mesh()
BOX = Shape(name="box").mesh()
SELF = {"self_collision": {}, "structural": {}, "method": {"solver": "xpbd"}}


def cloth(rows: int, columns: int) -> Scene:
    return Scene({"cloth": {"rows": rows, "columns": columns}, **SELF})


def command(monkeypatch: pytest.MonkeyPatch, *words: str) -> Any:
    monkeypatch.setattr(sys, "argv", ["softlab", *words])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code


# ---------------------------------------------------------------------- memory


@pytest.mark.parametrize("tables", [
    {"grid": {"rows": 10**9, "columns": 2}, "springs": {}},
    {"grid": {"rows": 10**9, "columns": 3, "pinned": "top"}, "springs": {}},
    {"cloth": {"rows": 10**6, "columns": 10**6}, **SELF},
    {"cloth": {"rows": 10**9, "columns": 9}, "shear": {}, "bending": {}},
])  # fmt: skip
def test_a_plan_needs_no_array_of_the_grid(
    tables: dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    scene = Scene(tables)
    file = tmp_path / "large.toml"
    from softlab.app.command.scene_file import scene_toml

    file.write_text(scene_toml(scene))
    command(monkeypatch, "plan", str(file), "--json")  # what it imports is loaded
    capsys.readouterr()
    tracemalloc.start()
    assert command(monkeypatch, "plan", str(file), "--json") == 0
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**26  # one byte a mass would be more
    told = json.loads(capsys.readouterr().out)
    rows, columns = scene.grid.rows, scene.grid.columns
    assert told["particles"] == rows * columns
    if "grid" in tables:
        assert told["springs"] == rows * (columns - 1) + (rows - 1) * columns
    elif "shear" in tables:
        assert told["springs"] == 2 * (rows - 1) * (columns - 1) + rows * (columns - 2) + (rows - 2) * columns
    else:
        assert told["springs"] == 2 * 10**12 - 2 * 10**6


def test_a_cloth_with_contacts_is_refused_by_what_they_take(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where its masses alone would fit."""
    count = 1000 * 1000
    monkeypatch.setattr(memory, "available_bytes", lambda: 2 * count * build_module.MASS_BYTES)
    with pytest.raises(SceneError, match=r"cloth\.rows x cloth\.columns = '1000 x 1000': needs .*iB of main memory"):
        build(cloth(1000, 1000))


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_what_contacts_take_is_what_is_looked_for(real: type, monkeypatch: pytest.MonkeyPatch) -> None:
    from softlab.cpu_backend.contact import self_contact as contacts

    for kernels in ("make_find", "make_project"):
        monkeypatch.setattr(contacts, kernels, lambda *_: None)
    scene = cloth(90, 110)
    body = build(scene)
    tracemalloc.start()
    kept = contacts.Contacts(scene, body, real, "exact", 4, np.ones(9900))
    taken = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert kept.lost == 0
    assert CONTACT_BYTES * 9900 * (0.9 if real is np.float64 else 0.5) < taken < CONTACT_BYTES * 9900


def test_bodies_beyond_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("softlab.model.particles.body_set.available_bytes", lambda: 2**30)
    body = {"kind": "soft_body", "shape": {"name": "box"}, "particle_spacing": 0.5, "copies": [100, 100, 100]}
    with pytest.raises(SceneError, match=r"copies = 8000000: needs .*iB of main memory"):
        Scene({"b": body}).body_set  # noqa: B018


def test_no_memory_for_the_bandwidth(monkeypatch: pytest.MonkeyPatch) -> None:
    from softlab.bench.measure import machine

    def none(_: int) -> float:
        raise MemoryError

    monkeypatch.setattr(machine, "copy_bandwidth", none)
    monkeypatch.setattr(machine, "region_costs", lambda: {"1": 1e-6})
    monkeypatch.setattr(machine, "_gpu_limits", dict)
    limits = inspect.unwrap(machine.measured_limits)()  # not what tests/conftest.py has measured once
    assert limits["copy_bandwidth"] is None and limits["region_seconds"] == {"1": 1e-6}


def test_no_memory_at_all_is_a_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    def none(*_: object) -> None:
        raise MemoryError("Unable to allocate 3 TiB")

    monkeypatch.setattr("softlab.app.plan.report.plan_report", none)
    assert command(monkeypatch, "plan", "lab-grid") == 2
    assert "Unable to allocate 3 TiB" in capsys.readouterr().err


@pytest.mark.parametrize("path", ["method.iterations", "method.substeps"])
def test_rounds_of_a_step_end(path: str) -> None:
    """Nothing can interrupt a step: 2^63 - 1 sweeps over two masses would take ten thousand years."""
    scene = load_scene("rope").replace({"method.solver": "xpbd"})
    for most in (2**63 - 1, 10**6 + 1):
        with pytest.raises(SceneError, match=f"{path} = {most}: must be at most 1000000"):
            scene.replace({path: most})
    assert scene.replace({path: 10**6}).canonical()
    with pytest.raises(SceneError, match="more than 1000000 a step"):
        scene.replace({"method.iterations": 10**4, "method.substeps": 101})
    for part in (SelfCollision, Contact):
        with pytest.raises(ValueError, match="less than or equal to 1000"):
            part(sweeps=1001)


# ---------------------------------------------------------------------- bodies


@pytest.mark.parametrize("fields", [
    {"volume_sampling": 1.0}, {"volume_sampling": 4.0}, {"surface_sampling": 1.0}, {"surface_sampling": 16.0},
    {"cluster_spacing": 0.3}, {"cluster_radius": 0.35}, {"link_radius": 0.15, "link_stiffness": 1.0},
], ids=str)  # fmt: skip
def test_every_field_of_a_body_acts(fields: dict[str, float]) -> None:
    plain, other = (SoftBody.from_mesh(STAR, particle_spacing=0.1, **given) for given in ({}, fields))
    assert len(plain.position) == len(other.position) or "sampling" in str(fields)
    same = all(
        np.array_equal(a, b)
        for a, b in (
            (plain.position, other.position), (plain.clusters.indices, other.clusters.indices), (plain.links, other.links),
        )
    )  # fmt: skip
    assert not same
    assert not [line for line in other.report.notes if "adds no particle" in line]


@pytest.mark.parametrize("fields", [{"volume_sampling": 3.0}, {"surface_sampling": 9.0}], ids=str)
def test_sampling_that_finds_no_room_says_so(fields: dict[str, float]) -> None:
    """A box on the lattice is full: nothing can be added, inside or on it."""
    (name, value), plain = *fields.items(), SoftBody.from_mesh(BOX, particle_spacing=0.25)
    found = SoftBody.from_mesh(BOX, particle_spacing=0.25, **fields)
    assert np.array_equal(found.position, plain.position)
    assert [f"{name} = {value:g} adds no particle" in line for line in found.report.notes] == [True]
    assert plain.report.notes == ()


def test_links_that_reach_nobody() -> None:
    with pytest.raises(SceneError, match=r"link_radius = 0\.05: links no particles.*try 0\.15") as refused:
        SoftBody.from_mesh(STAR, particle_spacing=0.1, link_radius=0.05, link_stiffness=1.0)
    assert refused.value.field == "link_radius"
    assert len(SoftBody.from_mesh(STAR, particle_spacing=0.1, link_radius=0.15, link_stiffness=1.0).links)


def test_what_slept_stays() -> None:
    """`contact.sleeping_speed`, in the reference that the kernels are held against."""
    from softlab.bench.reference.contact.particle_contacts import Contacts

    scene = Scene({
        "b": {"kind": "soft_body", "shape": {"name": "box"}, "particle_spacing": 0.5}, "contact": {"sleeping_speed": 0.5},
        "method": {"solver": "shape-matching", "dt": 0.01},
    })  # fmt: skip
    before = scene.body_set.position
    way = np.where(np.arange(len(before))[:, None] % 2 == 0, 0.002, 0.003) * np.array([1.0, 0, 0])  # 0.2 and 0.3 m/s
    way[-1] = 0.006, 0, 0
    now = Contacts(scene).ended(before, before + way)
    assert np.array_equal(now[:-1], before[:-1]) and np.array_equal(now[-1], before[-1] + way[-1])


def test_pairs_end() -> None:
    from softlab.model.geometry import neighbours as nearby

    points = np.random.default_rng(1).random((300, 3))
    nearby.MAX_PAIRS, kept = 1000, nearby.MAX_PAIRS
    try:
        with pytest.raises(InputError, match=r"more than 1000 pairs .* within 1 m"):
            nearby.pairs_within(points, points, 1.0)
    finally:
        nearby.MAX_PAIRS = kept
    assert len(nearby.pairs_within(points, points, 1.0)[0]) > 1000


@pytest.mark.parametrize("words", [
    ["sweep", "--backend", "tpu"], ["sweep", "--size", "0"], ["accuracy", "--scene", "none"],
    ["stability", "--integrator", "none"],
    ["hard", "--case", "none"], ["projections", "--size", "0"], ["throughput", "--kind", "none"], ["bar", "--backend", "tpu"],
    ["advise", "lab-grid", "--error", "-1"], ["ablate", "none"], ["merge", "none.csv"],
], ids=lambda words: words[0])  # fmt: skip
def test_options_are_looked_at_before_a_store_is_made(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    for store in ([], ["--store", "an odd?name"]):
        assert command(monkeypatch, *words, *store) == 2
    assert list(tmp_path.iterdir()) == []
    assert capsys.readouterr().err.count("softlab: ") == 2


# ---------------------------------------------------------------------- what is printed


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a full disk as a file: Linux has one")
def test_a_full_standard_output_is_a_line() -> None:
    folder = Path(cli.__file__).parents[1]
    environment = os.environ | {"PYTHONPATH": str(folder)}
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "softlab", "plan", "rope", "--json"],
            stdout=full, stderr=subprocess.PIPE, cwd=folder, text=True, env=environment, check=False,
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == "softlab: the output cannot be written: No space left on device; free some disk space\n"


@pytest.mark.parametrize(
    "words",
    [["run", "--stepz", "3"], ["run", "rope", "--steps", "x" * 20_000], ["x" * 20_000], ["run", "--" + "x" * 20_000]],
)
def test_complaints_about_the_command_line_are_lines(
    words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    assert command(monkeypatch, *words) == 2
    told = capsys.readouterr().err
    assert told.startswith("softlab: ") and told.count("\n") == 1 and len(told) < 600
