"""A fluid of a plane: its surface, or its particles as discs, and its colliders."""

from __future__ import annotations

import numpy as np

from softlab.app.render import colours, shaders
from softlab.app.render.camera import Camera2D
from softlab.app.render.fluid.disc_shaders import DISC_FRAGMENT, DISC_VERTEX
from softlab.app.render.fluid.outlines import outlines, sections, triangles
from softlab.app.render.fluid.plane_surface import PlaneSurface
from softlab.app.render.opengl import shader_program
from softlab.app.render.vertex_arrays import (
    delete_all,
    draw_elements,
    draw_squares,
    square_array,
    static_buffer,
    uniform_matrix,
    vertex_array,
)
from softlab.app.render.vertices import HostVertices
from softlab.model.scene.scene import Scene


class PlaneFluid:
    """A fluid of a plane, from positions (particles, 2) float32 [m] and appearances (particles, 4), colour and radius
    [m], in two OpenGL buffers. Needs a current OpenGL 3.3 context."""

    def __init__(self, scene: Scene, position: int, appearance: int):
        self.scene, self._count = scene, scene.grid.particle_count
        self._discs = square_array(position, appearance, 2)
        self._disc_program = shader_program(DISC_VERTEX, DISC_FRAGMENT)
        self._surface = PlaneSurface(self._discs, self._count, scene.fluid_set.spacing)
        self._collider_program = shader_program(shaders.VERTEX, shaders.LINE_FRAGMENT)
        polygons = sections(scene, 0.0)
        self._lines, self._areas = _Shapes(outlines(polygons)), _Shapes(triangles(polygons))

    def draw_particles(self, camera: Camera2D) -> None:
        """Draw the discs."""
        program = self._disc_program
        program.use()
        program["transform"], program["pixels"] = uniform_matrix(camera.matrix()), camera.scale
        draw_squares(self._discs, self._count)
        program.stop()

    def draw_surface(self, camera: Camera2D, time: float) -> None:
        """Draw the surface, which ends at the colliders of `time` [s]."""
        from pyglet import gl

        self._surface.draw(camera)
        areas = triangles(sections(self.scene, time))
        self._draw_shapes(camera, self._areas, areas, gl.GL_TRIANGLES, colours.BACKGROUND)

    def draw_colliders(self, camera: Camera2D, time: float) -> None:
        """Draw the outlines at `time` [s]."""
        from pyglet import gl

        self._draw_shapes(camera, self._lines, outlines(sections(self.scene, time)), gl.GL_LINES, colours.FAINT)

    def _draw_shapes(
        self, camera: Camera2D, shapes: _Shapes, corners: np.ndarray, mode: int, colour: tuple[float, float, float]
    ) -> None:
        HostVertices.send(shapes.corners, corners)
        program = self._collider_program
        program.use()
        program["transform"], program["toward"], program["colour"] = uniform_matrix(camera.matrix()), 0.0, colour
        draw_elements(shapes.array, mode, len(corners))
        program.stop()

    def delete(self) -> None:
        """Free the buffers."""
        self._surface.delete()
        self._lines.delete()
        self._areas.delete()
        delete_all([self._discs], [])


class _Shapes:
    """Buffers of `corners` (n, 2) float32 [m], and the vertex `array` of these."""

    def __init__(self, corners: np.ndarray):
        self.corners, self._order = static_buffer(corners), static_buffer(np.arange(len(corners), dtype=np.uint32))
        self.array = vertex_array(self.corners, self._order, dimensions=2)

    def delete(self) -> None:
        """Free the buffers."""
        delete_all([self.array], [self.corners, self._order])
