"""Draws a scene's bodies into the current OpenGL context: particles as lit spheres, skins as lit meshes that the
clusters deform on the graphics card, with colliders and a ground. The window and off-screen pictures use it.
"""

from __future__ import annotations

from itertools import groupby

import numpy as np

from softlab.app.render import colours, shaders
from softlab.app.render.bodies import shaders as body_shaders
from softlab.app.render.bodies.skinning import ClusterFrames
from softlab.app.render.bodies.skins import ClusterTexture, Skins
from softlab.app.render.camera import Camera
from softlab.app.render.detail import FINE, Detail
from softlab.app.render.opengl import shader_program
from softlab.app.render.particle_colours import COLOURINGS, cluster_colours, particle_colours
from softlab.app.render.scenery import Lit
from softlab.app.render.spheres import Spheres, use_shadow
from softlab.app.render.vertex_arrays import (
    delete_all,
    draw_elements,
    refill,
    square_array,
    static_buffer,
    uniform_matrix,
    vertex_array,
)
from softlab.app.render.view import Shining, View
from softlab.model.core.simulation import Simulation
from softlab.model.core.spare import copies_there
from softlab.model.scene.scene import Scene

PARTICLE_RADIUS = 0.5  # of the particle spacing
SKIN_COVER = 0.22  # of the particles behind it, where both are shown
SMALL = 0.45  # times a particle's radius then, and beside clusters, so that they lie inside
SKIN_SHINE = 0.16


