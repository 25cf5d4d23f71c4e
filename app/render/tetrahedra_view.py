"""Draws tetrahedral bodies, and a cloth beside them, into the current OpenGL context: their skins, deformed by the
tetrahedra, or the outer faces of the tetrahedra, coloured by body, stress or strain; or the edges of the tetrahedra,
coloured by strain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softlab.app.render import colours, shaders3d
from softlab.app.render.camera import Camera
from softlab.app.render.detail import FINE, Detail
from softlab.app.render.particle_colours import of_numbers
from softlab.app.render.scenery import Drawn, Lit
from softlab.app.render.sheet_view import SheetView
from softlab.app.render.vertex_arrays import delete_all, draw_elements, refill, static_buffer, vertex_array
from softlab.app.render.view import Shining
from softlab.model.base.errors import InputError
from softlab.model.core.build import pinned_indices
from softlab.model.core.simulation import Simulation
from softlab.model.geometry.normals import mesh_normals
from softlab.model.particles.tetrahedra.skin import Skin, plain_skin
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.material import at_particles, largest_strain, von_mises

SHINE = 0.12
UNLIT = 0.6  # of a colour that is a number: what light and shade leave alone
COLOURINGS = ("body", "stress", "strain")  # the first is how bodies are shown at first
TITLES = {"stress": "von Mises stress / {}Pa", "strain": "largest strain of a tetrahedron"}
LEVELS = {"stress": von_mises, "strain": largest_strain}
LEAST = {"stress": 1e-3, "strain": 1e-4}  # Pa, 1: the smallest range
RANGE_QUANTILE = 0.98  # of the vertices that the range holds
INNER_PIN = 7.0  # pixels, of a pin that is seen through what it lies in
VIEW_OPTIONS = ("skin", "mesh", "edges", *COLOURINGS)


def outer_faces(tetrahedra: TetrahedraSet) -> Skin:
    """Return the surface of the tetrahedra, and that of a cloth, as a skin whose points are the particles."""
    body = np.searchsorted(tetrahedra.first_particle, tetrahedra.surface[:, 0], side="right") - 1
    faces = tuple(tetrahedra.surface[body == k] for k in range(len(tetrahedra.names)))
    return plain_skin(np.arange(tetrahedra.particle_count), faces)


class _Surface:
    """A skin on the graphics card: points, normals and colours, renewed by `send`; `drawn`: arguments of
    `draw_elements`."""

    def __init__(self, skin: Skin, first_colour: int = 0):
        from pyglet import gl

        self.skin = skin
        body = np.zeros(skin.count, np.int64)
        for number, faces in enumerate(skin.triangles):
            body[faces] = first_colour + number
        self._body_colours = of_numbers(body)
        zero = np.zeros((skin.count, 3), np.float32)
        self._buffers = [static_buffer(zero), static_buffer(zero), static_buffer(self._body_colours)]
        self._buffers.append(static_buffer(skin.faces.astype(np.uint32)))
        array = vertex_array(self._buffers[0], self._buffers[3], self._buffers[1], colour=self._buffers[2])
        self.drawn: Drawn = array, gl.GL_TRIANGLES, skin.faces.size

    def send(self, position: np.ndarray, level: np.ndarray | None, most: float) -> None:
        """Send the positions of the particles (particles, 3) [m] and their levels (particles,) from 0 to `most`; None:
        the colours of the bodies."""
        with np.errstate(over="ignore", invalid="ignore"):
            points = self.skin.points(position)
            normals = mesh_normals(points, self.skin.faces)
            refill(self._buffers[0], np.ascontiguousarray(points, np.float32))
            refill(self._buffers[1], np.ascontiguousarray(normals, np.float32))
        if level is not None:
            carried = np.einsum("pk,pk->p", self.skin.weights, level[self.skin.corners])
            refill(self._buffers[2], colours.level_colours(carried, most))

    def plain(self) -> None:
        """Restore the bodies' colours."""
        refill(self._buffers[2], self._body_colours)

    def delete(self) -> None:
        """Free the buffers."""
        delete_all([self.drawn[0]], self._buffers)


