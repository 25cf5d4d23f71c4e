"""States as meshes for other programs: `softlab run --export`. PLY or binary glTF (.glb), written by trimesh.

A PLY file contains all moving objects in one mesh; objects without triangles are vertices without faces. A .glb has
every body, cloth, grid and collider under its own name, grids as lines. Positions are metres, y up, as glTF
requires.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softlab.app.output.pieces import Piece, collider_pieces, pieces_of
from softlab.app.render.bodies.skinning import ClusterFrames
from softlab.model.base.errors import InputError, SceneError
from softlab.model.base.files import check_target, replacing
from softlab.model.core.simulation import Simulation
from softlab.model.core.spare import present

if TYPE_CHECKING:
    from trimesh import PointCloud, Trimesh
    from trimesh.path import Path3D

PLY, GLB = ".ply", ".glb"
FRAME = 1 / 60  # s of simulated time between two frames, as in a clip
ROUGHNESS = 0.6  # of a surface in glTF: about as dull as in the lab's pictures
NUMBER = re.compile(r"\{frame(?::(?:0[1-9]\d?)?d)?\}")


@dataclass(frozen=True)
class Target:
    """Output of an export: one file, or with {frame} in its name one for each frame, from 0 on; `every` [steps] between
    two frames."""

    name: str
    numbered: bool
    every: int = 0

    def of(self, frame: int) -> Path:
        """Return the file of a frame."""
        path = Path(self.name)
        return path.with_name(NUMBER.sub(lambda field: field[0].format(frame=frame), path.name))


def check_export(name: str, seconds: float | None, dt: float, notes: list[str]) -> Target:
    """Return the target of `--export NAME --export-every SECONDS`, with steps of `dt` [s]; rounding the time to whole
    steps adds a line to `notes`. Raises InputError (the file's name, its folder), SceneError (the time)."""
    path = Path(name)
    if not path.name:
        raise InputError(f"--export {name}: is a folder; give a file name, such as {name}/body.ply")
    numbered = len(NUMBER.findall(path.name)) == 1
    if "{" in name or "}" in name:
        rest = str(path.with_name(NUMBER.sub("", path.name)))
        if not numbered or "{" in rest or "}" in rest:
            raise InputError(
                f"--export {name}: braces hold the frame number, once in the file name: {{frame}}, or {{frame:04d}} with "
                "leading zeros, as in body-{frame:04d}.ply"
            )
    if seconds is not None and not numbered:
        raise SceneError("--export-every", seconds, "applies to one file per frame; use --export body-{frame:04d}.ply")
    if seconds is not None and not (isfinite(seconds) and seconds > 0):
        raise SceneError("--export-every", seconds, "must be a finite number of seconds, greater than 0")
    every = max(1, round((FRAME if seconds is None else seconds) / dt)) if numbered else 0
    if seconds is not None and abs(every * dt - seconds) > 1e-9 * max(dt, seconds):
        notes.append(f"--export-every {seconds:g} s rounded to {every} steps of {dt:g} s = {every * dt:.9g} s")
    target = Target(name, numbered, every)
    check_target(target.of(0), (PLY, GLB), "an exported mesh")
    return target


class Exporter:
    """Writes states of a run as meshes: every frame of a file name pattern, starting with the current state of
    `simulation`, or the final state."""

    def __init__(self, simulation: Simulation, target: Target):
        self.target, self.every = target, target.every
        self.written: list[Path] = []
        self._worlds = simulation.members or {"": simulation}
        self._frames = {name: ClusterFrames(one.scene) for name, one in self._worlds.items() if one.scene.copies}
        if self.every:
            self.observe(simulation)

    def finish(self, simulation: Simulation, notes: list[str]) -> list[Path]:
        """Write the final state, if requested, and return the files to list. A note replaces the list if there are
        many."""
        if not self.every:
            self.observe(simulation)
            return self.written
        seconds = self.every * simulation.scene.method.dt
        first, last = self.written[0], self.written[-1]
        notes.append(f"{len(self.written)} frames, {first} to {last}, {self.every} steps ({seconds:.6g} s) apart")
        return []

    @property
    def stopped(self) -> str:
        """Return a description of the files of an interrupted run; every file is complete."""
        count = len(self.written)
        if not count:
            return "stopped; nothing was exported yet"
        files = (
            f"1 whole file was written, {self.written[0]}"
            if count == 1
            else (f"{count} whole files were written, {self.written[0]} to {self.written[-1]}")
        )
        return f"stopped; {files}"

    def observe(self, simulation: Simulation) -> None:
        """Write the current state as the next file. Raises InputError, Diverged."""
        simulation.check()
        scene, position = simulation.scene, simulation.read("position").astype(np.float64)
        path = self.target.of(len(self.written))
        weights, pieces = simulation.body.inverse_mass, []
        for name, one in self._worlds.items():
            member_position, frames = one.read("position").astype(np.float64), self._frames.get(name)
            matrices = frames.of_simulation(one, member_position) if frames else None
            pieces += pieces_of(one.scene, member_position, matrices, one.body.inverse_mass)
        if path.suffix.lower() == GLB and scene.dimensions == 3:
            pieces += collider_pieces(scene, present(scene, position, weights), simulation.time)
        self.written.append(write_pieces(path, pieces))


def write_pieces(path: Path | str, pieces: Sequence[Piece]) -> Path:
    """Write pieces to `path` (.ply or .glb), completely or not at all. Raises InputError."""
    path = check_target(path, (PLY, GLB), "an exported mesh")
    data = _glb(pieces) if path.suffix.lower() == GLB else _ply(pieces)
    with replacing(path) as temporary:
        temporary.write_bytes(data)
    return path


def _ply(pieces: Sequence[Piece]) -> bytes:
    """Return one mesh of all pieces; colours as displayed on a screen (sRGB)."""
    import trimesh
    from trimesh.exchange.ply import export_ply

    counts = [len(piece.vertices) for piece in pieces]
    first = np.cumsum([0, *counts])
    faces = [
        piece.triangles + start for piece, start in zip(pieces, first, strict=False) if piece.triangles is not None
    ]
    normals = [np.zeros_like(piece.vertices) if piece.normals is None else piece.normals for piece in pieces]
    shown = np.repeat([_bytes(piece.colour) for piece in pieces], counts, axis=0)
    vertices = np.concatenate([piece.vertices for piece in pieces])
    if not faces:
        return bytes(export_ply(trimesh.PointCloud(vertices, colors=shown)))
    mesh = trimesh.Trimesh(
        vertices, np.concatenate(faces), vertex_normals=np.concatenate(normals), vertex_colors=shown, process=False,
    )  # fmt: skip
    return bytes(export_ply(mesh, vertex_normal=True))


def _glb(pieces: Sequence[Piece]) -> bytes:
    """Return a node for each piece; colours in linear light, as in glTF 2.0, sections 3.7.2.1 and 3.9.2."""
    import trimesh

    scene = trimesh.Scene()
    for piece in pieces:
        scene.add_geometry(_geometry(piece), node_name=piece.name, geom_name=piece.name)
    return bytes(scene.export(file_type="glb", include_normals=True))


def _geometry(piece: Piece) -> Trimesh | PointCloud | Path3D:
    import trimesh

    colour = _bytes(tuple(map(linear, piece.colour)))
    if piece.triangles is not None:
        # a material for each: by default a surface is metallic and one-sided
        material = trimesh.visual.material.PBRMaterial(
            name=piece.name, baseColorFactor=colour, metallicFactor=0.0, roughnessFactor=ROUGHNESS, doubleSided=True
        )
        return trimesh.Trimesh(
            piece.vertices, piece.triangles, vertex_normals=piece.normals, process=False,
            visual=trimesh.visual.TextureVisuals(material=material),
        )  # fmt: skip
    if piece.lines:
        from trimesh.path import Path3D
        from trimesh.path.entities import Line

        lines = [Line(line) for line in piece.lines]
        return Path3D(lines, piece.vertices, process=False, colors=np.tile(colour, (len(lines), 1)))
    return trimesh.PointCloud(piece.vertices, colors=np.tile(colour, (len(piece.vertices), 1)))


def linear(part: float) -> float:
    """Return the linear light of a component of a displayed colour, both in 0 to 1 (IEC 61966-2-1, sRGB)."""
    return part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4


def _bytes(colour: Sequence[float]) -> np.ndarray:
    return np.array([*(round(255 * part) for part in colour), 255], np.uint8)
