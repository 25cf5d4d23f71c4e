"""Draws one cloth in space into the current OpenGL context, as a lit surface or as springs coloured by strain, with what it
collides with and a ground. The window and the off-screen pictures both draw through here."""

from __future__ import annotations

import numpy as np

from app.render import colours, shaders3d
from app.render.camera3d import Camera3D
from app.render.opengl import shader_program
from app.render.scene_view import PIN_SIZE, POINTS_FROM, WIDE_UP_TO
from app.render.space_view import SpaceView
from app.render.vertex_arrays import delete_all, draw_elements, static_buffer, uniform_matrix, vertex_array
from app.window.detail import FINE, Detail
from app.window.scenery import Drawn
from app.window.surface import drawn_lines
from model.core.build import pinned_indices
from model.core.simulation import Simulation
from model.scene.scene import Scene
from model.scene.sheets import triangles_of

PIN_TOWARD, MASS_TOWARD = 0.002, 0.0005  # in clip depth: pins and masses show on the surface that they are part of


class View3D(SpaceView):
    """See SpaceView; `lines`: as springs and not as a surface."""

    def __init__(self, scene: Scene, detail: Detail = FINE):
        from pyglet import gl

        super().__init__(scene, detail)
        lines = drawn_lines(scene)
        self.springs = sum(len(pairs) for pairs, _ in lines)
        self._wide = self.springs <= WIDE_UP_TO
        geometry = shaders3d.WIDE_SPRINGS if self._wide else shaders3d.THIN_SPRINGS
        self._spring_program = shader_program(shaders3d.VERTEX, shaders3d.SPRING_FRAGMENT, geometry)
        pins, faces = pinned_indices(scene.grid).astype(np.uint32), triangles_of(scene)
        self.lines = not len(faces)
        self._buffers: list[int] = []
        self._surface = self._drawn(faces, gl.GL_TRIANGLES)
        self._pins = self._drawn(pins, gl.GL_POINTS)
        self._lines = [(self._drawn(pairs, gl.GL_LINES), rest) for pairs, rest in lines]

    def _drawn(self, elements: np.ndarray, mode: int) -> Drawn:
        self._buffers.append(static_buffer(elements))
        array = vertex_array(self.vertices.position_buffer, self._buffers[-1], self.vertices.normal_buffer)
        return array, mode, elements.size

    def upload(self, position: np.ndarray, normal: np.ndarray | None = None) -> None:
        """Send positions (particles, 3) [m], with their normals where they are known. Raises InputError."""
        self.vertices.upload_state(position, not self.lines, normal)

    def upload_from(self, simulation: Simulation, position: np.ndarray | None = None) -> None:
        """Send the state of a simulation; `position` (particles, 3) float32, if the caller has read it already."""
        self.vertices.upload(simulation, not self.lines, position)

    def toggle_lines(self) -> bool:
        """Surface or springs; whether it is springs now. A cloth without springs, or without a surface, has no choice."""
        if self._lines and self._surface[2]:
            self.lines = not self.lines
        return self.lines

    def _draw_solid(self, camera: Camera3D, strain_range: float) -> None:
        if self.lines:
            self._draw_springs(camera, strain_range)
            return
        self._lit.use(camera)
        self._lit.look(colours.CLOTH_FRONT, colours.CLOTH_BACK, 0.06, np.zeros(3))
        draw_elements(*self._surface)
        self._lit.program.stop()

    def _draw_shadows(self, camera: Camera3D, time: float) -> None:
        shown = [drawn for drawn, _ in self._lines] if self.lines else [self._surface]
        self._scenery.draw_shadows(camera, time, self.lowest, shown)

    def _draw_springs(self, camera: Camera3D, strain_range: float) -> None:
        program = self._spring_program
        program.use()
        program["transform"] = uniform_matrix(camera.matrix())
        program["toward"] = 0.0
        program["offset"] = 1.0
        program["strain_range"] = strain_range
        program["stops"] = tuple(tuple(float(part) for part in stop) for stop in colours.STOPS)
        if self._wide:
            program["window"] = (camera.width, camera.height)
            program["half_width"] = min(max(0.035 * camera.scale * self.scene.grid.spacing, 0.5), 2.0)
        for drawn, rest in self._lines:
            program["inverse_rest"] = 1 / rest
            draw_elements(*drawn)
        program.stop()

    def _draw_over(self, camera: Camera3D, selected: int | None) -> None:
        from pyglet import gl

        apart = self.detail.coarse * camera.scale * self.scene.grid.spacing  # pixels of the window
        size = min(max(0.2 * apart, 3.0), 12.0)
        self._use_points(camera, self._pins[0])
        if self.lines and (apart >= POINTS_FROM or not self.springs):
            self._style(size, colours.INK, colours.BACKGROUND if size > 5 else colours.INK, MASS_TOWARD)
            gl.glDrawArrays(gl.GL_POINTS, 0, self.scene.grid.particle_count)
        if self._pins[2]:
            rim = colours.BACKGROUND if apart > PIN_SIZE * self.detail.coarse else colours.PIN
            self._style(PIN_SIZE, colours.PIN, rim, PIN_TOWARD, square=True)
            draw_elements(*self._pins)
        if selected is not None:
            self._ring(selected)
        self._point_program.stop()

    def delete(self) -> None:
        """Free the buffers."""
        delete_all([self._surface[0], self._pins[0], *(drawn[0] for drawn, _ in self._lines)], self._buffers)
        super().delete()
