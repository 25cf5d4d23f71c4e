"""Cost of a frame of a cloth on the GPU by the path of its state to the drawing: straight into OpenGL's buffers, or through
the host's memory.

Both paths send the same state of the same simulation into the same buffers, sampled in turn: once only sent (until
OpenGL has it where it draws from), once also drawn, as in a frame. Times in the store are of one frame.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from softlab.app.driver import open_simulation
from softlab.app.output.offscreen import OffscreenRenderer, opengl_available
from softlab.app.render import cuda_vertices, sheet_view, vertices
from softlab.app.render.camera import Camera
from softlab.app.render.sheet_view import SheetView
from softlab.app.render.view import View
from softlab.bench.measure.costs_timing import RATIO, Effort, Measures, Record, in_turn
from softlab.bench.measure.experiment import described
from softlab.bench.measure.gpu import gpu_simulated
from softlab.bench.measure.items import Group, cost_sources
from softlab.bench.measure.timing import Subject, prepare
from softlab.model.core.simulation import PRECISIONS
from softlab.model.scene.scene import load_scene

VERTICES = "vertices"  # value of `finding`
HOST, STRAIGHT = "host", "straight"  # values of `way`
SCENE = "cloth-hanging"
SIZES = (128, 512, 1024)  # masses a side
WIDTH, HEIGHT = 640, 480  # pixels
STRAIN_RANGE = 0.5  # at both ends of the colours, which a surface does not have
MOVED = 200  # steps from the start to the state that is sent: a cloth that hangs at rest looks all the same


def vertex_groups(effort: Effort, most: int | None = None) -> list[Group]:
    """Return the groups to time: cloths of several sizes in both precisions, whose vertices are sent to OpenGL through the
    host and directly, without and with drawing.

    Empty without a GPU, or if nothing can be drawn off-screen. `most`: largest number of masses per side.
    """
    if gpu_simulated() or not opengl_available(text=False)[0]:
        return []
    files = [str(module.__file__) for module in (cuda_vertices, sheet_view, vertices)]
    sources = cost_sources("gpu", [*files, __file__])
    groups = []
    for n in SIZES:
        if most and n > most:
            continue
        for precision in PRECISIONS:
            for drawn in (False, True):
                groups.append(_group(n, precision, drawn, sources, effort))
    return groups


def _group(n: int, precision: str, drawn: bool, sources: str, effort: Effort) -> Group:
    scene = load_scene(SCENE).replace({"cloth.rows": n, "cloth.columns": n})
    descriptions = tuple(
        described(scene, "gpu", VERTICES, precision=precision, way=path, drawn=drawn) for path in (HOST, STRAIGHT)
    )

    def measure(record: Record) -> list[Measures]:
        with (
            open_simulation(scene, "gpu", precision=precision) as simulation,
            OffscreenRenderer(scene, WIDTH, HEIGHT, legend=False) as renderer,
        ):
            simulation.advance(MOVED)
            renderer.fit(simulation.read("position"))
            view = SheetView(scene)
            try:
                frames = [Frames(simulation, path, view=view, camera=renderer.camera) for path in descriptions]
                return _frame_costs(record, frames, effort)
            finally:
                view.delete()

    return Group(f"{VERTICES} {n} x {n} {precision}{' drawn' if drawn else ''}", descriptions, sources, measure)


@dataclass
class Frames(Subject):
    """Frames of one state; a step here is a frame. `name`: its description."""

    view: View = field(kw_only=True)
    camera: Camera = field(kw_only=True)

    def restore(self) -> None:
        """Register the buffers with CUDA, or with OpenGL only, as this path needs."""
        self.view.vertices.shared = self.name["way"] == STRAIGHT
        self.run(1)

    def run(self, steps: int) -> float:
        """Draw `steps` frames, each until it is finished, and return the seconds."""
        from pyglet import gl

        view, drawn = self.view, self.name["drawn"]
        self.simulation.synchronize()
        begin = time.perf_counter()
        for _ in range(steps):
            view.upload_from(self.simulation)
            if drawn:
                view.draw(self.camera, STRAIN_RANGE)
            else:
                touch(view.vertices.position_buffer, view.vertices.normal_buffer)
            gl.glFinish()
        return time.perf_counter() - begin


def touch(*buffers: int) -> None:
    """Make the graphics card read from the buffers: a driver may keep the data on the host until then."""
    from pyglet import gl

    target = gl.GLuint()
    gl.glGenBuffers(1, target)
    gl.glBindBuffer(gl.GL_COPY_WRITE_BUFFER, target)
    gl.glBufferData(gl.GL_COPY_WRITE_BUFFER, 12 * len(buffers), None, gl.GL_STREAM_COPY)
    for number, buffer in enumerate(buffers):
        gl.glBindBuffer(gl.GL_COPY_READ_BUFFER, buffer)
        gl.glCopyBufferSubData(gl.GL_COPY_READ_BUFFER, gl.GL_COPY_WRITE_BUFFER, 0, 12 * number, 12)
    gl.glDeleteBuffers(1, target)


def _frame_costs(record: Record, subjects: list[Frames], effort: Effort) -> list[Measures]:
    """Return the costs of both paths; or of the host path with the reason why the other is not available."""
    host, straight = subjects
    straight.restore()
    shown = straight.view.vertices.transfer
    measurable = subjects if shown == cuda_vertices.STRAIGHT else [host]
    for subject in measurable:
        prepare(subject, effort.seconds, effort.most)
    costs = in_turn(record, measurable, effort.repeats)
    return costs if straight in measurable else [*costs, {RATIO: (None, "", shown)}]
