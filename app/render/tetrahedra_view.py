"""Draws tetrahedral bodies into the current OpenGL context: their skins, the surfaces that they were cut from, carried by the
tetrahedra; or the edges of the tetrahedra, coloured by strain."""

from __future__ import annotations

from typing import Any

import numpy as np

from app.render import colours
from app.render.camera3d import Camera3D
from app.render.detail import FINE, Detail
from app.render.scenery import Drawn
from app.render.sheet_view import SheetView
from app.render.vertex_arrays import delete_all, draw_elements, refill, static_buffer, vertex_array
from model.core.simulation import Simulation
from model.geometry.normals import mesh_normals
from model.scene.scene import Scene

SHINE = 0.12


class TetrahedraView(SheetView):
    """See View; `lines`: as the edges of the tetrahedra and not as skins. Particles, pins and edges are a sheet's."""

    def __init__(self, scene: Scene, detail: Detail = FINE):
        from pyglet import gl

        super().__init__(scene, detail)
        self._skin = scene.tetrahedra_set.skin
        zero = np.zeros((self._skin.count, 3), np.float32)
        self._skin_buffers = [static_buffer(zero), static_buffer(zero)]
        self._elements = [static_buffer(faces.astype(np.uint32)) for faces in self._skin.triangles]
        self._skins: list[Drawn] = [
            (vertex_array(self._skin_buffers[0], elements, self._skin_buffers[1]), gl.GL_TRIANGLES, faces.size)
            for elements, faces in zip(self._elements, self._skin.triangles, strict=True)
        ]

    def upload(self, position: np.ndarray, normal: np.ndarray | None = None) -> None:
        """See View: skins follow from the positions (particles, 3) [m]."""
        self.vertices.upload_state(position, False)
        self._send(position)

    def upload_from(self, simulation: Simulation, position: np.ndarray | None = None) -> None:
        """See View."""
        if not self.lines and position is None:
            position = simulation.read("position")  # once, for particles and skins
        self.vertices.upload(simulation, False, position)
        if not self.lines and position is not None:
            self._send(position)

    def _send(self, position: np.ndarray) -> None:
        with np.errstate(over="ignore", invalid="ignore"):
            points = self._skin.points(position)
            normals = mesh_normals(points, self._skin.faces)
            refill(self._skin_buffers[0], np.ascontiguousarray(points, np.float32))
            refill(self._skin_buffers[1], np.ascontiguousarray(normals, np.float32))

    def _draw_solid(self, camera: Any, strain_range: float) -> None:
        if self.lines:
            self._draw_springs(camera, strain_range)
            return
        self._lit.use(camera)
        for number, skin in enumerate(self._skins):
            colour = colours.BODIES[number % len(colours.BODIES)]
            self._lit.look(colour, colour, SHINE, np.zeros(3))
            draw_elements(*skin)
        self._lit.program.stop()

    def _draw_shadows(self, camera: Camera3D, time: float) -> None:
        shown = [drawn for drawn, _ in self._lines] if self.lines else self._skins
        self._scenery.draw_shadows(camera, time, self.lowest, shown)

    def delete(self) -> None:
        """Free the buffers."""
        delete_all([array for array, *_ in self._skins], [*self._elements, *self._skin_buffers])
        super().delete()
