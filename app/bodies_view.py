"""Draws a scene's bodies into the current OpenGL context: particles as lit spheres, skins as lit meshes that follow their
clusters on the graphics card, with what they collide with and a ground. The window and off-screen pictures draw through here.
"""

from __future__ import annotations

import ctypes
from itertools import groupby
from typing import Any

import numpy as np

from app import body_shaders, colours
from app.body_shaders import ACROSS
from app.camera3d import Camera3D
from app.opengl import shader_program
from app.scenery import KEY, Lit
from app.skinning import ClusterFrames
from app.smooth_target import SAMPLES
from app.space_view import SpaceView
from app.vertex_arrays import NORMAL, POSITION, delete_all, static_buffer, uniform_matrix, vertex_array
from model.crowd import Copy
from model.scene import Scene
from model.simulation import Simulation

CLUSTER, WEIGHT, LOOK = 2, 3, 4  # where the shaders of app/body_shaders.py look for them
PARTICLE_RADIUS = 0.5  # of the particle spacing
SKIN_COVER = 0.22  # of the particles behind it, where both are shown
SMALL = 0.45  # times a particle's radius then, so that they lie inside
SKIN_SHINE, PARTICLE_SHINE = 0.16, 0.10


class BodiesView(SpaceView):
    """See SpaceView. `particles`, `skin`: which of them are shown, one of them at least; both: the particles through the
    skin."""

    def __init__(self, scene: Scene, samples: int = SAMPLES):
        super().__init__(scene, samples)
        crowd = scene.crowd
        self.particles, self.skin = False, True
        self.frames = ClusterFrames(scene)
        number = str(len(colours.BODIES))
        skin_vertex = body_shaders.SKIN_VERTEX.replace("COLOURS", number)
        self._lit_skin = Lit(skin_vertex, body_shaders.SKIN_FRAGMENT)
        self._lit_spheres = Lit(body_shaders.SPHERE_VERTEX, body_shaders.SPHERE_FRAGMENT)
        self._skin_shadow = shader_program(body_shaders.SKIN_SHADOW_VERTEX, body_shaders.SKIN_SHADOW_FRAGMENT)
        self._sphere_shadow = shader_program(body_shaders.SPHERE_SHADOW_VERTEX, body_shaders.SPHERE_SHADOW_FRAGMENT)
        look = np.empty((crowd.particle_count, 4), np.float32)
        look[:, :3] = np.array(colours.BODIES, np.float32)[crowd.body % len(colours.BODIES)]
        look[:, 3] = PARTICLE_RADIUS * np.array([copy.baked.spacing for copy in crowd.copies])[crowd.body]
        self._buffers = [static_buffer(look), static_buffer(np.zeros(1, np.uint32))]
        self._spheres = self._sphere_array()
        self._points = vertex_array(self.vertices.position_buffer, self._buffers[1])
        self._skins = [Skins(list(copies)) for _, copies in groupby(crowd.copies, key=lambda copy: copy.name)]
        self._cluster_texture = ClusterTexture(crowd.clusters.count)
        self._constants()
        self.upload(crowd.position)

    def _sphere_array(self) -> Any:
        from pyglet import gl

        array = gl.GLuint()
        gl.glGenVertexArrays(1, array)
        gl.glBindVertexArray(array)
        for place, buffer, size in ((POSITION, self.vertices.position_buffer, 3), (LOOK, self._buffers[0], 4)):
            gl.glBindBuffer(gl.GL_ARRAY_BUFFER, buffer)
            gl.glEnableVertexAttribArray(place)
            gl.glVertexAttribPointer(place, size, gl.GL_FLOAT, gl.GL_FALSE, 0, None)
            gl.glVertexAttribDivisor(place, 1)
        gl.glBindVertexArray(0)
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, 0)
        return array

    def _constants(self) -> None:
        """Uniforms that never change."""
        program = self._lit_skin.program
        program.use()
        program["palette"] = tuple(colours.BODIES)
        program["clusters"], program["shine"] = 0, SKIN_SHINE
        program.stop()
        program = self._lit_spheres.program
        program.use()
        program["shine"] = PARTICLE_SHINE
        program["least"] = 0.0 if self._target.samples > 1 else 0.5
        program.stop()
        side = np.cross(KEY, (0.0, 0.0, 1.0))
        side /= np.linalg.norm(side)
        for program in (self._skin_shadow, self._sphere_shadow):
            self._scenery.shadow_constants(program)
        self._sphere_shadow.use()
        self._sphere_shadow["side"], self._sphere_shadow["other"] = tuple(side), tuple(np.cross(KEY, side))
        self._sphere_shadow.stop()
        self._skin_shadow.use()
        self._skin_shadow["clusters"] = 0
        self._skin_shadow.stop()

    # ------------------------------------------------------------------ the state

    def upload(self, position: np.ndarray, normal: np.ndarray | None = None) -> None:
        """Send positions (particles, 3) [m]; the clusters follow from them. Raises InputError."""
        self.vertices.upload_state(position, False)
        self._cluster_texture.send(self.frames.of_state(position))

    def upload_from(self, simulation: Simulation, position: np.ndarray | None = None) -> None:
        """Send the state of a simulation, with the clusters as its solver has them; `position` (particles, 3) float32, if
        the caller has read it already."""
        self.vertices.upload(simulation, False, position)
        self._cluster_texture.send(self.frames.of_simulation(simulation, position))

    def toggle_lines(self) -> bool:
        """Particles in place of the skin, or the skin in place of them; whether it is particles now."""
        self.particles, self.skin = not self.lines, self.lines
        return self.lines

    @property
    def lines(self) -> bool:  # type: ignore[override]
        """Whether particles are shown and no skin."""
        return not self.skin

    def toggle_particles(self) -> None:
        """Show or hide the particles; without a skin they stay."""
        self.particles = not self.particles
        self.skin |= not self.particles

    def toggle_skin(self) -> None:
        """Show or hide the skin; without it the particles are shown."""
        self.skin = not self.skin
        self.particles |= not self.skin

    # ------------------------------------------------------------------ the picture

    def _draw_solid(self, camera: Camera3D, strain_range: float) -> None:
        if self.particles:
            self._draw_spheres(camera)
        else:
            self._draw_skins(camera, 1.0)

    def _draw_spheres(self, camera: Camera3D) -> None:
        from pyglet import gl

        smooth = self._target.samples > 1
        self._lit_spheres.use(camera)
        self._lit_spheres.program["upward"] = tuple(camera.axes[1].tolist())
        self._lit_spheres.program["size"] = SMALL if self.skin else 1.0
        if smooth:
            gl.glEnable(gl.GL_SAMPLE_ALPHA_TO_COVERAGE)
        self._draw_squares()
        gl.glDisable(gl.GL_SAMPLE_ALPHA_TO_COVERAGE)
        self._lit_spheres.program.stop()

    def _draw_squares(self) -> None:
        from pyglet import gl

        gl.glBindVertexArray(self._spheres)
        gl.glDrawArraysInstanced(gl.GL_TRIANGLE_STRIP, 0, 4, self.scene.grid.particle_count)

    def _draw_skins(self, camera: Camera3D, cover: float) -> None:
        self._lit_skin.use(camera)
        self._lit_skin.program["cover"] = cover
        self._cluster_texture.bind()
        for skins in self._skins:
            self._lit_skin.program["copy"] = skins.number
            skins.draw(self._lit_skin.program)
        self._lit_skin.program.stop()

    def _draw_shadows(self, camera: Camera3D, time: float) -> None:
        shade = self._shade_skins if self.skin else self._shade_spheres
        self._scenery.draw_shadows(camera, time, self.lowest, [], [shade])

    def _shade_skins(self, camera: Camera3D, flatten: np.ndarray, centre: np.ndarray) -> None:
        self._use_shadow(self._skin_shadow, camera, flatten, centre)
        self._cluster_texture.bind()
        for skins in self._skins:
            skins.draw(self._skin_shadow)
        self._skin_shadow.stop()

    def _shade_spheres(self, camera: Camera3D, flatten: np.ndarray, centre: np.ndarray) -> None:
        self._use_shadow(self._sphere_shadow, camera, flatten, centre)
        self._draw_squares()
        self._sphere_shadow.stop()

    @staticmethod
    def _use_shadow(program: Any, camera: Camera3D, flatten: np.ndarray, centre: np.ndarray) -> None:
        program.use()
        program["transform"], program["flatten"] = uniform_matrix(camera.matrix()), uniform_matrix(flatten)
        program["centre"] = tuple(centre.tolist())

    def _draw_over(self, camera: Camera3D, selected: int | None) -> None:
        from pyglet import gl

        if self.skin and self.particles:
            gl.glEnable(gl.GL_CULL_FACE)
            self._draw_skins(camera, SKIN_COVER)
            gl.glDisable(gl.GL_CULL_FACE)
        if selected is not None:
            self._use_points(camera, self._points)
            self._ring(selected)
            self._point_program.stop()

    def delete(self) -> None:
        """Free the buffers."""
        delete_all([self._spheres, self._points], self._buffers)
        for skins in self._skins:
            skins.delete()
        self._cluster_texture.delete()
        super().delete()