class TetrahedraView(SheetView):
    """A View of tetrahedral bodies. `lines`: the edges of the tetrahedra are drawn instead of surfaces. Particles, pins
    and edges are drawn like those of a sheet. `skin`: skins, or else the outer faces of the tetrahedra; `colouring`: of
    COLOURINGS, whose range only grows."""

    subject, colourings = "tetrahedra", COLOURINGS
    options = ("skin", "lines")

    def __init__(self, scene: Scene, detail: Detail = FINE, first_colour: int = 0):
        """Prepare the view. `first_colour`: number of the first body's colour among the colours of bodies."""

        super().__init__(scene, detail)
        tetrahedra = scene.tetrahedra_set
        self.skin, self.colouring, self._most = True, COLOURINGS[0], 0.0
        self._surfaces = {
            True: _Surface(tetrahedra.skin, first_colour),
            False: _Surface(outer_faces(tetrahedra), first_colour),
        }
        self._inner_pins = self._inner_pins_of(scene)
        self._tinted = Lit(shaders3d.TINTED_VERTEX, shaders3d.TINTED_FRAGMENT)

    def _inner_pins_of(self, scene: Scene) -> Drawn:
        """Return the pins that no surface shows, such as bones."""
        return self._drawn_points(np.setdiff1d(pinned_indices(scene.grid), self.scene.tetrahedra_set.surface))

    def pin(self, scene: Scene) -> None:
        if scene is not self._pinned:
            delete_all([self._inner_pins[0]], [])
            self._inner_pins = self._inner_pins_of(scene)
        super().pin(scene)

    def _lits(self) -> list[Shining]:
        return [*super()._lits(), self._tinted]

    # ------------------------------------------------------------------ how they look

    def set_view_options(self, names: Sequence[str]) -> None:
        """Apply names of VIEW_OPTIONS; each replaces the others of its kind. Raises InputError."""
        for name in names:
            if name not in VIEW_OPTIONS:
                raise InputError(f"look {name}: must be one of {', '.join(VIEW_OPTIONS)}")
            if name in COLOURINGS:
                self._colour_by(name)
            else:
                self.skin, self.lines = name != "mesh", name == "edges"

    def toggle_skin(self) -> bool:
        """Exchange skins and the outer faces of the tetrahedra. Returns True if skins are shown now."""
        self.skin = not self.skin
        return self.skin

    def next_colouring(self) -> None:
        """Change the colouring: by body, by stress, by strain, in turn."""
        self._colour_by(COLOURINGS[(COLOURINGS.index(self.colouring) + 1) % len(COLOURINGS)])

    def _colour_by(self, name: str) -> None:
        self.colouring, self._most = name, 0.0
        for surface in self._surfaces.values():
            surface.plain()

    def level_legend(self) -> tuple[str, float] | None:
        if self.lines or self.colouring not in LEVELS:
            return None
        if self.colouring == "strain":
            return TITLES["strain"], self._most
        size, prefix = next((pair for pair in ((1e9, "G"), (1e6, "M"), (1e3, "k")) if self._most >= pair[0]), (1.0, ""))
        return TITLES["stress"].format(prefix), self._most / size

    # ------------------------------------------------------------------ the frame

    def upload(self, position: np.ndarray, normal: np.ndarray | None = None) -> None:
        """Send a state, and the surfaces computed from the positions (particles, 3) [m]."""
        self.vertices.upload_state(position, False)
        self._send(position)

    def upload_from(self, simulation: Simulation, position: np.ndarray | None = None) -> None:
        if not self.lines and position is None:
            position = simulation.read("position")  # once, for particles and skins
        self.vertices.upload(simulation, False, position)
        if not self.lines and position is not None:
            self._send(position)

    def _send(self, position: np.ndarray) -> None:
        level = None
        if self.colouring in LEVELS:
            with np.errstate(over="ignore", invalid="ignore"):
                tetrahedra = self.scene.tetrahedra_set
                level = at_particles(tetrahedra, LEVELS[self.colouring](tetrahedra, position))
            known = level[np.isfinite(level)]
            worst = float(np.quantile(known, RANGE_QUANTILE)) if len(known) else 0.0
            self._most = max(self._most, colours.round_up(max(worst, LEAST[self.colouring])))
        self._surfaces[self.skin].send(position, level, self._most)

    def _draw_solid(self, camera: Camera, strain_range: float) -> None:
        if self.lines:
            self._draw_springs(camera, strain_range)
            return
        self._tinted.use(camera)
        program = self._tinted.program
        program["shine"], program["shift"] = SHINE, (0.0, 0.0, 0.0)
        program["unlit"] = UNLIT if self.colouring in LEVELS else 0.0
        draw_elements(*self._surfaces[self.skin].drawn)
        self._tinted.program.stop()

    def _draw_over(self, camera: Camera, selected: int | None) -> None:
        from pyglet import gl

        super()._draw_over(camera, selected)
        if self.lines or not self._inner_pins[2]:
            return
        gl.glDisable(gl.GL_DEPTH_TEST)
        self._use_points(camera, self._inner_pins[0])
        self._style(INNER_PIN, colours.PIN, colours.PIN, 0.0, square=True)
        draw_elements(*self._inner_pins)
        self._point_program.stop()
        gl.glEnable(gl.GL_DEPTH_TEST)

    def _draw_shadows(self, camera: Camera, time: float) -> None:
        shown = [drawn for drawn, _ in self._lines] if self.lines else [self._surfaces[self.skin].drawn]
        self._scenery.draw_shadows(camera, time, self.lowest, shown)

    def delete(self) -> None:
        """Free the buffers."""
        for surface in self._surfaces.values():
            surface.delete()
        delete_all([self._inner_pins[0]], [])
        super().delete()
