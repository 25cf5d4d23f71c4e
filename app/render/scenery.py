"""Surroundings of a cloth or bodies: colliders, the ground, and shadows on the ground."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from ctypes import c_uint
from typing import TYPE_CHECKING

import numpy as np

from softlab.app.render import colours, shaders3d
from softlab.app.render.camera import Camera
from softlab.app.render.collider_shapes import Ground, Mesh, collider_mesh, grounds, line_distance, shadow_matrix
from softlab.app.render.fluid.tank_frame import tank_frame
from softlab.app.render.opengl import shader_program
from softlab.app.render.vertex_arrays import (
    delete_all,
    draw_elements,
    refill,
    static_buffer,
    uniform_matrix,
    vertex_array,
)
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Plane

if TYPE_CHECKING:
    from pyglet.graphics.shader import ShaderProgram

KEY = np.array([-0.45, 0.95, 0.60]) / np.linalg.norm([-0.45, 0.95, 0.60])  # toward the light that throws shadows
GROUND_RADIUS = 2.6  # times the scene's size, to where nothing is left of the ground
GROUND_COVER = 0.55  # how much of what lies behind the ground it hides, seen from above
MIN_SLOPE = 0.15  # cosine between a plane's normal and the light from which on it bears shadows
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float32)

Drawn = tuple[c_uint, int, int]  # vertex array, mode, elements
Shade = Callable[[Camera, np.ndarray, np.ndarray], None]  # draws a shadow: camera, (4, 4) into the ground, its middle


class Lit:
    """The shader program of lit surfaces: `use(camera)` for each frame, then `set_material(...)` for each surface.
    Shaders of other kinds of surfaces use the same lights."""

    def __init__(self, vertex: str = shaders3d.SURFACE_VERTEX, fragment: str = shaders3d.SURFACE_FRAGMENT) -> None:
        self.program = shader_program(vertex, fragment)
        self.shine(KEY)

    def shine(self, light: np.ndarray) -> None:
        """Set the unit vector (3,) toward the light that casts shadows."""
        self.program.use()
        self.program["key"] = tuple(light.tolist())
        self.program.stop()

    def use(self, camera: Camera) -> None:
        """Use the program, with the view of `camera`."""
        right, up, back = camera.axes
        fill = back + 0.5 * right + 0.2 * up  # from the viewer's own right: no side that is looked at is black
        self.program.use()
        self.program["transform"] = uniform_matrix(camera.matrix())
        self.program["eye"] = tuple(camera.eye.tolist())
        self.program["fill"] = tuple((fill / np.linalg.norm(fill)).tolist())

    def set_material(self, front: Sequence[float], back: Sequence[float], shine: float, shift: np.ndarray) -> None:
        """Set the colours of both sides, the strength of the highlight, and the displacement of the surface [m]."""
        self.program["front"], self.program["back"] = front, back
        self.program["shine"] = shine
        self.program["shift"] = tuple(shift.tolist())


class Scenery:
    """The colliders and the ground of `scene`; `light` (3,): the unit vector toward the light that casts shadows. Needs
    a current OpenGL 3.3 context, the same in every call.

    Call `draw_colliders` and `draw_shadows` before transparent objects and `draw_ground` after opaque ones; `delete()`
    frees it.
    """

    def __init__(self, scene: Scene):
        from pyglet import gl

        self.scene, self.shows_colliders, self.light = scene, True, KEY
        self.size = scene.grid.extent
        self._shadow_program = shader_program(shaders3d.SHADOW_VERTEX, shaders3d.SHADOW_FRAGMENT)
        self._ground_program = shader_program(shaders3d.GROUND_VERTEX, shaders3d.GROUND_FRAGMENT)
        self._buffers: list[int] = []
        self._meshes: list[tuple[Drawn, np.ndarray]] = []
        self._turning: list[tuple[int, int, Mesh]] = []  # buffers of vertices and normals
        self._rotation_time = 0.0  # s
        meshes = [collider_mesh(collider) for _, collider in scene.colliders]
        for mesh in [*(mesh for mesh in meshes if mesh is not None), *tank_frame(scene)]:
            drawn = (self._array(mesh.vertices, mesh.triangles, mesh), gl.GL_TRIANGLES, mesh.triangles.size)
            self._meshes.append((drawn, mesh.velocity))
            if mesh.turns:
                self._turning.append((self._buffers[-3], self._buffers[-1], mesh))
        self._square = self._array(SQUARE, np.array([0, 1, 2, 0, 2, 3], dtype=np.uint32))
        self._ground_constants()

    def _array(self, vertices: np.ndarray, elements: np.ndarray, mesh: Mesh | None = None) -> c_uint:
        data = [vertices, elements] if mesh is None else [vertices, elements, mesh.normals]
        buffers = [static_buffer(part) for part in data]
        self._buffers += buffers
        return vertex_array(*buffers)

    def _turn_to(self, time: float) -> None:
        """Send rotating colliders again, in their position at `time` [s]."""
        if time != self._rotation_time:
            for place, facing, mesh in self._turning:
                vertices, normals = mesh.rotated(time)
                refill(place, vertices)
                refill(facing, normals)
            self._rotation_time = time

    def _ground_constants(self) -> None:
        program = self._ground_program
        program.use()
        program["spacing"] = line_distance(self.size)
        program["area"], program["line"] = colours.GROUND, colours.GROUND_LINE
        self._end_planes(program)
        self.shadow_constants(self._shadow_program)

    def shadow_constants(self, program: ShaderProgram) -> None:
        """Set the constants of a program of shadows."""
        program.use()
        program["dark"], program["light"] = colours.SHADOW, colours.BACKGROUND
        self._end_planes(program)
        program.stop()

    def _end_planes(self, program: ShaderProgram) -> None:
        """Set where a plane and the shadows on it fade out: far away, and behind the other planes, if these do not move
        and the shaders support as many."""
        planes = [collider for _, collider in self.scene.colliders if isinstance(collider, Plane)]
        if len(planes) > shaders3d.LIMITS or any(any(plane.velocity) for plane in planes):
            planes = []
        limits = np.zeros((shaders3d.LIMITS, 4))
        for row, plane in zip(limits, planes, strict=False):
            row[:3] = np.array(plane.normal) / np.linalg.norm(plane.normal)
            row[3] = -row[:3] @ np.array(plane.point)
        program["limits"], program["limit_count"] = tuple(map(tuple, limits.tolist())), len(planes)
        program["reach"] = GROUND_RADIUS * self.size

    def draw_colliders(self, lit: Lit, time: float) -> None:
        """Draw every collider but planes at `time` [s]; `lit` is in use."""
        if not self.shows_colliders:
            return
        self._turn_to(time)
        for drawn, velocity in self._meshes:
            lit.set_material(colours.COLLIDER, colours.COLLIDER, 0.10, velocity * time)
            draw_elements(*drawn)

    def draw_shadows(
        self, camera: Camera, time: float, lowest: float, cloth: Iterable[Drawn], others: Sequence[Shade] = ()
    ) -> None:
        """Draw the shadows of the cloth, of the colliders and of each of `others`, on the lit planes that are seen from
        above."""
        from pyglet import gl

        things = [(drawn, np.zeros(3)) for drawn in cloth]
        if self.shows_colliders:
            things += [(drawn, velocity * time) for drawn, velocity in self._meshes]
        program = self._shadow_program
        gl.glEnable(gl.GL_POLYGON_OFFSET_FILL)  # a little behind the ground, whose lines are drawn over it
        gl.glPolygonOffset(1.0, 2.0)
        gl.glDepthMask(gl.GL_FALSE)  # or they would hide the lower halves of drops that lie in them
        # the darker one stays, where those of members of a world lie over each other, which fade at different lengths
        gl.glEnable(gl.GL_BLEND)
        gl.glBlendEquation(gl.GL_MIN)
        for ground in grounds(self.scene, time, lowest):
            if ground.normal @ self.light < MIN_SLOPE or not self._above(ground, camera):
                continue
            centre, flatten = self._centre(ground, camera), shadow_matrix(ground, self.light)
            program.use()
            program["transform"] = uniform_matrix(camera.matrix())
            program["centre"], program["flatten"] = tuple(centre.tolist()), uniform_matrix(flatten)
            for drawn, shift in things:
                program["shift"] = tuple(shift.tolist())
                draw_elements(*drawn)
            program.stop()
            for shade in others:
                shade(camera, flatten, centre)
        gl.glBlendEquation(gl.GL_FUNC_ADD)
        gl.glDisable(gl.GL_BLEND)
        gl.glDepthMask(gl.GL_TRUE)
        gl.glDisable(gl.GL_POLYGON_OFFSET_FILL)

    def draw_ground(self, camera: Camera, time: float, lowest: float) -> None:
        """Draw the planes, or without any a ground under `lowest` [m]; transparent from below. Walls and ceilings are
        left out if they are seen from behind, where they would hide the scene."""
        from pyglet import gl

        program = self._ground_program
        program.use()
        program["transform"] = uniform_matrix(camera.matrix())
        for ground in grounds(self.scene, time, lowest):
            if ground.normal[1] < MIN_SLOPE and not self._above(ground, camera):
                continue
            program["centre"] = tuple(self._centre(ground, camera).tolist())
            program["across"], program["along"] = tuple(ground.across.tolist()), tuple(ground.along.tolist())
            program["cover"] = GROUND_COVER if self._above(ground, camera) else 0.0
            draw_elements(self._square, gl.GL_TRIANGLES, 6)
        program.stop()

    @staticmethod
    def _above(ground: Ground, camera: Camera) -> bool:
        return bool((camera.eye - ground.point) @ ground.normal > 0)

    @staticmethod
    def _centre(ground: Ground, camera: Camera) -> np.ndarray:
        """Return the point about which the ground is drawn: below the camera's target."""
        return camera.target - ((camera.target - ground.point) @ ground.normal) * ground.normal

    def delete(self) -> None:
        """Free the buffers."""
        delete_all([drawn[0] for drawn, _ in self._meshes] + [self._square], self._buffers)