class Skins:
    """The skins of the copies of one body, which follow one another: one mesh on the graphics card, drawn so many times."""

    def __init__(self, copies: list[Copy]):
        from pyglet import gl

        skin = copies[0].baked.skin
        self.number, self.count = copies[0].number, len(copies)
        self._first, self._each = copies[0].first_cluster, copies[0].baked.clusters.count
        self._elements = skin.triangles.size
        arrays = (skin.position, skin.normal, skin.clusters, skin.weights)
        data = [np.ascontiguousarray(array, np.int32 if array is skin.clusters else np.float32) for array in arrays]
        self._buffers = [static_buffer(part) for part in [*data, skin.triangles.astype(np.uint32)]]
        self._array = vertex_array(self._buffers[POSITION], self._buffers[-1], self._buffers[NORMAL])
        gl.glBindVertexArray(self._array)
        for place in (CLUSTER, WEIGHT):
            gl.glBindBuffer(gl.GL_ARRAY_BUFFER, self._buffers[place])
            gl.glEnableVertexAttribArray(place)
        gl.glVertexAttribPointer(WEIGHT, 4, gl.GL_FLOAT, gl.GL_FALSE, 0, None)
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, self._buffers[CLUSTER])
        gl.glVertexAttribIPointer(CLUSTER, 4, gl.GL_INT, 0, None)
        gl.glBindVertexArray(0)
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, 0)

    def draw(self, program: Any) -> None:
        """With a program that is in use, of SKINNING."""
        from pyglet import gl

        program["first"], program["each"] = self._first, self._each
        gl.glBindVertexArray(self._array)
        gl.glDrawElementsInstanced(gl.GL_TRIANGLES, self._elements, gl.GL_UNSIGNED_INT, None, self.count)

    def delete(self) -> None:
        """Free the buffers."""
        delete_all([self._array], self._buffers)


