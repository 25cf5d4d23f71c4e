"""Draws fluids into the current OpenGL context: in space their surface, or particles as lit spheres; in a plane particles as
discs. Each fluid of a colour of its own, or particles coloured by speed or by how far they are compressed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from app.render import colours, shaders
from app.render.camera3d import Camera3D
from app.render.detail import FINE, Detail
from app.render.fluid.outlines import outlines
from app.render.fluid.shaders import DISC_FRAGMENT, DISC_VERTEX
from app.render.fluid.surface import FluidSurface
from app.render.opengl import shader_program
from app.render.particle_colours import of_numbers
from app.render.spheres import Spheres
from app.render.vertex_arrays import (
    delete_all,
    draw_elements,
    draw_squares,
    square_array,
    static_buffer,
    uniform_matrix,
    vertex_array,
)
from app.render.view import View
from model.core.errors import InputError
from model.core.simulation import Simulation
from model.fluid.measure import density_errors
from model.geometry.anisotropy import ellipsoids
from model.scene.scene import Scene

COLOURINGS = ("fluid", "speed", "density")  # the first is how fluids are shown at first
TITLES = {"speed": "speed, m/s", "density": "density over that at rest, less 1, %"}
LEAST = {"speed": 1e-2, "density": 1e-3}  # m/s, 1: the smallest range
SHARE = 0.98  # of the particles that the range holds
LOOKS = ("surface", "particles", *COLOURINGS)
RADIUS = 0.5  # of a particle, in rest distances
WETTED = 0.9  # likewise, of what its surface is made of
ABSORBED = (
    (5.2, 1.5, 0.7),
    (0.9, 3.0, 6.0),
    (1.2, 5.0, 2.0),
    (4.0, 1.0, 3.5),
)  # over the scene's size, of red, green, blue


class FluidView(View):
    """See View; `lines`: as particles and not as a surface, in a plane always. `colouring`: of COLOURINGS, of which a surface
    shows the first alone. `shaped`: the surface's particles are ellipsoids, which takes the host a tenth of a second for
    10 000 particles, else balls."""

    subject, colourings = "fluid", COLOURINGS

    def __init__(self, scene: Scene, detail: Detail = FINE, shaped: bool = False):
        super().__init__(scene, detail)
        found = scene.fluid_set
        self.shaped, self.lines, self.colouring, self._most = shaped, not self.space, COLOURINGS[0], 0.0
        self._time = 0.0  # of what a plane's colliders are drawn at
        self._own = of_numbers(found.fluid + 1)  # the first is blue
        self._radius = RADIUS * found.spacing
        self._buffers = [static_buffer(self._look(self._own)), static_buffer(np.zeros(1, np.uint32))]
        self._points = vertex_array(self.vertices.position_buffer, self._buffers[1], dimensions=scene.dimensions)
        if not self.space:
            self._discs = square_array(self.vertices.position_buffer, self._buffers[0], 2)
            self._disc_program = shader_program(DISC_VERTEX, DISC_FRAGMENT)
            self._line_program = shader_program(shaders.VERTEX, shaders.LINE_FRAGMENT)
            lines = outlines(scene, 0.0)
            self._buffers += [static_buffer(lines), static_buffer(np.arange(len(lines), dtype=np.uint32))]
            self._outlines = vertex_array(self._buffers[-2], self._buffers[-1], dimensions=2)
        else:
            self._discs = square_array(self.vertices.position_buffer, self._buffers[0])
            self._balls = Spheres(self._scenery)
            position = self.vertices.position_buffer
            if shaped:  # the middles of ellipsoids lie elsewhere
                position = static_buffer(np.zeros((found.particle_count, 3), np.float32))
                self._buffers.append(position)
            self._surface = FluidSurface(position, found.particle_count)
            self._taken = np.array(ABSORBED)[found.fluid % len(ABSORBED)] / found.extent
            self._surface.set_look(WETTED * found.spacing, self._taken)
        self.upload(found.position)

    def _look(self, colour: np.ndarray) -> np.ndarray:
        """(particles, 4) float32: colours and radii [m]."""
        radius = np.full((len(colour), 1), self._radius)
        return np.ascontiguousarray(np.concatenate([colour, radius], axis=1), np.float32)

    def _lits(self) -> list[Any]:
        return [*super()._lits(), self._balls, self._surface]

    # ------------------------------------------------------------------ how it looks

    def toggle_lines(self) -> bool:
        """Particles in place of the surface, or the surface; whether it is particles now."""
        self.lines = not self.space or not self.lines
        return self.lines

    def look(self, names: Sequence[str]) -> None:
        """As LOOKS say, each instead of those of its kind. Raises InputError."""
        for name in names:
            if name not in LOOKS:
                raise InputError(f"look {name}: must be one of {', '.join(LOOKS)}")
            if name in COLOURINGS:
                self.colour_by(name)
                self.lines = self.lines or name != COLOURINGS[0]
            else:
                self.lines = not self.space or name == "particles"

    def next_colouring(self) -> None:
        """By fluid, by speed, by density."""
        self.colour_by(COLOURINGS[(COLOURINGS.index(self.colouring) + 1) % len(COLOURINGS)])

    def colour_by(self, name: str) -> None:
        """One of COLOURINGS, from the next upload on."""
        self.colouring, self._most = name, 0.0
        self.vertices.send(self._buffers[0], self._look(self._own))

    def level_legend(self) -> tuple[str, float] | None:
        """See View."""
        if not self.lines or self.colouring not in TITLES or not self._most:
            return None
        return TITLES[self.colouring], self._most * (100 if self.colouring == "density" else 1)

    # ------------------------------------------------------------------ the state

    def upload(self, position: np.ndarray, normal: np.ndarray | None = None) -> None:
        """See View. Speeds are not known of a state that no simulation holds: then the colours are those of the fluids."""
        self.vertices.upload_state(position, False)
        self._send(position, None)

    def upload_from(self, simulation: Simulation, position: np.ndarray | None = None) -> None:
        """See View."""
        shaped = self.space and self.shaped and not self.lines
        if position is None and (shaped or self.colouring == "density"):
            position = simulation.read("position")
        self.vertices.upload(simulation, False, position)
        wanted = self.lines and self.colouring == "speed"
        self._send(position, simulation.read("velocity") if wanted else None)

    def _send(self, position: np.ndarray | None, velocity: np.ndarray | None) -> None:
        """Colours by numbers, and ellipsoids, as far as they are shown and known."""
        level = None
        if velocity is not None:
            level = np.linalg.norm(velocity, axis=1)
        elif self.lines and self.colouring == "density" and position is not None and np.isfinite(position).all():
            level = np.maximum(density_errors(self.scene, position), 0.0)
        if level is not None:
            known = level[np.isfinite(level)]
            worst = float(np.quantile(known, SHARE)) if len(known) else 0.0
            self._most = max(self._most, colours.round_up(max(worst, LEAST[self.colouring])))
            self.vertices.send(self._buffers[0], self._look(colours.level_colours(level, self._most)))
        if self.space and self.shaped and not self.lines and position is not None and np.isfinite(position).all():
            found = self.scene.fluid_set
            there = found.there(position)  # those that wait are in one place, out of sight
            middle, axes = np.array(position, np.float64), np.tile(np.eye(3) * self._radius, (len(position), 1, 1))
            if there.any():
                middle[there], axes[there] = ellipsoids(position[there], WETTED * found.spacing, 2 * found.spacing)
            self.vertices.send(self._buffers[2], middle)
            self._surface.set_look(WETTED * found.spacing, self._taken, axes)

    # ------------------------------------------------------------------ the picture

    def _draw_solid(self, camera: Any, strain_range: float) -> None:
        if self.lines and self.space:
            self._balls.draw(camera, self._target.samples > 1, [(self._discs, self.scene.grid.particle_count, 1.0)])
        elif self.lines:
            self._draw_discs(camera)
            self._draw_outlines(camera)

    def draw(self, camera: Any, strain_range: float, selected: int | None = None, time: float = 0.0) -> None:
        """See View."""
        if not self.space:
            self._time = time
        super().draw(camera, strain_range, selected, time)

    def _draw_outlines(self, camera: Any) -> None:
        """The colliders of a plane."""
        from pyglet import gl

        lines = outlines(self.scene, self._time)
        self.vertices.send(self._buffers[2], lines)
        program = self._line_program
        program.use()
        program["transform"], program["toward"], program["colour"] = uniform_matrix(camera.matrix()), 0.0, colours.FAINT
        draw_elements(self._outlines, gl.GL_LINES, len(lines))
        program.stop()

    def _draw_discs(self, camera: Any) -> None:
        program = self._disc_program
        program.use()
        program["transform"], program["pixels"] = uniform_matrix(camera.matrix()), camera.scale
        draw_squares(self._discs, self.scene.grid.particle_count)
        program.stop()

    def _draw_shadows(self, camera: Camera3D, time: float) -> None:
        def shade(camera: Camera3D, flatten: np.ndarray, centre: np.ndarray) -> None:
            self._balls.shade(camera, flatten, centre, self._discs, self.scene.grid.particle_count)

        self._scenery.draw_shadows(camera, time, self.lowest, [], [shade])

    def _draw_over(self, camera: Any, selected: int | None) -> None:
        from pyglet import gl

        if self.space and not self.lines:
            self._surface.passes(camera)
            self._surface.shade(camera, self._target.frame)
            gl.glEnable(gl.GL_BLEND)
            gl.glEnable(gl.GL_DEPTH_TEST)
        if selected is not None:
            self._use_points(camera, self._points)
            self._ring(selected)
            self._point_program.stop()

    def delete(self) -> None:
        """Free the buffers."""
        if self.space:
            self._surface.delete()
        delete_all([self._discs, self._points, *([] if self.space else [self._outlines])], self._buffers)
        super().delete()
