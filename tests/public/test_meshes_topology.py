"""Seams that rounding tore, numberings that are kept, edges of more than two triangles, holes: as scans and CAD files have
them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from closed_meshes import Mesh, ball, blocks, both, box, turned_over, volume_of
from meshes import sheet, strip
from test_mesh import binary_stl, check_sound, obj, write

from softlab.model.assets.cooked import Repair, cooked
from softlab.model.assets.soft_body import RigidBody, SoftBody
from softlab.model.base.errors import InputError, SceneError
from softlab.model.geometry import neighbours
from softlab.model.geometry.edges import NonManifold, edge_uses
from softlab.model.geometry.mending.hull import bounding
from softlab.model.geometry.mesh import read_mesh, triangle_mesh
from softlab.model.geometry.solid import filled, solid
from softlab.model.geometry.voxels import winding_numbers
from softlab.model.scene.scene import Scene
from softlab.model.tables.bodies import RigidBodyPart
from softlab.model.tables.colliders.distance_field import DistanceField
from softlab.model.tables.regions import Region
from softlab.model.tables.tetrahedra import TetrahedralBody

# ---------------------------------------------------------------------- seams


def lattice_triangles(m: int, n: int) -> np.ndarray:
    """Cells of m + 1 times n + 1 points, two triangles each."""
    index = np.arange((m + 1) * (n + 1)).reshape(m + 1, n + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    return np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, c, d), (a, b, c))])


def surface(name: str, m: int = 16, n: int = 8) -> Mesh:
    """By formula, whose seam is off by rounding: sin 2 pi = -2.4e-16."""
    v_end = np.pi if name == "sphere" else 2 * np.pi
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, m + 1), np.linspace(0, v_end, n + 1), indexing="ij")
    if name == "torus":
        points = [(1 + 0.3 * np.cos(v)) * np.cos(u), 0.3 * np.sin(v), (1 + 0.3 * np.cos(v)) * np.sin(u)]
    elif name == "sphere":
        points = [np.sin(v) * np.cos(u), np.cos(v), np.sin(v) * np.sin(u)]
    else:  # a tube
        points = [np.cos(u), v / np.pi, np.sin(u)]
    return np.stack(points, -1).reshape(-1, 3), lattice_triangles(m, n)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("name,rims", [("torus", 0), ("sphere", 0), ("tube", 2)])
@pytest.mark.parametrize("form", ["a.obj", "a.stl"])
def test_seams_of_surfaces_by_formula_close(tmp_path: Path, name: str, rims: int, scale: float, form: str) -> None:
    position, triangles = surface(name)
    content = obj(position, triangles) if form == "a.obj" else binary_stl(position, triangles)
    mesh = read_mesh(write(tmp_path, form, content), scale)
    check_sound(mesh)
    assert (mesh.boundary_loops, mesh.pieces) == (rims, 1)
    assert any(
        "on rims within 1e-08 of the mesh's size of another were merged, which closed seams" in r for r in mesh.repairs
    )
    euler = len(mesh.position) - len(mesh.edges.edges) + len(mesh.triangles)
    assert euler == {"torus": 0, "sphere": 2, "tube": 0}[name]


def test_only_what_closes_a_rim_is_merged() -> None:
    """A slit of 1e-10 closes; one of 1e-6 stays; ends of two edges that lie so near to each other stay apart."""
    position, triangles = sheet(2, 3)
    slit = position.copy()
    torn = np.concatenate([slit, slit[[1, 4]] + [0, 0, 1e-10]])
    right = (position[triangles].mean(axis=1)[:, 0] > 1)[:, None]
    apart = np.where(right & (triangles == 1), 6, np.where(right & (triangles == 4), 7, triangles))
    mesh = triangle_mesh(torn, apart)
    assert (mesh.pieces, mesh.boundary_loops, len(mesh.position)) == (1, 1, 6)
    assert "2 vertices on rims within 1e-08" in mesh.repairs[0] and "of 8 edges on rims 6 are left" in mesh.repairs[0]
    torn[6:] = slit[[1, 4]] + [0, 0, 1e-6]
    assert (triangle_mesh(torn, apart).pieces, triangle_mesh(torn, apart).repairs) == (2, ())
    tips = np.array([[0, 0, 0], [-1, 1, 0], [-1, -1, 0], [1e-10, 0, 0], [1, 1, 0], [1, -1, 0]])
    assert triangle_mesh(tips, [[0, 1, 2], [3, 5, 4]]).repairs == ()


def test_merging_never_makes_an_edge_of_three_triangles() -> None:
    """A flap 1e-10 from the inner edge of a sheet."""
    position, triangles = sheet(2, 3)
    flap = np.concatenate([position, position[[1, 4]] + [0, 0, 1e-10], [[1.0, -0.5, 1.0]]])
    mesh = triangle_mesh(flap, np.concatenate([triangles, [[6, 7, 8]]]))
    assert (mesh.pieces, mesh.repairs) == (2, ())


def test_a_seam_closes_beside_a_fin() -> None:
    """An edge of three triangles elsewhere is no reason to leave the seam open."""
    position, triangles = with_fins(surface("torus"), (3, 3, 3))
    with pytest.raises(NonManifold, match="1 edge has more than two"):
        triangle_mesh(position, triangles)
    closed = triangle_mesh(*surface("torus"))
    body = solid(triangle_mesh(position, triangles, inside=True), 0.0)
    assert body.volume == pytest.approx(abs(volume_of((closed.position, closed.triangles))), rel=1e-12)


# ---------------------------------------------------------------------- numberings that are closed


def shared(mesh: Mesh) -> Mesh:
    """The mesh with one vertex for each place."""
    places, number = np.unique(mesh[0], axis=0, return_inverse=True)
    return places, number.reshape(-1)[mesh[1]]


EDGE = both(box(), box(middle=(1, 1, 0)))  # two cubes that touch along an edge
FACE = both(box(), box(middle=(1, 0, 0)))  # along a whole face


@pytest.mark.parametrize("mesh", [EDGE, FACE])
def test_pieces_that_are_closed_by_themselves_are_kept(mesh: Mesh) -> None:
    found = triangle_mesh(*mesh)
    assert (found.pieces, found.boundary_loops, len(found.triangles)) == (2, 0, 24)
    assert "kept apart: merging would make edges of more than two triangles" in found.repairs[-1]
    assert solid(found, 0.0).volume == pytest.approx(2.0)


def test_beside_a_closed_piece_others_are_merged() -> None:
    """One cube as it is numbered, one as STL has it, every triangle with vertices of its own, and a third that touches."""
    one, two = box(), box(middle=(5, 0, 0))
    loose = two[0][two[1]].reshape(-1, 3), np.arange(36).reshape(-1, 3)
    found = triangle_mesh(*both(both(one, box(middle=(1, 1, 0))), loose))
    assert (found.pieces, found.boundary_loops, len(found.position)) == (3, 0, 24)
    assert "28 vertices at the place of another were merged" in found.repairs


# ---------------------------------------------------------------------- edges of more than two triangles

CELLS = ((0, 0, 0), (1, 0, 0))
WALL_CORNERS = ((1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1))


def with_wall() -> Mesh:
    """A box of 2 m^3 with a wall across its middle."""
    position, triangles = blocks(CELLS)
    wall = [int(np.argmin(np.linalg.norm(position - corner, axis=1))) for corner in WALL_CORNERS]
    return position, np.concatenate([triangles, [[wall[0], wall[1], wall[2]], [wall[0], wall[2], wall[3]]]])


def with_fins(mesh: Mesh, *tips: tuple[float, float, float]) -> Mesh:
    """The mesh with a triangle more on an edge of some of its triangles."""
    position, triangles = np.concatenate([mesh[0], tips]), mesh[1]
    fins = [[*triangles[7 * k][:2], len(mesh[0]) + k] for k in range(len(tips))]
    return position, np.concatenate([triangles, fins])


SOUPS = {
    "wall": (with_wall(), 2.0),
    "fins": (with_fins(ball(halvings=3), (2, 2, 2), (0, 0, 0)), volume_of(ball(halvings=3))),
    "edge": (shared(EDGE), 2.0),
    "checkers": (blocks([c for c in np.ndindex(3, 3, 3) if sum(c) % 2 == 0]), 14.0),
    "fins turned over": (turned_over(with_fins(ball(halvings=3), (2, 2, 2))), volume_of(ball(halvings=3))),
    "hollow": (with_fins(both(box(), turned_over(box((0.5, 0.5, 0.5)))), (3, 3, 3)), 0.875),
}


@pytest.mark.parametrize("name", SOUPS)
def test_the_inside_is_found_by_winding_numbers(name: str) -> None:
    """Volumes are exact; every point of a lattice lies inside as the soup without its fins and walls says."""
    mesh, volume = SOUPS[name]
    with pytest.raises(NonManifold, match=r"a cloth needs two at most.*rigid_body, soft_body, tetrahedral_body"):
        triangle_mesh(*mesh)
    found = triangle_mesh(*mesh, inside=True)
    assert not found.boundary_loops and edge_uses(len(found.position), found.triangles)[1].max() == 2
    assert any("of more than two triangles: the inside was found by winding numbers" in line for line in found.repairs)
    body = solid(found, 0.0)
    assert body.volume == pytest.approx(volume, rel=1e-12)
    low, high = body.position.min(axis=0), body.position.max(axis=0)
    points = low + (high - low) * (np.stack(np.meshgrid(*[np.arange(5)] * 3), -1).reshape(-1, 3) + 0.47) / 5
    winding = winding_numbers(points, body.position, body.triangles)
    np.testing.assert_allclose(winding, np.round(winding), atol=1e-9)
    if name != "fins turned over":  # of which this is the mirror
        soup = winding_numbers(points, *mesh) > 0.5
        assert (soup != (winding > 0.5)).mean() < (0.05 if "fins" in name or name in ("wall", "hollow") else 1e-9)


def test_triangles_turned_over_at_random_agree_again() -> None:
    """A third of a ball with a fin."""
    position, triangles = with_fins(ball(halvings=3), (2, 2, 2))
    turned = np.arange(len(triangles)) % 3 == 1
    triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
    body = solid(triangle_mesh(position, triangles, inside=True), 0.0)
    assert body.volume == pytest.approx(volume_of(ball(halvings=3)), rel=1e-12)


def test_sheets_that_enclose_nothing_are_told_so() -> None:
    """Three sheets that meet at an edge."""
    position = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 1, 0], [-1, -1, 0.0]])
    mesh = triangle_mesh(position, [[0, 1, 2], [0, 1, 3], [0, 1, 4]], inside=True)
    with pytest.raises(InputError, match="not closed"):
        solid(mesh, 0.0)
    source, _, triangles = bounding(position, np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]), [])
    assert len(triangles) == 3 and source.max() == 4


def body_tables(kind: str, file: Path, **fields: Any) -> dict[str, Any]:
    tables: dict[str, Any] = {"one": {"kind": kind, "file": str(file), **fields}}
    if kind in ("mesh_collider", "distance_field"):
        tables |= {"cloth": {"rows": 3, "columns": 3, "spacing": 0.1}, "structural": {"stiffness": 10.0}}
    return tables


def test_roles_that_need_no_manifold_take_the_file(tmp_path: Path) -> None:
    """A box of 2 m^3 with a wall in it: particles, voxels, a field, a region and a collider."""
    position, triangles = with_wall()
    file = write(tmp_path, "wall.obj", obj(position, triangles))
    for kind in (RigidBody, SoftBody):
        body = kind.from_mesh(read_mesh(file, inside=True), particle_spacing=0.2)
        assert body.mass.sum() == pytest.approx(2000.0, rel=1e-9)
        assert any("winding numbers" in line for line in body.report.lines())
    cut = cooked(str(file), edge=0.5, use_cache=False)
    assert cut.report.volume == pytest.approx(2.0) and any("winding numbers" in line for line in cut.report.told)
    (field,) = (collider for _, collider in Scene(body_tables("distance_field", file, spacing=0.2)).colliders)
    assert isinstance(field, DistanceField)
    assert field.field.at(np.array([[1.0, 0.5, 0.5]]))[0] < -0.35  # the wall is no surface
    assert any("winding numbers" in line for line in field.lines())
    points = np.array([[0.9, 0.5, 0.5], [1.1, 0.5, 0.5], [1.0, 1.2, 0.5]])
    assert Region(file=str(file)).holds(points, 0.0).tolist() == [True, True, False]
    (wall,) = (collider for _, collider in Scene(body_tables("mesh_collider", file)).colliders)
    assert len(wall.triangles) == len(triangles)
    for tables in ({"mesh": {"file": str(file)}, "structural": {}, "method": {"solver": "xpbd"}},):
        with pytest.raises(InputError, match=r"wall.obj: 4 edges have more than two triangles"):
            Scene(tables)


# ---------------------------------------------------------------------- holes


def open_ball() -> Mesh:
    """A ball of 0.5 m without what lies below -0.3 m: a hole 0.8 m across, whose rim is no circle."""
    position, triangles = ball(halvings=3)
    keep = position[triangles][:, :, 2].min(axis=1) > -0.32
    return position, triangles[keep]


def test_holes_are_filled_on_request(tmp_path: Path) -> None:
    position, triangles = open_ball()
    mesh = triangle_mesh(position, triangles)
    assert mesh.boundary_loops == 1
    with pytest.raises(InputError, match=r"set fill_holes = true \(softlab cook: --fill-holes\)"):
        solid(mesh, 0.1)
    body = solid(mesh, 0.1, fill_holes=True)
    cap = np.pi * (0.5 - 0.3) ** 2 * (3 * 0.5 - (0.5 - 0.3)) / 3  # a ball's below 0.3 m
    assert body.volume == pytest.approx(volume_of(ball(halvings=3)) - cap, rel=0.03)
    assert "1 hole, up to" in body.notes[-1]
    file = write(tmp_path, "open.obj", obj(position, triangles))
    part = RigidBodyPart(file=str(file), particle_spacing=0.1, fill_holes=True)
    assert part.baked.mass.sum() == pytest.approx(1000 * body.volume, rel=1e-6)
    with pytest.raises(InputError, match="fill_holes"):
        _ = RigidBodyPart(file=str(file), particle_spacing=0.1).baked
    cut = cooked(str(file), voxels=8, use_cache=False, repair=Repair(fill_holes=True))
    assert cut.report.hull_volume == pytest.approx(body.volume)
    with pytest.raises(InputError, match="fill_holes"):
        cooked(str(file), voxels=8, use_cache=False)
    assert Region(file=str(file), fill_holes=True).holds(np.zeros((1, 3)), 0.0).all()
    (field,) = (c for _, c in Scene(body_tables("distance_field", file, fill_holes=True, spacing=0.1)).colliders)
    assert isinstance(field, DistanceField) and field.field.at(np.zeros((1, 3)))[0] < -0.25


def test_fill_holes_is_written_only_where_it_is_given(tmp_path: Path) -> None:
    file = str(write(tmp_path, "ball.obj", obj(*ball())))
    for made in (RigidBodyPart(file=file, particle_spacing=0.1), TetrahedralBody(file=file), DistanceField(file=file)):
        assert "fill_holes" not in made.model_dump()
        assert made.model_copy(update={"fill_holes": True}).model_dump()["fill_holes"]
    with pytest.raises(SceneError, match=r"belongs to a file; the lab's shapes have none"):
        Scene(
            {"one": {"kind": "rigid_body", "shape": {"name": "box"}, "particle_spacing": 0.1, "fill_holes": True}}
            | {"method": {"solver": "shape-matching"}}
        )


def test_a_concave_rim_and_rims_that_touch() -> None:
    """A U of blocks without its lid: an eight-cornered concave rim, filled flat; two lids that share a corner."""
    cells = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (2, 1, 0)]
    position, triangles = blocks(cells)
    lid = (position[triangles][:, :, 2] == 1).all(axis=1)
    body = solid(filled(triangle_mesh(position, triangles[~lid]), np.inf), 0.0)
    assert body.volume == pytest.approx(5.0, rel=1e-12) and body.area == pytest.approx(22.0, rel=1e-12)
    position, triangles = blocks([(x, y, 0) for x in range(2) for y in range(2)])
    middle = position[triangles].mean(axis=1)
    lids = (middle[:, 2] == 1) & ((middle[:, 0] < 1) == (middle[:, 1] < 1))
    body = solid(triangle_mesh(position, triangles[~lids]), 0.0, fill_holes=True)
    assert body.volume == pytest.approx(4.0, rel=1e-12) and body.notes[-1].startswith("2 holes")


def test_a_rim_that_crosses_itself_gets_a_middle() -> None:
    """The rim of a strip that is turned over twice: no plane shows it without a crossing."""
    mesh = triangle_mesh(*strip(24, 2))
    assert mesh.boundary_loops == 2
    closed = filled(mesh, np.inf)
    assert not closed.edges.boundary.any()


def test_rims_of_many_edges_are_closed() -> None:
    """More than a polygon is cut for: a middle, and no vertex of the mesh with more edges than before."""
    angle = 2 * np.pi * np.arange(700) / 700
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    low, high = np.arange(700), 700 + np.arange(700)
    after = np.roll(low, -1)
    triangles = np.concatenate([np.stack([low, after, high], 1), np.stack([high, after, 700 + after], 1)])
    body = solid(triangle_mesh(np.concatenate([ring, ring + np.array([0, 0, 1])]), triangles), 0.0, fill_holes=True)
    assert body.volume == pytest.approx(350 * np.sin(2 * np.pi / 700), rel=1e-12)


# ---------------------------------------------------------------------- bodies that touch, and slits


def prism(*corners: tuple[float, float]) -> Mesh:
    """Between z = 0 and 1, over a triangle of these corners, counter-clockwise."""
    position = np.array([(x, y, z) for z in (0.0, 1.0) for x, y in corners])
    sides = [t for a, b in ((0, 1), (1, 2), (2, 0)) for t in ((a, b, b + 3), (a, b + 3, a + 3))]
    return position, np.array([(0, 2, 1), (3, 4, 5), *sides])


def test_an_edge_that_a_surface_passes_twice(tmp_path: Path) -> None:
    """Blocks that touch along an edge and hang together beyond both of its ends, as gears of a CAD assembly."""
    around = [(x, y, z) for z in (-1, 1) for x, y in ((0, 0), (1, 0), (1, 1))]
    file = write(tmp_path, "a.obj", obj(*shared(blocks([(0, 0, 0), (1, 1, 0), *around]))))
    body = solid(read_mesh(file, inside=True), 0.0)
    assert body.volume == pytest.approx(8.0, rel=1e-12)
    assert (edge_uses(len(body.position), body.triangles)[1] == 2).all()
    for part in (RigidBody, SoftBody):
        assert part.from_mesh(read_mesh(file, inside=True), particle_spacing=0.25).mass.sum() == pytest.approx(8000.0)
    assert cooked(file, voxels=6, use_cache=False).report.hull_volume == pytest.approx(8.0)
    assert DistanceField(file=str(file), spacing=0.1).field.distance.min() < -0.4


@pytest.mark.parametrize("degrees", [30.0, 60.0, 90.0, 200.0])
def test_bodies_that_share_an_edge(degrees: float) -> None:
    """Two wedges of 60 degrees around it, the second one turned: into the first, against its side, or apart."""
    one = prism((0, 0), (1, 0), (0.5, 0.75**0.5))
    two = prism((0, 0), *((float(np.cos(a)), float(np.sin(a))) for a in np.radians([degrees, degrees + 60])))
    mesh = triangle_mesh(*shared(both(one, two)), inside=True)
    assert mesh.boundary_loops == 0
    assert solid(mesh, 0.0).volume == pytest.approx(2 * volume_of(one), rel=1e-12)


@pytest.mark.parametrize("scale", [1e-3, 1.0])
def test_a_slit_without_a_width_is_closed(tmp_path: Path, scale: float) -> None:
    """A vertex lies on a longer edge of a box, and a triangle without an area closes what is between them."""
    position, triangles = box((1.0, 1.0, 1.0))
    whole, (a, b, c) = triangles[1:], triangles[0]
    middle = (position[a] + position[b]) / 2
    torn = np.concatenate([whole, [[8, b, c], [a, 8, c], [a, b, 8]]])
    file = write(tmp_path, "a.obj", obj(np.concatenate([position, middle[None]]), torn))
    body = solid(read_mesh(file, scale, inside=True), 0.0)
    assert body.volume == pytest.approx(scale**3, rel=1e-12)
    assert body.notes[-1] == "1 slit without a width was filled with 1 triangle"
    spacing = 0.2 * scale
    mass = RigidBody.from_mesh(read_mesh(file, scale, inside=True), particle_spacing=spacing).mass.sum()
    assert mass == pytest.approx(1000 * scale**3)
    report = cooked(file, voxels=5, use_cache=False, scale=scale).report
    assert report.hull_volume == pytest.approx(scale**3)
    field = DistanceField(file=str(file), scale=scale, spacing=0.1 * scale, thickness=0.05 * scale).field
    assert np.isfinite(field.distance).all() and field.distance.min() == pytest.approx(-0.5 * scale, rel=0.2)
    with pytest.raises(InputError, match=r"a hole, 1\.41"):
        solid(triangle_mesh(position, whole), 0.0)


def test_fine_meshes_make_coarse_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    """A turned part of 4 000 facets, each as long as the part, with room for a tenth of all pairs of places tried on it."""
    monkeypatch.setattr(neighbours, "MAX_PAIRS", 1 << 20)
    turn = np.linspace(0, 2 * np.pi, 4001)[:-1]
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    position = np.concatenate(
        [np.column_stack([ring, np.full(4000, z)]) for z in (0.0, 1.0)] + [[[0, 0, 0], [0, 0, 1]]]
    )
    a, b, bottom, top = np.arange(4000), (np.arange(4000) + 1) % 4000, np.full(4000, 8000), np.full(4000, 8001)
    faces = [(a, b, b + 4000), (a, b + 4000, a + 4000), (bottom, b, a), (top, a + 4000, b + 4000)]
    mesh = triangle_mesh(position, np.concatenate([np.stack(face, axis=1) for face in faces]))
    body = RigidBody.from_mesh(mesh, particle_spacing=0.5)
    assert len(body.mass) < 100 and body.mass.sum() == pytest.approx(1000 * np.pi, rel=1e-5)
