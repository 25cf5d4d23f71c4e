"""Bodies of voxels whose surface the lattice does not fit, against the mesh and against the exact beam; and the tables of
docs/method/tetrahedra.md: python -m tests.geometry.tetrahedra.voxel_accuracy writes them (from the repository's root)."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

ROOT = Path(__file__).parents[3]
sys.path[:0] = [folder for folder in (str(ROOT), str(ROOT / "tests" / "tools")) if folder not in sys.path]

from closed_meshes import box, rotation  # noqa: E402  # tools of the tests, found by the line above

from softlab.app.driver import open_simulation  # noqa: E402
from softlab.bench.reference.finite_elements import linear_static  # noqa: E402
from softlab.model.geometry.mesh import triangle_mesh  # noqa: E402
from softlab.model.geometry.moments import point_moments, surface_moments, tetrahedra_moments  # noqa: E402
from softlab.model.geometry.shapes import Shape  # noqa: E402
from softlab.model.geometry.tetrahedra.fractions import MIN_STIFFNESS  # noqa: E402
from softlab.model.geometry.tetrahedra.voxels import VoxelMesh, voxel_mesh  # noqa: E402
from softlab.model.scene.scene import Scene  # noqa: E402

PAGE = ROOT / "docs" / "method" / "tetrahedra.md"
DENSITY, YOUNG, POISSON = 1000.0, 1e5, 0.3  # kg/m^3, Pa
SIDE, LENGTH, GRAVITY = 0.1, 0.5, 0.02  # m, m, m/s^2: so little that the beam stays nearly straight
VOXELS, ACROSS = (5, 10, 20, 40), (2, 4, 8)  # along the longest side of a body; across the beam's side
ANGLES = (0.0, 30.0, 45.0)  # degrees, of the beam about its length
REST = 8.0, 3.0  # 1/s of mass damping, about critical, and s after which the beam is at rest
SOLVERS = {
    "`xpbd`, 20 substeps of 0.5 ms": {"solver": "xpbd", "dt": 0.01, "substeps": 20},
    "`vbd`, 2 substeps of 5 ms, 20 sweeps": {"solver": "vbd", "dt": 0.01, "substeps": 2, "iterations": 20},
    "`newton`, 0.1 s": {"solver": "newton", "dt": 0.1},
}


def prism(ring: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The prism of a polygon `ring` (n, 3), in mathematical order seen from +x, and the displacement `along` (3,)."""
    n = len(ring)
    here, then = np.arange(n), (np.arange(n) + 1) % n
    sides = [np.stack([here, then, here + n], axis=1), np.stack([then, then + n, here + n], axis=1)]
    fan = np.stack([np.zeros(n - 2, int), here[1:-1], here[2:]], axis=1)
    return np.concatenate([ring, ring + along]), np.concatenate([*sides, fan[:, ::-1], fan + n])


def polygon(corners: int, radius: float, degrees: float = 0.0) -> np.ndarray:
    """(corners, 3): a regular one around x, its first corner turned from y by `degrees`."""
    angle = np.radians(degrees) + np.arange(corners) * (2 * np.pi / corners)
    return np.stack([np.zeros(corners), radius * np.cos(angle), radius * np.sin(angle)], axis=1)


SHAPES = {
    "ball": Shape(name="ball", resolution=24).mesh(),
    "torus": Shape(name="torus", resolution=32).mesh(),
    "slanted cylinder": prism(polygon(96, 0.3), np.array([1.0, 0.1, 0.0])),
    "tilted box": (box((0.5, 0.3, 1.0))[0] @ rotation((0.4, 1.0, -0.3)).T + [4, 5, 6], box()[1]),
}


def weights(body: VoxelMesh) -> np.ndarray:
    """(tetrahedra, 4) [m^3]: what each holds for each of its corners."""
    return body.mesh.volumes[:, None] / 4 * body.fractions


def masses(body: VoxelMesh) -> np.ndarray:
    """(vertices,) [kg]"""
    return np.bincount(body.mesh.tetrahedra.ravel(), DENSITY * weights(body).ravel(), len(body.mesh.position))


def moments_off(body: VoxelMesh) -> tuple[float, float, float, float]:
    """By how much the body's volume, its centre over its size, and its second moments, spread over tetrahedra and lumped at
    vertices, differ from its surface's, at most, relatively."""
    volume, centre, second = surface_moments(body.hull.position, body.hull.triangles)
    spread = tetrahedra_moments(body.mesh.position[body.mesh.tetrahedra], weights(body).sum(axis=1))
    lumped = point_moments(body.mesh.position, masses(body) / DENSITY)
    off = [float(np.abs(moments[2] / second - 1).max()) for moments in (spread, lumped)]
    size = np.ptp(body.hull.position, axis=0).max()
    heavy = max(abs(spread[0] / volume - 1), abs(lumped[0] / volume - 1))
    return float(heavy), float(np.abs(lumped[1] - centre).max() / size), off[0], off[1]


def order_of(errors: list[float]) -> float:
    """The mean power of the voxel's edge, halved from one error to the next."""
    return float(np.log2(np.array(errors[:-1]) / np.array(errors[1:])).mean())


