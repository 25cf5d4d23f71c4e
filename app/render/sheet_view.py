"""Draws one sheet into the current OpenGL context: a grid in a plane as springs coloured by strain; a cloth in space as
a lit surface or as springs, with colliders and a ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.app.render import colours, shaders
from softlab.app.render.camera import Camera
from softlab.app.render.detail import FINE, Detail
from softlab.app.render.drawn_springs import drawn_lines
from softlab.app.render.opengl import shader_program
from softlab.app.render.scenery import Drawn
from softlab.app.render.vertex_arrays import delete_all, draw_elements, static_buffer, uniform_matrix, vertex_array
from softlab.app.render.view import View
from softlab.model.core.build import pinned_indices
from softlab.model.scene.scene import Scene

WIDE_UP_TO = 200_000  # springs: beyond it, plain lines, which software drivers draw much faster
POINTS_FROM = 14.0  # pixels between neighbours from which on the masses are drawn as points
ROPE_POINTS_FROM = 6.0  # the same of a rope, beside whose masses nothing lies
HEAVIEST = 5.0  # times the size of the others: no load is drawn larger
PIN_SIZE, PIN_MORE = 9.0, 4.0  # pixels, at least, and than a mass: a pin is always larger than one
PIN_TOWARD, MASS_TOWARD = 0.002, 0.0005  # in clip depth: pins and masses show on the surface that they are part of


@dataclass(frozen=True)
class Sizes:
    """Sizes of half a `spring`'s width and of a `mass`: (fraction of the distance of neighbours, least, most [pixels]);
    `soft` [pixels]: width of a spring's fading edges, where pixels have one sample."""

    spring: tuple[float, float, float]
    mass: tuple[float, float, float]
    soft: float


IN_PLANE = Sizes((0.05, 0.6, 2.5), (0.28, 3.0, 16.0), 1.0)
IN_SPACE = Sizes((0.035, 0.5, 2.0), (0.2, 3.0, 12.0), 0.0)
OF_A_ROPE = Sizes((0.035, 0.8, 2.0), (0.4, 4.0, 12.0), 0.0)


def of_distance(apart: float, size: tuple[float, float, float]) -> float:
    """Return the pixels of a `size` if neighbours are `apart` pixels apart."""
    fraction, least, most = size
    return min(max(fraction * apart, least), most)


def heavy_masses(scene: Scene) -> list[tuple[np.ndarray, float]]:
    """Return [(index (1,) uint32, width relative to the other masses)] of the loads that are heavier than the others;
    the width is that of a ball of the same density, up to HEAVIEST."""
    heavy = []
    for load in scene.loads.values():
        wide = min(float(np.cbrt(load.mass / scene.grid.mass)), HEAVIEST)
        if wide > 1:
            heavy.append((np.array([load.at[0] * scene.grid.columns + load.at[1]], np.uint32), wide))
    return heavy