class ClusterTexture:
    """The clusters' matrices where shaders find them: in a texture, three texels of four numbers for each."""

    def __init__(self, clusters: int) -> None:
        from pyglet import gl

        self._data = np.zeros((-(-clusters // ACROSS), ACROSS, 3, 4), np.float32)
        self._texture = gl.GLuint()
        gl.glGenTextures(1, self._texture)
        self.bind()
        for name in (gl.GL_TEXTURE_MIN_FILTER, gl.GL_TEXTURE_MAG_FILTER):
            gl.glTexParameteri(gl.GL_TEXTURE_2D, name, gl.GL_NEAREST)

    def send(self, matrices: np.ndarray) -> None:
        """(clusters, 3, 4) float32."""
        from pyglet import gl

        self._data.reshape(-1, 3, 4)[: len(matrices)] = matrices
        rows, pointer = len(self._data), self._data.ctypes.data_as(ctypes.c_void_p)
        self.bind()
        gl.glTexImage2D(gl.GL_TEXTURE_2D, 0, gl.GL_RGBA32F, 3 * ACROSS, rows, 0, gl.GL_RGBA, gl.GL_FLOAT, pointer)

    def bind(self) -> None:
        """For the sampler of unit 0."""
        from pyglet import gl

        gl.glActiveTexture(gl.GL_TEXTURE0)
        gl.glBindTexture(gl.GL_TEXTURE_2D, self._texture)

    def delete(self) -> None:
        """Free it."""
        from pyglet import gl

        gl.glDeleteTextures(1, self._texture)
