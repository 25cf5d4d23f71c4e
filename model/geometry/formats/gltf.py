"""glTF 2.0 by trimesh: binary (.glb), and text (.gltf) with external or embedded buffers. All nodes are transformed to
their positions."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.geometry.arithmetic.ordered import applied, determinant
from softlab.model.geometry.formats.faces import Faces, uniform

COMPRESSED = (b"KHR_draco_mesh_compression", b"EXT_meshopt_compression")


def read_gltf(data: bytes, path: Path) -> Faces:
    """Return the triangles of a glTF file; materials, colours, skins and animations are skipped. Raises InputError for
    compressed meshes."""
    import trimesh
    from trimesh.resolvers import FilePathResolver

    if any(name in data for name in COMPRESSED):
        raise InputError("its meshes are compressed (Draco or meshopt); export it without compression")
    kind = path.suffix.lower()[1:]
    try:
        loaded = trimesh.load_scene(
            io.BytesIO(data), file_type=kind, resolver=FilePathResolver(str(path.absolute())), skip_materials=True,
            process=False, merge_primitives=False,
        )  # fmt: skip
    except FileNotFoundError as error:
        raise InputError(f"its buffer {error} is not beside it; put it there, or export it as .glb") from None
    except MemoryError:
        raise
    except Exception:  # whatever the parser trips over is the file's fault
        raise InputError("it is no glTF 2.0 file, or damaged or cut short; export it again") from None
    position, triangles, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for node in loaded.graph.nodes_geometry:
        transform, name = loaded.graph[node]
        mesh = loaded.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh):
            continue
        points = np.asarray(mesh.vertices, dtype=np.float64)
        moved = applied(transform[:3, :3], points) + transform[:3, 3]
        faces = np.asarray(mesh.faces, dtype=np.int64)
        if determinant(transform[:3, :3]) < 0:  # a mirror image
            faces = faces[:, ::-1]
        position.append(moved)
        triangles.append(faces + count)
        count += len(points)
    parts = len(position) - 1
    notes = (f"{parts} meshes of the file were joined",) if parts > 1 else ()
    return uniform(np.concatenate(position), np.concatenate(triangles), notes)
