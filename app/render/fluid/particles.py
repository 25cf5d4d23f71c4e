"""Draws a scene's fluids as particles, a colour each fluid: lit spheres in space, discs in a plane."""

from __future__ import annotations

from typing import Any

import numpy as np

from app.render import body_shaders, colours
from app.render.camera3d import Camera3D
from app.render.detail import FINE, Detail
from app.render.opengl import shader_program
from app.render.scenery import KEY, Lit
from app.render.vertex_arrays import (
    delete_all,
    draw_squares,
    square_array,
    static_buffer,
    uniform_matrix,
    vertex_array,
)
from app.render.view import View
from model.scene.scene import Scene

RADIUS = 0.5  # of a particle, in rest distances
SHINE = 0.12
LEAST, MOST = 2.0, 40.0  # pixels of a disc
WATER = (0.16, 0.42, 0.72)  # the first fluid; others have the colours of bodies


def fluid_colours(scene: Scene) -> np.ndarray:
    """(fluids, 3) float32."""
    others = [colours.BODIES[number % len(colours.BODIES)] for number in range(len(scene.fluids) - 1)]
    return np.array([WATER, *others], np.float32)


class FluidView(View):
    """See View. There is one way of drawing it."""

    lines = True  # no surface, and so no normals

    def __init__(self, scene: Scene, detail: Detail = FINE):
        super().__init__(scene, detail)
        found = scene.fluid_set
        self._colours = fluid_colours(scene)
        fluid = np.asarray(found.fluid)
        ends = np.flatnonzero(np.diff(fluid, prepend=-1))
        self._ranges = [(int(a), int(b - a), int(fluid[a])) for a, b in zip(ends, [*ends[1:], len(fluid)], strict=True)]
        position = self.vertices.position_buffer
        self._buffers = [static_buffer(np.zeros(1, np.uint32))]
        self._points = vertex_array(position, self._buffers[0], None, scene.dimensions)
        self._arrays = [self._points]
        if not self.space:
            return
        look = np.column_stack([self._colours[fluid], np.full(len(fluid), RADIUS * found.spacing)])
        self._buffers.append(static_buffer(np.ascontiguousarray(look, np.float32)))
        self._spheres = square_array(position, self._buffers[1])
        self._arrays.append(self._spheres)
        self._lit_spheres = Lit(body_shaders.SPHERE_VERTEX, body_shaders.SPHERE_FRAGMENT)
        self._shadow = shader_program(body_shaders.SPHERE_SHADOW_VERTEX, body_shaders.SPHERE_SHADOW_FRAGMENT)
        self._scenery.shadow_constants(self._shadow)
        side = np.cross(KEY, (0.0, 0.0, 1.0))
        side /= np.linalg.norm(side)
        self._shadow.use()
        self._shadow["side"], self._shadow["other"] = tuple(side), tuple(np.cross(KEY, side))
        self._shadow.stop()

    def toggle_lines(self) -> bool:
        """Nothing else is to be seen."""
        return self.lines

    def _draw_solid(self, camera: Any, strain_range: float) -> None:
        from pyglet import gl

        if not self.space:
            return
        smooth, program = self._target.samples > 1, self._lit_spheres.program
        self._lit_spheres.use(camera)
        program["upward"] = tuple(camera.axes[1].tolist())
        program["least"] = 0.0 if smooth else 0.5
        program["shine"], program["size"] = SHINE, 1.0
        if smooth:
            gl.glEnable(gl.GL_SAMPLE_ALPHA_TO_COVERAGE)
        draw_squares(self._spheres, self.scene.grid.particle_count)
        gl.glDisable(gl.GL_SAMPLE_ALPHA_TO_COVERAGE)
        program.stop()

    def _draw_shadows(self, camera: Camera3D, time: float) -> None:
        self._scenery.draw_shadows(camera, time, self.lowest, [], [self._shade])

    def _shade(self, camera: Camera3D, flatten: np.ndarray, centre: np.ndarray) -> None:
        program = self._shadow
        program.use()
        program["transform"], program["flatten"] = uniform_matrix(camera.matrix()), uniform_matrix(flatten)
        program["centre"] = tuple(centre.tolist())
        draw_squares(self._spheres, self.scene.grid.particle_count)
        program.stop()

    def _draw_over(self, camera: Any, selected: int | None) -> None:
        from pyglet import gl

        if self.space and selected is None:
            return
        self._use_points(camera, self._points)
        if not self.space:
            size = min(max(camera.scale * self.scene.grid.spacing, LEAST), MOST)
            for first, count, fluid in self._ranges:
                colour = tuple(float(part) for part in self._colours[fluid])
                self._style(size, colour, colour, 0.0)
                gl.glDrawArrays(gl.GL_POINTS, first, count)
        if selected is not None:
            self._ring(selected)
        self._point_program.stop()

    def delete(self) -> None:
        """Free the buffers."""
        delete_all(self._arrays, self._buffers)
        super().delete()
