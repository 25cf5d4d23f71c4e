"""Draws spray, foam and bubbles (model/fluid/foam.py) as points over a fluid; points inside the fluid are dimmed."""

from __future__ import annotations

import numpy as np

from softlab.app.render.camera import Camera
from softlab.app.render.fluid.surface import FluidSurface
from softlab.app.render.opengl import shader_program
from softlab.app.render.vertex_arrays import delete_all, point_array, static_buffer, uniform_matrix
from softlab.app.render.vertices import HostVertices
from softlab.model.fluid.foam import NAMES, FoamPoints
from softlab.model.scene.scene import Scene
from softlab.model.tables.fluid import Foam

APPEARANCES = np.array(
    [[0.62, 0.76, 0.88, 0.85], [0.98, 0.99, 1.0, 0.9], [0.78, 0.90, 0.97, 0.6]], np.float32
)  # by kind: colour, alpha
NAMED = tuple((name, tuple(colour[:3].tolist())) for name, colour in zip(NAMES, APPEARANCES, strict=True))
RADIUS = {2: 0.4, 3: 0.15}  # of a point, in rest distances, by dimensions
LEAST = 1.6  # pixels across
DIMMED = 8.0  # over the fluids' extent [1/m]: how fast fluid before a point takes its light
RIM = 0.7  # in a plane, of a large point's colour, where it ends: white is to be seen on white

VERTEX = """#version 330 core
layout(location = 0) in vec3 position;  // m
layout(location = 4) in vec4 look;      // colour, alpha
uniform mat4 transform;
uniform vec3 eye;
uniform vec3 ahead;         // unit vector, the view direction; 0 in a plane
uniform float pixels;       // that a metre has, in space one metre away
uniform float radius;       // m
out vec4 seen;
out float away;             // m
flat out float size;
void main() {
    away = dot(position - eye, ahead);
    size = max(2.0 * radius * pixels / (ahead == vec3(0.0) ? 1.0 : max(away, 1e-6)), LEAST);
    seen = look;
    gl_Position = transform * vec4(position, 1.0);
    gl_PointSize = size + 1.0;
}
""".replace("LEAST", str(LEAST))

FRAGMENT = """#version 330 core
in vec4 seen;
in float away;
flat in float size;
uniform sampler2D depth;    // of the fluid's surface, m; 0: none
uniform float dimmed;       // 1/m; 0: no surface is drawn
uniform float rim;
out vec4 pixel;
void main() {
    float edge = 0.5 * size - length(gl_PointCoord - 0.5) * (size + 1.0);  // pixels
    float cover = clamp(edge + 0.5, 0.0, 1.0);
    if (dimmed > 0.0) {
        float surface = texelFetch(depth, ivec2(gl_FragCoord.xy), 0).r;
        if (surface > 0.0) cover *= exp(-dimmed * max(away - surface, 0.0));
    }
    if (cover <= 0.01) discard;
    float plain = max(clamp(edge - 0.5, 0.0, 1.0), 1.0 - clamp(0.25 * size - 1.0, 0.0, 1.0));  // small ones have no rim
    pixel = vec4(seen.rgb * mix(rim, 1.0, plain), seen.a * cover);
}
"""


class FoamLayer:
    """Draws the foam `points` of a scene. Needs a current OpenGL 3.3 context."""

    def __init__(self, scene: Scene, points: FoamPoints | None = None):
        self.points = points or FoamPoints(scene, scene.foam or Foam())
        self._space, fluid_set = scene.dimensions == 3, scene.fluid_set
        self._radius, self._dimmed = RADIUS[scene.dimensions] * fluid_set.spacing, DIMMED / fluid_set.extent
        self._buffers = [static_buffer(np.zeros((1, scene.dimensions), np.float32)), static_buffer(APPEARANCES[:1])]
        self._array = point_array(self._buffers[0], self._buffers[1], scene.dimensions)
        self._program = shader_program(VERTEX, FRAGMENT)

    def follow(self, position: np.ndarray, velocity: np.ndarray, time: float) -> None:
        """Update the points; see `FoamPoints.follow`."""
        self.points.follow(position, velocity, time)

    def draw(self, camera: Camera, surface: FluidSurface | None = None) -> None:
        """Draw the points over the picture; `surface`: the fluid's surface in the same picture, if it is drawn as one."""
        from pyglet import gl

        count = len(self.points)
        if not count:
            return
        HostVertices.send(self._buffers[0], self.points.position)
        HostVertices.send(self._buffers[1], APPEARANCES[self.points.kind])
        program = self._program
        program.use()
        program["transform"], program["radius"] = uniform_matrix(camera.matrix()), self._radius
        program["eye"], program["ahead"] = tuple(camera.eye.tolist()), tuple(camera.ahead.tolist())
        program["pixels"] = camera.focal
        program["dimmed"], program["rim"] = 0.0 if surface is None else self._dimmed, 1.0 if self._space else RIM
        if surface is not None:
            surface.bind_depth()
        gl.glEnable(gl.GL_PROGRAM_POINT_SIZE)
        gl.glBindVertexArray(self._array)
        gl.glDrawArrays(gl.GL_POINTS, 0, count)
        gl.glBindVertexArray(0)
        program.stop()

    def delete(self) -> None:
        """Free the buffers."""
        delete_all([self._array], self._buffers)
