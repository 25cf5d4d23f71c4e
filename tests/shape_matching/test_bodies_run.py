"""What the command line says of bodies: runs, energies, plans, the list of scenes, and scene files."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies_scenes import BEAM, METHOD, TORUS, beams_and_torus
from fake_cloth import FakeCloth
from rich.console import Console
from test_cli import KEYS, command  # noqa: F401  # a fixture

from softlab.app.command.run_parts import body_lines
from softlab.app.command.scene_file import scene_toml
from softlab.app.command.tables import number, print_scenes
from softlab.app.plan.report import plan_report
from softlab.app.plan.table import print_plan
from softlab.model.base.errors import SoftlabError
from softlab.model.core.build import masses
from softlab.model.core.energy import energies, spring_strain
from softlab.model.formulas.shape_matching import cluster
from softlab.model.scene.reader import catalogue
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.shape_matching.energy import window_energy
from softlab.model.shape_matching.matching import lattice_clusters

SCENE = beams_and_torus()
BODY_SET = SCENE.body_set
RANDOM = np.random.default_rng(8)


# ---------------------------------------------------------------------- energies and strain


def test_the_energies_of_bodies_are_those_of_their_particles_and_clusters() -> None:
    position = BODY_SET.position + RANDOM.normal(0, 0.02, BODY_SET.position.shape)
    velocity = RANDOM.normal(0, 1, position.shape)
    found, mass = energies(SCENE, position, velocity), BODY_SET.clusters.mass
    assert found["kinetic"] == pytest.approx(0.5 * np.sum(mass * np.sum(velocity**2, axis=1)), rel=1e-12)
    assert found["gravity"] == pytest.approx(9.81 * np.sum(mass * position[:, 1]), rel=1e-12)
    assert found["spring"] == BODY_SET.clusters.energy(position) > 0
    assert found["potential"] == found["spring"] + found["gravity"]
    assert found["conserved"] == found["total"] == found["kinetic"] + found["potential"]
    assert np.shape(masses(SCENE)) == (BODY_SET.particle_count, 1)


def test_a_body_that_moves_as_a_whole_stores_nothing_and_is_not_strained() -> None:
    position = BODY_SET.position + np.array([3.0, -1.0, 2.0])
    assert energies(SCENE, position, np.zeros_like(position))["spring"] < 1e-20
    assert np.abs(spring_strain(SCENE, position)).max() < 1e-12


def test_the_strain_of_bodies_is_the_way_to_their_goals_over_their_own_spacing() -> None:
    """Of one cluster that grows by a tenth about its centre, a tenth of each rest offset; a soft body's is told of each of a
    particle's clusters."""
    position = BODY_SET.position.copy()
    own = BODY_SET.body == 2
    centre = np.average(position[own], axis=0, weights=BODY_SET.clusters.mass[own])
    position[own] += 0.1 * (position[own] - centre)
    strain, entries = spring_strain(SCENE, position), own[BODY_SET.clusters.indices]
    assert len(strain) == len(BODY_SET.clusters.indices)
    offsets = np.linalg.norm(BODY_SET.clusters.rest[entries], axis=1)
    np.testing.assert_allclose(strain[entries], 0.1 * offsets / TORUS["particle_spacing"], atol=1e-9)
    assert np.abs(strain[~entries]).max() < 1e-12
    position[0, 0] = np.nan
    assert np.isnan(spring_strain(SCENE, position)).all()


@pytest.mark.parametrize(("rows", "columns", "region"), [(1, 1, 1), (1, 6, 2), (7, 9, 1), (7, 9, 3), (4, 20, 8)])
def test_the_energy_of_a_grids_clusters_needs_no_indices(rows: int, columns: int, region: int) -> None:
    changes = {"grid.rows": rows, "grid.columns": columns, "method.region": region, "grid.pinned": "none"}
    scene = load_scene("jelly-grid").replace(changes)
    clusters = lattice_clusters(scene)
    position = clusters.position + RANDOM.normal(0, 0.2, clusters.position.shape) + 50
    # sums of some hundred terms, of positions known to 50 eps
    assert window_energy(scene, position) == pytest.approx(clusters.energy(position), rel=1e-11, abs=1e-20)
    assert energies(scene, position, np.zeros_like(position))["spring"] == window_energy(scene, position)


# ---------------------------------------------------------------------- the command line