class SheetView(View):
    """A View of a sheet. `lines`: springs are drawn instead of a surface; in a plane always."""

    def __init__(self, scene: Scene, detail: Detail = FINE):
        from pyglet import gl

        super().__init__(scene, detail)
        lines = drawn_lines(scene)
        self.springs = sum(len(pairs) for pairs, _ in lines)
        self._rope = self.space and 1 in (scene.grid.rows, scene.grid.columns)
        self._sizes = OF_A_ROPE if self._rope else IN_SPACE if self.space else IN_PLANE
        self._wide = self.springs <= WIDE_UP_TO
        geometry = shaders.WIDE_SPRINGS if self._wide else shaders.THIN_SPRINGS
        self._spring_program = shader_program(shaders.VERTEX, shaders.SPRING_FRAGMENT, geometry)
        faces = scene.grid.triangles() if self.space else np.zeros((0, 3), np.uint32)
        self.lines = not len(faces)
        self._buffers: list[int] = []
        self._surface = self._drawn(faces, gl.GL_TRIANGLES)
        self._pinned, self._pins = scene, self._drawn_points(pinned_indices(scene.grid))
        self._lines = [(self._drawn(pairs, gl.GL_LINES), rest) for pairs, rest in lines]
        self._heavy = [(self._drawn_points(index), factor) for index, factor in heavy_masses(scene)]

    def pin(self, scene: Scene) -> None:
        if scene is not self._pinned:
            delete_all([self._pins[0]], [])
            self._pinned, self._pins = scene, self._drawn_points(pinned_indices(scene.grid))

    def _drawn_points(self, particles: np.ndarray) -> Drawn:
        from pyglet import gl

        return self._drawn(particles.astype(np.uint32), gl.GL_POINTS)

    def _drawn(self, elements: np.ndarray, mode: int) -> Drawn:
        self._buffers.append(static_buffer(elements))
        normal = self.vertices.normal_buffer if self.space else None
        array = vertex_array(self.vertices.position_buffer, self._buffers[-1], normal, self.scene.dimensions)
        return array, mode, elements.size

    def toggle_lines(self) -> bool:
        """Exchange surface and springs. Returns True if springs are shown now. A sheet without springs, or without a
        surface, has no choice."""
        if self._lines and self._surface[2]:
            self.lines = not self.lines
        return self.lines

    def _draw_solid(self, camera: Camera, strain_range: float) -> None:
        if self.lines:
            self._draw_springs(camera, strain_range)
            return
        self._lit.use(camera)
        self._lit.set_material(colours.CLOTH_FRONT, colours.CLOTH_BACK, 0.06, np.zeros(3))
        draw_elements(*self._surface)
        self._lit.program.stop()

    def _draw_shadows(self, camera: Camera, time: float) -> None:
        shown = [drawn for drawn, _ in self._lines] if self.lines else [self._surface]
        self._scenery.draw_shadows(camera, time, self.lowest, shown)

    def _draw_springs(self, camera: Camera, strain_range: float) -> None:
        program = self._spring_program
        program.use()
        program["transform"] = uniform_matrix(camera.matrix())
        program["toward"] = 0.0
        program["strain_range"] = strain_range
        program["stops"] = tuple(tuple(float(part) for part in stop) for stop in colours.STOPS)
        program["half_width"] = 0.5
        if self._wide:
            program["window"], program["soft"] = (camera.width, camera.height), self._sizes.soft
            program["half_width"] = of_distance(camera.scale * self.scene.grid.spacing, self._sizes.spring)
        for drawn, rest in self._lines:
            program["inverse_rest"], program["offset"] = 1 / (rest or self.scene.grid.spacing), 1.0 if rest else 0.0
            draw_elements(*drawn)
        program.stop()

    def _draw_over(self, camera: Camera, selected: int | None) -> None:
        from pyglet import gl

        apart = self.detail.coarse * camera.scale * self.scene.grid.spacing  # pixels of the window
        size, pin = of_distance(apart, self._sizes.mass), PIN_SIZE
        self._use_points(camera, self._pins[0])
        # a bright rim would hide a thin spring's ends, and what is a mass of a rope is told without
        rim = colours.BACKGROUND if size > 5 and not self._rope else colours.INK
        if self.lines and (apart >= (ROPE_POINTS_FROM if self._rope else POINTS_FROM) or not self.springs):
            self._style(size, colours.INK, rim, MASS_TOWARD)
            gl.glDrawArrays(gl.GL_POINTS, 0, self.scene.grid.particle_count)
            pin = max(pin, size + PIN_MORE)
        for drawn, factor in self._heavy:
            gl.glBindVertexArray(drawn[0])
            self._style(size * factor, colours.INK, rim, MASS_TOWARD)
            draw_elements(*drawn)
        gl.glBindVertexArray(self._pins[0])
        if self._pins[2]:
            # rims of a dense row would hide its pins
            rim = colours.BACKGROUND if apart > PIN_SIZE * self.detail.coarse else colours.PIN
            self._style(pin, colours.PIN, rim, PIN_TOWARD, square=True)
            draw_elements(*self._pins)
        if selected is not None:
            self._ring(selected)
        self._point_program.stop()

    def delete(self) -> None:
        """Free the buffers."""
        lists = [self._surface, self._pins, *(drawn for drawn, _ in (*self._lines, *self._heavy))]
        delete_all([drawn[0] for drawn in lists], self._buffers)
        super().delete()