def beam(degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """A square one along x, turned about its length."""
    return prism(polygon(4, SIDE / np.sqrt(2), degrees + 45), np.array([LENGTH, 0.0, 0.0]))


def exact_sag() -> float:
    """Timoshenko's [m], of the end of the beam under its weight: w L^4 / (8 E I) + w L^2 / (2 k G A)."""
    shear, load = YOUNG / (2 * (1 + POISSON)), DENSITY * GRAVITY * SIDE**2
    return load * LENGTH**4 / (8 * YOUNG * SIDE**4 / 12) + load * LENGTH**2 / (2 * (5 / 6) * shear * SIDE**2)


def static_sag(position: np.ndarray, tetrahedra: np.ndarray, fraction: np.ndarray, mass: np.ndarray) -> float:
    """[m] of the end of a beam held at its lower x, under its own weight, by linear finite elements."""
    held, force = np.isclose(position[:, 0], position[:, 0].min()), np.zeros_like(position)
    force[:, 1] = -GRAVITY * mass
    return end_sag(position, linear_static(position, tetrahedra, YOUNG * fraction, POISSON, held, force), mass)


def end_sag(position: np.ndarray, moved: np.ndarray, mass: np.ndarray) -> float:
    """[m]: of a beam at rest at `position` (vertices, 3), whose vertices `moved` (vertices, 3)."""
    end = np.isclose(position[:, 0], position[:, 0].max())
    return float(-np.average(moved[end, 1], weights=mass[end]))


def mesh_sag(degrees: float, across: int) -> float:
    """[m]: of voxels so many `across` the side."""
    body = voxel_mesh(beam(degrees), edge=SIDE / across * (1 + 1e-6))
    fraction = np.maximum(body.fractions.mean(axis=1), MIN_STIFFNESS)
    return static_sag(body.mesh.position, body.mesh.tetrahedra, fraction, masses(body))


def solver_sag(degrees: float, across: int, method: dict[str, object], folder: Path) -> tuple[float, float]:
    """[m]: of a run until the beam is at rest, and of linear finite elements of its mesh, masses and fractions."""
    mesh = triangle_mesh(*beam(degrees))
    file = folder / f"beam-{degrees:g}.obj"
    lines = [f"v {x!r} {y!r} {z!r}\n" for x, y, z in mesh.position.tolist()]
    file.write_text("".join(lines + [f"f {a} {b} {c}\n" for a, b, c in (mesh.triangles + 1).tolist()]))
    body = {
        "kind": "tetrahedral_body", "file": str(file), "edge": SIDE / across * (1 + 1e-6), "young_modulus": YOUNG,
        "poisson_ratio": POISSON, "density": DENSITY, "pinned": ["left"], "mass_damping": REST[0],
    }  # fmt: skip
    scene = Scene({"beam": body, "gravity": {"acceleration": GRAVITY}, "method": method})
    found, cooked = scene.tetrahedra_set, scene.parts["beam"].cooked  # type: ignore[attr-defined]
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(round(REST[1] / scene.method.dt))
        moved = np.asarray(simulation.state().position) - found.position
    static = static_sag(found.position, found.tetrahedra, cooked.fraction, found.masses)
    return end_sag(found.position, moved, found.masses), static


def moments_table() -> str:
    """Second moments of SHAPES."""
    lines = [
        "| body | " + " | ".join(f"{voxels} voxels" for voxels in VOXELS) + " | order |",
        "| --- |" + " --- |" * (len(VOXELS) + 1),
    ]
    heavy = far = 0.0
    for name, mesh in SHAPES.items():
        off = np.array([moments_off(voxel_mesh(mesh, voxels=voxels)) for voxels in VOXELS])
        heavy, far = max(heavy, off[:, 0].max()), max(far, off[:, 1].max())
        cells = [f"{100 * spread:.2g} % ({100 * lumped:.2g} %)" for spread, lumped in off[:, 2:]]
        orders = f"{order_of(off[:, 2].tolist()):.1f} ({order_of(off[:, 3].tolist()):.1f})"
        lines.append(f"| {name} | {' | '.join(cells)} | {orders} |")
    assert heavy < 1e-12, heavy
    return "\n".join([*lines, "", f"Volumes are the mesh's to rounding, centres within {far:.1g} of the size."])


def beam_table(folder: Path) -> str:
    """Sags of the beam."""
    exact = exact_sag()
    lines = [
        "| voxels across the side | " + " | ".join(f"{angle:g} degrees" for angle in ANGLES) + " |",
        "| --- |" + " --- |" * len(ANGLES),
    ]
    for across in ACROSS:
        lines.append(f"| {across} | " + " | ".join(f"{mesh_sag(angle, across) / exact:.2f}" for angle in ANGLES) + " |")
    lines += ["", "| 2 voxels across, turned by 30 degrees | sag over that of its mesh |", "| --- | --- |"]
    for name, method in SOLVERS.items():
        own, static = solver_sag(30.0, 2, method, folder)
        lines.append(f"| {name} | {own / static:.3f} |")
    return "\n".join(lines)


TABLES: dict[str, Callable[[Path], str]] = {"moments": lambda _: moments_table(), "beams": beam_table}


def page() -> str:
    """docs/method/tetrahedra.md with its tables made anew."""
    text = PAGE.read_text(encoding="utf-8")
    with TemporaryDirectory() as folder:
        for name, table in TABLES.items():
            first, last = f"<!-- table: {name} -->", f"<!-- end of table: {name} -->"
            before, after = text.split(first)[0], text.split(last)[1]
            text = f"{before}{first}\n\n{table(Path(folder))}\n\n{last}{after}"
    return text


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
