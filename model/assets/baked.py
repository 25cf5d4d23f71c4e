"""Cache of bodies on disk.

The name of a file is the hash of the mesh, its parameters and the code that makes the body; its content are the arrays,
bit for bit.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, fields
from functools import cache
from pathlib import Path

import numpy as np

from softlab.model.assets.baked_body import BakedBody, Report
from softlab.model.assets.clusters import Clusters
from softlab.model.assets.lattice import Lattice
from softlab.model.assets.skin import INFLUENCES, Skin
from softlab.model.assets.soft_body import MATERIAL, Meshes, RigidBody
from softlab.model.assets.soft_sheet import SoftSheet
from softlab.model.base.digest import ROOT, source_digest
from softlab.model.base.disk_cache import cache_folder, load_or_make
from softlab.model.base.errors import InputError, SoftlabError
from softlab.model.base.waiting import work
from softlab.model.geometry.mesh import mesh_bytes, read_mesh
from softlab.model.geometry.shapes import Shape

VERSION = 2  # of the files: what is in them, and how
PACKAGES = ("assets", "geometry")  # of the model: the code that makes bodies

Source = Shape | str | Path | Meshes


def baked(
    parameters: RigidBody, mesh: Source, *, scale: float = 1.0, folder: Path | None = None, use_cache: bool = True
) -> BakedBody:
    """Return the body of a mesh by `parameters`, from the cache `folder` (the user's by default) if it is stored
    there.

    `mesh`: a built-in shape, a file (whose coordinates are multiplied by `scale` [m per unit]), or an argument of
    `from_mesh`. The bits are the same with and without the cache. A file that is older, damaged or cannot be written
    costs the time to make the body again. `use_cache` False: neither read nor written. Raises the errors of `read_mesh`
    and `from_mesh`.
    """
    inside = not isinstance(parameters, SoftSheet)  # which is a cloth

    def make() -> BakedBody:
        read = _mesh(mesh, scale, inside)
        with work("making a body of the mesh"):
            return parameters.bake(read)

    if not use_cache:
        return parameters.with_material(make())
    key = body_key(parameters, mesh, scale)
    file = (folder or cache_folder("bodies")) / f"body-{key}.npz"
    body = load_or_make(file, key, _unpacked, make, _packed)
    return parameters.with_material(body)


def body_key(parameters: RigidBody, mesh: Source, scale: float = 1.0) -> str:
    """Return 32 hexadecimal digits that identify the mesh (bytes of a file, fields of a shape, or the arrays), all
    parameters but those of the material, and the code. Raises InputError (a file that cannot be read)."""
    digest = hashlib.sha256(f"{VERSION} {_sources()} {type(parameters).__name__} ".encode())
    digest.update(parameters.model_dump_json(exclude=set(MATERIAL)).encode())
    if isinstance(mesh, Shape):
        digest.update(b" shape " + mesh.model_dump_json().encode())
    elif isinstance(mesh, str | Path):
        digest.update(f" file {Path(mesh).suffix.lower()} {scale!r} ".encode() + _bytes(Path(mesh)))
    else:
        digest.update(b" " + mesh_bytes(mesh))
    return digest.hexdigest()[:32]


@cache
def _sources() -> str:
    return source_digest(*(ROOT / "model" / package for package in PACKAGES))


def _bytes(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror}") from None


def _mesh(mesh: Source, scale: float, inside: bool) -> Meshes:
    if isinstance(mesh, Shape):
        return mesh.mesh()
    if isinstance(mesh, str | Path):
        return read_mesh(mesh, scale, inside)
    return mesh


def _packed(body: BakedBody) -> dict[str, np.ndarray | float]:
    """Return the body as arrays by name, without anything that needs pickling."""
    clusters, skin = body.clusters, body.skin
    return {
        "report": np.array(json.dumps(asdict(body.report))),
        "position": body.position,
        "mass": body.mass,
        "offsets": clusters.offsets,
        "indices": clusters.indices,
        "coefficients": clusters.coefficients,
        "stiffness": clusters.stiffness,
        "links": body.links,
        "rest_length": body.rest_length,
        "link_stiffness": np.float64(body.link_stiffness),
        "spacing": np.float64(body.spacing),
        "lattice": np.array([*body.lattice.counts, body.lattice.region] if body.lattice else [], np.int64),
        **{f"skin_{field.name}": getattr(skin, field.name) for field in fields(Skin)},
    }


def _unpacked(arrays: dict[str, np.ndarray]) -> BakedBody | None:
    """Return the body of a file's arrays; None where they are none."""
    try:
        values = json.loads(str(arrays["report"]))
        report = Report(**{**values, "members": tuple(values["members"]), "notes": tuple(values["notes"])})
        position, mass = arrays["position"], arrays["mass"]
        offsets, indices = arrays["offsets"], arrays["indices"]
        clusters = Clusters(offsets, indices, arrays["coefficients"], arrays["stiffness"], mass, position)
        skin = Skin(**{field.name: arrays[f"skin_{field.name}"] for field in fields(Skin)})
        whole = (
            position.shape == (report.particles, 3)
            and mass.shape == (report.particles,)
            and clusters.count == report.clusters
            and arrays["links"].shape == (report.links, 2)
            and arrays["rest_length"].shape == (report.links,)
            and skin.clusters.shape == skin.weights.shape == (len(skin.position), INFLUENCES)
            and len(skin.rest_centre) == clusters.count
        )
        links, length = arrays["links"], arrays["rest_length"]
        windows = [int(number) for number in arrays["lattice"]]
        stiffness, spacing = float(arrays["link_stiffness"]), float(arrays["spacing"])
        lattice = Lattice((windows[0], windows[1], windows[2]), windows[3], spacing) if windows else None
        whole = whole and (lattice is None or lattice.size == report.particles)
    except (KeyError, IndexError, TypeError, ValueError, SoftlabError):
        return None
    body = BakedBody(position, mass, clusters, links, length, stiffness, skin, spacing, report, lattice)
    return body if whole else None
