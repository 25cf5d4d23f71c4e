"""Draws fluids into the current OpenGL context: their surface, or particles as lit spheres, in a plane as discs.

Each fluid has its colour, or particles are coloured by speed or by how far they are compressed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softlab.app.render import colours
from softlab.app.render.camera import Camera, Camera2D
from softlab.app.render.camera3d import Camera3D
from softlab.app.render.detail import FINE, Detail
from softlab.app.render.fluid.foam import NAMED, FoamLayer
from softlab.app.render.fluid.plane import PlaneFluid
from softlab.app.render.fluid.surface import FluidSurface
from softlab.app.render.particle_colours import of_numbers
from softlab.app.render.spheres import Spheres
from softlab.app.render.vertex_arrays import delete_all, square_array, static_buffer, vertex_array
from softlab.app.render.view import Shining, View
from softlab.model.base.errors import InputError
from softlab.model.core.simulation import Simulation
from softlab.model.fluid.foam import FoamPoints
from softlab.model.fluid.measure import density_errors
from softlab.model.geometry.anisotropy import ellipsoids
from softlab.model.particles.fluid_set import FluidSet
from softlab.model.scene.scene import Scene

COLOURINGS = ("fluid", "speed", "density")  # the first is how fluids are shown at first
TITLES = {"speed": "speed, m/s", "density": "density over that at rest, less 1, %"}
LEAST = {"speed": 1e-2, "density": 1e-3}  # m/s, 1: the smallest range
RANGE_QUANTILE = 0.98  # of the particles that the range holds
VIEW_OPTIONS = ("surface", "particles", "foam", *COLOURINGS)
RADIUS = 0.5  # of a particle, in rest distances
WETTED = 0.9  # likewise, of what its surface is made of
SHADOW = 0.8  # of the radius of an ellipsoid, of its shadow: 0.72 rest distances, so that a square lattice has no gaps
WATER = 1000.0  # kg/m^3
ABSORBED = (
    (5.2, 2.1, 0.7),
    (0.5, 1.1, 5.5),
    (4.5, 1.0, 3.0),
    (0.8, 3.5, 5.0),
)  # over the scene's size, of red, green, blue


def water_first(fluid_set: FluidSet) -> np.ndarray:
    """Return an index per fluid (fluids,): 0, drawn in blue, for the density nearest to water's, the others in the
    order of the file."""
    density = np.array([part.density for part in fluid_set.parts])
    water, number = int(np.abs(np.log(density / WATER)).argmin()), np.arange(len(density))
    return np.where(number == water, 0, number + (number < water))


def fluid_colours(number: np.ndarray) -> np.ndarray:
    """Return the colours (n, 3) float32 of fluids by the indices of `water_first`: the first is blue, the second amber,
    by the absorption ABSORBED."""
    return of_numbers(np.where(number < 2, 1 - number, number))


def has_surface(scene: Scene) -> bool:
    """Return False for a fluid that fills a plane which repeats along both axes."""
    return scene.dimensions == 3 or scene.domain is None or len(scene.domain.repeats) < 2


class FluidView(View):
    """A View of fluids. `lines`: particles are drawn instead of a surface; `foam`: its points are
    shown. `colouring`: of COLOURINGS; a surface always shows the first one. `shaped`: the surface's particles are
    ellipsoids, which costs 0.1 s per 10 000 particles on the host, instead of balls."""

    subject, colourings = "fluid", COLOURINGS
    options = ("lines", "foam")

    def __init__(self, scene: Scene, detail: Detail = FINE, shaped: bool = False):
        super().__init__(scene, detail)
        fluid_set = scene.fluid_set
        self.shaped, self.colouring, self._most = shaped, COLOURINGS[0], 0.0
        self.lines = not has_surface(scene)
        self._time = 0.0  # of what a plane's colliders are drawn at
        self._number = water_first(fluid_set)
        self._fluid_colours = fluid_colours(self._number[fluid_set.fluid])
        self._radius = RADIUS * fluid_set.spacing
        self._buffers = [static_buffer(self._appearance(self._fluid_colours)), static_buffer(np.zeros(1, np.uint32))]
        self._points = vertex_array(self.vertices.position_buffer, self._buffers[1], dimensions=scene.dimensions)
        if not self.space:
            self._plane = PlaneFluid(scene, self.vertices.position_buffer, self._buffers[0])
        else:
            self._discs = square_array(self.vertices.position_buffer, self._buffers[0])
            self._balls = Spheres(self._scenery)
            position = self.vertices.position_buffer
            if shaped:  # the middles of ellipsoids lie elsewhere
                position = static_buffer(np.zeros((fluid_set.particle_count, 3), np.float32))
                self._buffers.append(position)
            self._surface = FluidSurface(position, fluid_set.particle_count)
            self._shadows = square_array(position, self._surface.appearance_buffer)
            self._taken = np.array(ABSORBED)[self._number[fluid_set.fluid] % len(ABSORBED)] / fluid_set.extent
            self._surface.set_appearance(WETTED * fluid_set.spacing, self._taken)
        self._foam = FoamLayer(scene)
        self.foam = scene.foam is not None
        self.upload(fluid_set.position)

    def _appearance(self, colour: np.ndarray) -> np.ndarray:
        """Return colours and radii [m] of the particles, (particles, 4) float32."""
        radius = np.full((len(colour), 1), self._radius)
        return np.ascontiguousarray(np.concatenate([colour, radius], axis=1), np.float32)

    def _lits(self) -> list[Shining]:
        return [*super()._lits(), self._balls, self._surface]

    # ------------------------------------------------------------------ how it looks

    def toggle_lines(self) -> bool:
        """Switch between particles and surface. Returns True if particles are shown now."""
        self.lines = not self.lines
        self.colour_by(self.colouring)
        return self.lines

    def set_view_options(self, names: Sequence[str]) -> None:
        """Apply names of VIEW_OPTIONS; each replaces the others of its kind. Raises InputError."""
        for name in names:
            if name not in VIEW_OPTIONS:
                raise InputError(f"look {name}: must be one of {', '.join(VIEW_OPTIONS)}")
            if name == "foam":
                self.foam = True
            elif name in COLOURINGS:
                self.colour_by(name)
                self.lines = self.lines or name != COLOURINGS[0]
            else:
                self.lines = name == "particles"

    def toggle_foam(self) -> bool:
        """Show or hide spray, foam and bubbles. Returns True if they are shown now."""
        self.foam = not self.foam
        self._foam.points.forget()
        return self.foam

    def show_foam(self, points: FoamPoints) -> None:
        """Draw these foam particles, updated by the caller, instead of those that the view computes."""
        self._foam.points = points

    def next_colouring(self) -> None:
        """Change the colouring: by fluid, by speed, by density, in turn."""
        self.colour_by(COLOURINGS[(COLOURINGS.index(self.colouring) + 1) % len(COLOURINGS)])

    def colour_by(self, name: str) -> None:
        """Colour by one of COLOURINGS, from the next upload on."""
        self.colouring, self._most = name, 0.0
        self.vertices.send(self._buffers[0], self._appearance(self._fluid_colours))

    @property
    def shows_levels(self) -> bool:
        return self.lines and self.colouring in TITLES

    def level_legend(self) -> tuple[str, float] | None:
        if not self.shows_levels or not self._most:
            return None
        return TITLES[self.colouring], self._most * (100 if self.colouring == "density" else 1)

    def name_legend(self) -> tuple[tuple[str, tuple[float, float, float]], ...]:
        """Return the names of several fluids and, with particles, of spray, foam and bubbles."""
        fluid_set, shown = self.scene.fluid_set, self.colouring == COLOURINGS[0] or not self.lines
        fluids = zip(fluid_set.names, fluid_colours(self._number).tolist(), strict=True)
        named = tuple((name, tuple(colour)) for name, colour in fluids) if shown and len(fluid_set.names) > 1 else ()
        return named + (NAMED if self.foam and self.lines else ())

    # ------------------------------------------------------------------ the state

    @property
    def wants_velocity(self) -> bool:
        """True if speeds or foam are drawn."""
        return self.foam or (self.lines and self.colouring == "speed")

    def upload(self, position: np.ndarray, normal: np.ndarray | None = None) -> None:
        """Send a state. If `know` received no velocities, the colours are those of the fluids, and the foam does not
        change."""
        self.vertices.upload_state(position, False)
        self._send(position, self._velocity)

    def upload_from(self, simulation: Simulation, position: np.ndarray | None = None) -> None:
        shaped = self.space and self.shaped and not self.lines
        if position is None and (shaped or self.foam or (self.lines and self.colouring == "density")):
            position = simulation.read("position")
        self.vertices.upload(simulation, False, position)
        self.know(simulation.read("velocity") if self.wants_velocity else None, simulation.time)
        self._send(position, self._velocity)

    def _send(self, position: np.ndarray | None, velocity: np.ndarray | None) -> None:
        """Send the colours of levels and the ellipsoids, if they are shown and known."""
        level, self._velocity = None, None
        if self.foam and velocity is not None and position is not None:
            self._foam.follow(position, velocity, self._when)
        if velocity is not None and self.lines and self.colouring == "speed":
            level = np.linalg.norm(velocity, axis=1)
        elif self.lines and self.colouring == "density" and position is not None and np.isfinite(position).all():
            level = np.maximum(density_errors(self.scene, position), 0.0)
        if level is not None:
            known = level[np.isfinite(level)]
            worst = float(np.quantile(known, RANGE_QUANTILE)) if len(known) else 0.0
            self._most = max(self._most, colours.round_up(max(worst, LEAST[self.colouring])))
            self.vertices.send(self._buffers[0], self._appearance(colours.level_colours(level, self._most)))
        if self.space and self.shaped and not self.lines and position is not None and np.isfinite(position).all():
            fluid_set = self.scene.fluid_set
            active = fluid_set.there(position)  # those that wait are in one place, out of sight
            middle, axes = np.array(position, np.float64), np.tile(np.eye(3) * self._radius, (len(position), 1, 1))
            if active.any():
                middle[active], axes[active] = ellipsoids(
                    position[active], WETTED * fluid_set.spacing, 2 * fluid_set.spacing
                )
            self.vertices.send(self._buffers[2], middle)
            self._surface.set_appearance(WETTED * fluid_set.spacing, self._taken, axes)

    # ------------------------------------------------------------------ the picture

    def _draw_solid(self, camera: Camera, strain_range: float) -> None:
        if self.lines and self.space:
            self._balls.draw(camera, self._target.samples > 1, [(self._discs, self.scene.grid.particle_count, 1.0)])
        elif not self.space:
            assert isinstance(camera, Camera2D)
            if self.lines:
                self._plane.draw_particles(camera)
            else:
                self._plane.draw_surface(camera, self._time)
            if self.foam:
                self._foam.draw(camera)
            self._plane.draw_colliders(camera, self._time)

    def draw(self, camera: Camera, strain_range: float, selected: int | None = None, time: float = 0.0) -> None:
        if not self.space:
            self._time = time
        super().draw(camera, strain_range, selected, time)

    def _draw_shadows(self, camera: Camera, time: float) -> None:
        def shade(camera: Camera, flatten: np.ndarray, centre: np.ndarray) -> None:
            balls = (self._discs, 1.0) if self.lines else (self._shadows, SHADOW)
            self._balls.shade(camera, flatten, centre, (balls[0], self.scene.grid.particle_count, balls[1]))

        self._scenery.draw_shadows(camera, time, self.lowest, [], [shade])

    def _draw_over(self, camera: Camera, selected: int | None) -> None:
        from pyglet import gl

        if self.space and not self.lines:
            frame = (self.onto or self._target).frame
            assert isinstance(camera, Camera3D)
            self._surface.passes(camera, frame)
            self._surface.shade(camera, frame)
            gl.glEnable(gl.GL_BLEND)
            gl.glEnable(gl.GL_DEPTH_TEST)
        if self.space and self.foam:
            self._foam.draw(camera, None if self.lines else self._surface)
        if selected is not None:
            self._use_points(camera, self._points)
            self._ring(selected)
            self._point_program.stop()

    def delete(self) -> None:
        """Free the buffers."""
        if self.space:
            self._surface.delete()
        else:
            self._plane.delete()
        self._foam.delete()
        delete_all([self._points, *([self._discs, self._shadows] if self.space else [])], self._buffers)
        super().delete()