@pytest.fixture
def falling(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs without a solver: particles fall, each by itself."""

    def open_it(scene: Scene, backend: str, **options: Any) -> FakeCloth:
        return FakeCloth(scene)

    monkeypatch.setattr("softlab.app.command.run.open_simulation", open_it)


@pytest.fixture
def bodies_file(tmp_path: Any) -> str:
    path = tmp_path / "bodies.toml"
    path.write_text(scene_toml(SCENE), encoding="utf-8")
    return str(path)


@pytest.mark.usefixtures("falling")
def test_a_run_has_every_field_and_says_why_there_is_no_error(command: Any, bodies_file: str) -> None:  # noqa: F811
    done = command(f"run {bodies_file} --steps 3 --json")
    assert done.status == 0, done.err
    report = json.loads(done.out)
    assert set(KEYS) < set(report)
    assert report["error"] is None and "no converged reference" in report["error_reason"]
    assert {name for name in KEYS if report[name] is None} == {"error", "threads_reason", "resolution"}
    assert (report["particles"], report["bodies"], report["clusters"]) == (
        BODY_SET.particle_count, 3, BODY_SET.clusters.count,
    )  # fmt: skip
    assert report["dimensions"] == 3 and report["max_strain"] < 1e-5  # all fall alike
    for line in body_lines(SCENE):
        assert line in done.err
    assert report["waiting"] == report["waiting_particles"] == 0 and "waiting" not in command(f"run {bodies_file}").out
    table = command(f"run {bodies_file} --steps 3").out
    assert "spacings, distance from goal" in table and "no converged reference" in table


@pytest.mark.usefixtures("falling")
def test_what_waits_is_counted_apart(command: Any, tmp_path: Path) -> None:  # noqa: F811
    spare = beams_and_torus(torus=TORUS | {"spare": 2})
    file, ring = tmp_path / "spare.toml", len(spare.bodies["torus"].baked.position)
    file.write_text(scene_toml(spare), encoding="utf-8")
    report = json.loads(command(f"run {file} --steps 300 --json").out)
    assert (report["particles"], report["bodies"]) == (BODY_SET.particle_count, 3)
    assert (report["waiting_particles"], report["waiting"]) == (2 * ring, 2)
    assert report["clusters"] == BODY_SET.clusters.count
    rate = BODY_SET.particle_count * report["steps"] / report["seconds"]
    assert report["particle_steps_per_second"] == pytest.approx(rate, rel=1e-12)
    table = command(f"run {file} --steps 3").out
    assert f"{number(BODY_SET.particle_count)} + {number(2 * ring)} inactive" in table and "3 + 2 inactive" in table


def test_each_body_is_told_of_once_for_all_its_copies() -> None:
    lines = body_lines(SCENE)
    beam, torus = (part.baked.report.lines() for part in SCENE.bodies.values())
    assert lines == [f"beam (x 2): {line}" for line in beam] + [f"torus: {line}" for line in torus]
    assert body_lines(load_scene("lab-grid")) == []


def test_the_catalogue_lists_bodies_by_their_particles(command: Any, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    monkeypatch.setattr("softlab.app.command.tables.catalogue", lambda: {"bodies": None})
    monkeypatch.setattr("softlab.app.command.tables.load_scene", lambda name: SCENE)
    out = command("scenes").out
    assert str(BODY_SET.particle_count) in out and "shape-matching" in out and "1 x" not in out
    spare = beams_and_torus(torus=TORUS | {"spare": 2})
    monkeypatch.setattr("softlab.app.command.tables.load_scene", lambda name: spare)
    assert command("scenes").out == out  # what waits is not counted


def test_the_catalogue_is_readable_at_80_columns(capsys: pytest.CaptureFixture[str]) -> None:
    """A line a scene, nothing cut; in a narrower place lines are broken, and still nothing is cut."""
    for width in (80, 50):
        print_scenes(Console(width=width, highlight=False))
        lines = capsys.readouterr().out.splitlines()
        assert max(map(len, lines)) <= width and not any("…" in line for line in lines)
        if width == 80:
            assert [line.split()[0] for line in lines] == ["scene", *catalogue()]
            assert all(load_scene(line.split()[0]).method.name in line for line in lines[1:] if "jelly" in line)


# ---------------------------------------------------------------------- plans


def test_the_plan_counts_the_real_overlap_of_clusters() -> None:
    for scene in (SCENE, beams_and_torus(beam=BEAM | {"cluster_radius": 0.6})):
        clusters, particles = scene.body_set.clusters, scene.body_set.particle_count
        report = plan_report(scene, backends=("cpu",))
        stages = {row.name: row.stage for row in report.rows if row.stage}
        each, entries = clusters.count / particles, len(clusters.indices) / particles
        match, move = stages["match clusters"], stages["move to goals"]
        assert match.operations == pytest.approx(
            entries * cluster.OPERATIONS_MEMBER + each * cluster.OPERATIONS_TURN, abs=0.5
        )
        assert move.operations == pytest.approx(entries * cluster.OPERATIONS_GOAL + cluster.OPERATIONS_MOVE, abs=0.5)
        # 8 scalars of an entry (its particle's place among them) and 4 of a cluster in, a rotation and a centre out
        assert match.reads + match.writes == pytest.approx((8 * entries + (4 + 16) * each) / 3, abs=1)
        assert move.reads == pytest.approx(17 * entries / 3 + 1, abs=0.5)
        moved = sum(part.bytes for part in report.backends[0].passes)
        between = (
            2 * 3 * 4 * 3
        )  # what stays in the pass of velocities that rigid bodies make of momenta: a write, two reads
        assert 2 * moved == pytest.approx(report.plan.bytes(4) - between, rel=0.02)  # 2 substeps of 1 iteration
        found = report.as_dict()
        assert (found["bodies"], found["clusters"], found["entries"]) == (3, clusters.count, len(clusters.indices))


def test_the_plan_names_kernels_and_stages_of_both_backends() -> None:
    from io import StringIO

    report = plan_report(SCENE)
    kernels = {one.name: one.kernel for one in report.backends}
    assert kernels.get("cpu") == "fused" and kernels.get("gpu", "graph") == "graph"
    for one in report.backends:
        assert [part.stages for part in one.passes] == [
            ("gravity", "predict"), ("match clusters",), ("move to goals",), ("update velocity", "keep momenta"),
        ]  # fmt: skip
    text = StringIO()
    print_plan(Console(file=text, width=160), report)
    assert f"{BODY_SET.particle_count} particles of 3 bodies, {BODY_SET.clusters.count} clusters" in text.getvalue()
    assert "no limit to dt" in text.getvalue()


# ---------------------------------------------------------------------- scene files


@pytest.mark.parametrize("name", ["bodies", "letters", "jelly-drop"])
def test_a_scene_of_bodies_is_read_back_as_it_was_written(name: str) -> None:
    scene = SCENE if name == "bodies" else load_scene("jelly-drop")
    if name == "letters":
        shape = {"name": "letters", "text": "O", "resolution": 24}
        scene = Scene({"o": TORUS | {"shape": shape}, "method": METHOD})
    text = scene_toml(scene)
    again = Scene(tomllib.loads(text))
    assert again.canonical() == scene.canonical()
    assert "null" not in text and 'shape = { name = "' in text
    assert ('text = "O"' in text) == (name == "letters")
    assert again.replace({"gravity.enabled": False}).gravity is not None


@pytest.mark.parametrize(
    "changes,word",
    [
        ({"beam.particle_spacing": 3.0}, "beam.particle_spacing = 3.0: larger than the mesh"),
        ({"beam.cluster_spacing": 0.4, "beam.cluster_radius": 0.1}, "the body would fall apart"),
        ({"beam.copies": (0, 1, 1)}, "beam.copies"),
        ({"beam.axis": (0.0, 0.0, 0.0)}, "must point somewhere"),
        ({"beam.file": "none.obj"}, "no such file"),
        ({"method.solver": "xpbd"}, "must be shape-matching"),
        ({"wind.drag": 1.0}, "is not supported together with bodies"),
        ({"grid.rows": 3, "grid.columns": 3}, "is not supported together with bodies"),
    ],
)
def test_what_bodies_cannot_be_is_told_with_the_part_s_name(changes: dict[str, Any], word: str) -> None:
    with pytest.raises(SoftlabError, match=word):
        assert SCENE.replace(changes).body_set


def test_bodies_that_lie_in_each_other_are_told() -> None:
    """A brick put into another one, a hundredth of a second before; apart, nothing is said."""
    from bodies_scenes import BRICK, bodies_scene

    from softlab.app.command.run import Request, run_scene

    for gap, caught in ((0.05, True), (2.0, False)):
        scene = bodies_scene(brick=BRICK | {"copies": [1, 2, 1], "apart": [0.0, gap, 0.0]}, contact={})
        result = run_scene(scene, Request(steps=1), progress=False)
        assert (result.report["caught"] > 0) == caught
        assert any("bodies overlap" in note for note in result.notes) == caught
