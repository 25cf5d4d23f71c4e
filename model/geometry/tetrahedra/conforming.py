"""Tetrahedra that follow a surface, from any set of triangles, by wildmeshing (extra `tets`) in a separate process.

Y. Hu, T. Schneider, B. Wang, D. Zorin, D. Panozzo, "Fast Tetrahedral Meshing in the Wild", ACM Transactions on Graphics
39 (2020): holes are closed, self-intersections are resolved, and the surface is preserved to TOLERANCE of the diagonal
of the box around it. The process is separate because the library prints to the terminal and can end its process. It
processes the triangles in a random order, so two calls give two meshes; use `softlab cook` to store one.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from softlab.model.base.disk_cache import read_arrays
from softlab.model.base.errors import BackendUnavailable, InputError, SceneError
from softlab.model.geometry.arithmetic.ordered import norm
from softlab.model.geometry.mending.welding import without_flat
from softlab.model.geometry.mesh_files import check_vertices
from softlab.model.geometry.tetrahedra.embedding import Embedding, carriers
from softlab.model.geometry.tetrahedra.mesh import TetrahedralMesh, signed_volumes

TOLERANCE = 1e-3  # of the diagonal of the box: how far the surface may be moved
DENSEST, COARSEST = 1e-3, 1.0  # of the diagonal: the edge of a tetrahedron
SECONDS = 900.0  # that it may take
PROGRAM = """
import sys, numpy, wildmeshing
given = numpy.load(sys.argv[1])
maker = wildmeshing.Tetrahedralizer(epsilon=float(given["epsilon"]), edge_length_r=float(given["edge"]), max_threads=1)
maker.set_log_level(6)
maker.set_mesh(given["position"], given["triangles"])
maker.tetrahedralize()
position, tetrahedra = maker.get_tet_mesh(correct_surface_orientation=True)[:2]
numpy.savez(sys.argv[2], position=position, tetrahedra=tetrahedra)
"""


def conforming_mesh(position: np.ndarray, triangles: np.ndarray, edge: float) -> tuple[TetrahedralMesh, Embedding]:
    """Return (tetrahedra with edges of about `edge` [m] that fill the surface, the embedding of its vertices in them).

    `position` (vertices, 3) [m] and `triangles` (n, 3) need be neither closed nor free of crossings. Raises
    BackendUnavailable (wildmeshing is not installed), SceneError (edge) and InputError (nothing to fill).
    """
    if importlib.util.find_spec("wildmeshing") is None:
        raise BackendUnavailable("wildmeshing is not installed", 'pip install -e ".[tets]", or take voxels')
    check_vertices(position)
    triangles = without_flat(position, np.asarray(triangles, dtype=np.int64), [])
    diagonal = float(norm(np.ptp(position[triangles].reshape(-1, 3), axis=0)))
    part = edge / diagonal
    if not DENSEST <= part <= COARSEST:
        low, high = (f"{limit * diagonal:.3g}" for limit in (DENSEST, COARSEST))
        raise SceneError("edge", edge, f"conforming tetrahedra of this mesh take {low} to {high} m")
    middle = (position.min(axis=0) + position.max(axis=0)) / 2
    with tempfile.TemporaryDirectory(prefix="softlab-") as folder:
        input_file, output_file = Path(folder) / "given.npz", Path(folder) / "made.npz"
        local = (position - middle) / diagonal  # in a box of diagonal 1, whatever the unit
        np.savez(input_file, position=local, triangles=triangles.astype(np.int32), epsilon=TOLERANCE, edge=part)
        try:
            command = [sys.executable, "-c", PROGRAM, str(input_file), str(output_file)]
            subprocess.run(
                command, cwd=folder, capture_output=True, timeout=SECONDS, check=False
            )  # it leaves files there
        except subprocess.TimeoutExpired:
            raise InputError(f"wildmeshing took over {SECONDS:.0f} s; take a larger edge, or voxels") from None
        arrays = read_arrays(output_file)
    if arrays is None or not len(arrays["tetrahedra"]):
        raise InputError("wildmeshing finds nothing to fill in it, or gave up on it; take voxels, or repair the mesh")
    mesh = TetrahedralMesh(arrays["position"] * diagonal + middle, _oriented(arrays["position"], arrays["tetrahedra"]))
    return mesh, carriers(mesh, position)


def _oriented(position: np.ndarray, tetrahedra: np.ndarray) -> np.ndarray:
    """Return the tetrahedra (n, 4) with two corners of inverted ones swapped: the library documents no order."""
    wrong = signed_volumes(position, tetrahedra) < 0
    return np.where(wrong[:, None], tetrahedra[:, [0, 1, 3, 2]], tetrahedra)