class BodiesView(View):
    """A View of bodies. `particles`, `skin`: at least one of them is shown; with both, the skin is transparent.
    `clusters`, `links`: the centres of clusters and the links are shown too. `colouring`: the colours of particles, of
    COLOURINGS."""

    subject, colourings = "bodies", COLOURINGS
    options = ("particles", "skin", "clusters", "links", "lines")

    def __init__(self, scene: Scene, detail: Detail = FINE):
        super().__init__(scene, detail)
        body_set = scene.body_set
        self.particles, self.skin, self.clusters, self.links = False, True, False, False
        self.colouring = COLOURINGS[0]
        self.frames = ClusterFrames(scene)
        number = str(len(colours.BODIES))
        skin_vertex = body_shaders.SKIN_VERTEX.replace("COLOURS", number)
        self._lit_skin = Lit(skin_vertex, body_shaders.SKIN_FRAGMENT)
        self._balls = Spheres(self._scenery)
        self._skin_shadow = shader_program(body_shaders.SKIN_SHADOW_VERTEX, body_shaders.SKIN_SHADOW_FRAGMENT)
        spacing = np.array([copy.baked.spacing for copy in body_set.copies])
        self._radius = PARTICLE_RADIUS * spacing[body_set.body]
        copies = body_set.in_cluster_order
        self._owner = np.repeat([copy.number for copy in copies], [copy.baked.clusters.count for copy in copies])
        self._all_middles = np.column_stack([cluster_colours(body_set), PARTICLE_RADIUS * spacing[self._owner]])
        self._active = copies_there(scene)
        self._weights: np.ndarray | None = None  # by which that is so
        self._rest = np.concatenate([copy.baked.skin.rest_centre for copy in copies])
        zero = np.zeros((body_set.clusters.count, 3), np.float32)
        self._buffers = [
            static_buffer(part)
            for part in (self._appearance(), np.zeros(1, np.uint32), zero, self._middle_appearance())
        ]
        self._spheres = square_array(self.vertices.position_buffer, self._buffers[0])
        self._middles = square_array(*self._buffers[2:4])
        self._points = vertex_array(self.vertices.position_buffer, self._buffers[1])
        self._links = np.concatenate([copy.first_particle + copy.baked.links for copy in body_set.copies]).astype(
            np.uint32
        )
        self._buffers.append(static_buffer(self._links))
        self._link_ends = 0  # of links that are drawn
        self._lines = vertex_array(self.vertices.position_buffer, self._buffers[-1])
        self._line_program = shader_program(shaders.VERTEX, shaders.LINE_FRAGMENT)
        self._skins = [Skins(list(copies)) for _, copies in groupby(body_set.copies, key=lambda copy: copy.name)]
        self._cluster_texture = ClusterTexture(body_set.clusters.count)
        self._constants()
        self._send_links()
        self.upload(body_set.position)

    def _appearance(self) -> np.ndarray:
        """Return colours and radii [m] of the particles (particles, 4) float32; radius 0, which draws nothing, if
        inactive."""
        colour = particle_colours(self.scene, self.colouring)
        radius = self._radius * self._active[self.scene.body_set.body]
        return np.ascontiguousarray(np.column_stack([colour, radius]), np.float32)

    def _middle_appearance(self) -> np.ndarray:
        """Return colours and radii [m] of the clusters' centres (clusters, 4) float32; radius 0 if inactive."""
        appearance = self._all_middles.astype(np.float32)
        appearance[:, 3] *= self._active[self._owner]
        return appearance

    def _send_links(self) -> None:
        """Send the links of active bodies."""
        ends = np.ascontiguousarray(self._links[self._active[self.scene.body_set.body[self._links[:, 0]]]])
        refill(self._buffers[-1], ends)
        self._link_ends = ends.size

    def _constants(self) -> None:
        """Set the uniforms that never change."""
        program = self._lit_skin.program
        program.use()
        program["palette"] = tuple(colours.BODIES)
        program["clusters"], program["shine"] = 0, SKIN_SHINE
        program.stop()
        self._scenery.shadow_constants(self._skin_shadow)
        self._skin_shadow.use()
        self._skin_shadow["clusters"] = 0
        self._skin_shadow.stop()

    def _lits(self) -> list[Shining]:
        return [*super()._lits(), self._lit_skin, self._balls]

    # ------------------------------------------------------------------ the state

    def upload(self, position: np.ndarray, normal: np.ndarray | None = None) -> None:
        """Send positions (particles, 3) [m]; the clusters are computed from them. Inactive bodies are as in
        `show_bodies`. Raises InputError."""
        self.vertices.upload_state(position, False)
        self._send(self.frames.of_state(position))

    def upload_from(self, simulation: Simulation, position: np.ndarray | None = None) -> None:
        """Send the state of a simulation, with the clusters of its solver; `position` (particles, 3) float32, if the
        caller has read it already."""
        self.show_bodies(simulation.body.inverse_mass)
        self.vertices.upload(simulation, False, position)
        self._send(self.frames.of_simulation(simulation, position))

    def show_bodies(self, inverse_mass: np.ndarray | None) -> None:
        """Hide the bodies that are inactive by the inverse masses (particles,) of a State, from the next upload on.
        Before the first call the bodies that are inactive at the start are hidden."""
        if inverse_mass is self._weights:  # as in nearly every frame
            return
        self._weights, active = inverse_mass, copies_there(self.scene, inverse_mass)
        if not np.array_equal(active, self._active):
            self._active = active
            self.vertices.send(self._buffers[0], self._appearance())
            self.vertices.send(self._buffers[3], self._middle_appearance())
            self._send_links()

    def _send(self, matrices: np.ndarray) -> None:
        """Send the matrices (clusters, 3, 4) of the clusters for skins and centres. The skin of an inactive body
        collapses to a point."""
        if not self._active.all():
            matrices = matrices * self._active[self._owner, None, None].astype(np.float32)
        self._cluster_texture.send(matrices)
        with np.errstate(over="ignore", invalid="ignore"):
            self.vertices.send(
                self._buffers[2], np.einsum("nij,nj->ni", matrices[:, :, :3], self._rest) + matrices[:, :, 3]
            )

    def next_colouring(self) -> None:
        """Choose the next of COLOURINGS."""
        self.colouring = COLOURINGS[(COLOURINGS.index(self.colouring) + 1) % len(COLOURINGS)]
        self.vertices.send(self._buffers[0], self._appearance())

    def toggle_clusters(self) -> None:
        """Show or hide the middles of the clusters."""
        self.clusters = not self.clusters

    def toggle_links(self) -> None:
        """Show or hide the links, if there are any."""
        self.links = not self.links and len(self._links) > 0

    def toggle_lines(self) -> bool:
        """Switch between particles and skin. Returns True if particles are shown now."""
        self._show(not self.lines, self.lines)
        return self.lines

    def _show(self, particles: bool, skin: bool) -> None:
        """Show particles and skins, or one of them."""
        self.particles, self.skin, self.lines = particles, skin, not skin

    def toggle_particles(self) -> None:
        """Show or hide the particles; without a skin they stay."""
        self._show(not self.particles, self.skin or self.particles)

    def toggle_skin(self) -> None:
        """Show or hide the skin; without it the particles are shown."""
        self._show(self.particles or self.skin, not self.skin)

    # ------------------------------------------------------------------ the picture

    def _draw_solid(self, camera: Camera, strain_range: float) -> None:
        if self.links:
            self._draw_links(camera)
        if self._inside:
            self._draw_spheres(camera)
        else:
            self._draw_skins(camera, 1.0)

    @property
    def _inside(self) -> bool:
        """True if particles, clusters or links are drawn inside the skin."""
        return self.particles or self.clusters or self.links

    def _draw_links(self, camera: Camera) -> None:
        from pyglet import gl

        program = self._line_program
        program.use()
        program["transform"], program["toward"] = uniform_matrix(camera.matrix()), 0.0
        program["colour"] = colours.INK
        draw_elements(self._lines, gl.GL_LINES, self._link_ends)
        program.stop()

    def _draw_spheres(self, camera: Camera) -> None:
        size = SMALL if self.skin or self.clusters or self.links else 1.0
        particles = [(self._spheres, self.scene.grid.particle_count, size)] if self.particles else []
        middles = [(self._middles, self.frames.count, 1.0)] if self.clusters else []
        self._balls.draw(camera, self._target.samples > 1, particles + middles)

    def _draw_skins(self, camera: Camera, cover: float) -> None:
        self._lit_skin.use(camera)
        self._lit_skin.program["cover"] = cover
        self._cluster_texture.bind()
        for skins in self._skins:
            self._lit_skin.program["copy"] = skins.number
            skins.draw(self._lit_skin.program)
        self._lit_skin.program.stop()

    def _draw_shadows(self, camera: Camera, time: float) -> None:
        shade = self._shade_skins if self.skin else self._shade_spheres
        self._scenery.draw_shadows(camera, time, self.lowest, [], [shade])

    def _shade_skins(self, camera: Camera, flatten: np.ndarray, centre: np.ndarray) -> None:
        use_shadow(self._skin_shadow, camera, flatten, centre)
        self._cluster_texture.bind()
        for skins in self._skins:
            skins.draw(self._skin_shadow)
        self._skin_shadow.stop()

    def _shade_spheres(self, camera: Camera, flatten: np.ndarray, centre: np.ndarray) -> None:
        self._balls.shade(camera, flatten, centre, (self._spheres, self.scene.grid.particle_count, 1.0))

    def _draw_over(self, camera: Camera, selected: int | None) -> None:
        from pyglet import gl

        if self.skin and self._inside:
            gl.glEnable(gl.GL_CULL_FACE)
            self._draw_skins(camera, SKIN_COVER)
            gl.glDisable(gl.GL_CULL_FACE)
        if selected is not None:
            self._use_points(camera, self._points)
            self._ring(selected)
            self._point_program.stop()

    def delete(self) -> None:
        """Free the buffers."""
        delete_all([self._spheres, self._middles, self._points, self._lines], self._buffers)
        for skins in self._skins:
            skins.delete()
        self._cluster_texture.delete()
        super().delete()
