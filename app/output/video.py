"""Clips: frames piped into the ffmpeg of imageio-ffmpeg (h264 in MP4); and `render`, which chooses by a file's
suffix."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np

from softlab.app.output.offscreen import OffscreenRenderer, Picture, render_frame
from softlab.app.presentation import presentation_of
from softlab.model.base.errors import BackendUnavailable, InputError
from softlab.model.base.files import check_target, replacing
from softlab.model.core.simulation import Simulation
from softlab.model.fluid.foam import FoamPoints
from softlab.model.scene.scene import Scene

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

FRAME, CLIP = ".png", ".mp4"
PROGRESS_AFTER = 1.0  # s
MOST_RATE = 1000  # denominator of a rate: an MP4's time has an integer number of ticks per second
FULL, DISK_FULL = "No space left", "no space left on the disk"  # ffmpeg's words, and ours
MIN_FREE_BYTES = 1 << 16  # bytes: with less a disk counts as full


# position [m], time [s], and a cloth's normals and velocities [m/s] of particles, if they are known
Frame = tuple[np.ndarray, float, np.ndarray | None, np.ndarray | None]


def true_rate(steps_per_frame: int, dt: float) -> float:
    """Return the frames/s of a clip in real time, with steps of `dt` [s]; at least 1."""
    return max(1 / (steps_per_frame * dt), 1.0)


def ffmpeg_path() -> str:
    """Return the path of ffmpeg. Raises BackendUnavailable."""
    try:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError) as error:
        raise BackendUnavailable(
            f"no ffmpeg for clips ({error})",
            "pip install imageio-ffmpeg (or set IMAGEIO_FFMPEG_EXE to an ffmpeg with h264), or render a .png",
        ) from None


class VideoWriter:
    """Writes frames (height, width, 3 or 4) uint8, top row first, as an MP4 (h264, yuv420p); a context manager.

    `width`, `height` must be even (the pixel format requires it). The file appears, whole, when the block ends without
    an error; otherwise nothing is left behind. `sound`: a WAV file, as long as the clip, to add to it (AAC). Raises
    InputError (name, folder, size, disk full) and BackendUnavailable (no ffmpeg).
    """

    def __init__(self, path: Path | str, width: int, height: int, fps: float = 60, sound: Path | None = None):
        if width % 2 or height % 2 or width < 2 or height < 2:
            raise InputError(f"a clip of {width} x {height} pixels: width and height must be even")
        if fps < 1:
            raise InputError(f"a clip of {fps:g} frames per second: must be at least 1")
        self.path = check_target(path, (CLIP,))
        self.width, self.height, self.fps = width, height, fps
        self.frames = 0
        self._sound = ["-i", str(sound), "-map", "0:v", "-map", "1:a"] if sound else []
        self._stack = ExitStack()
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> VideoWriter:
        executable = ffmpeg_path()
        with ExitStack() as stack:
            temporary = stack.enter_context(replacing(self.path))
            self._errors = stack.enter_context(tempfile.TemporaryFile())
            command = [executable, "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
            command += [
                "-s",
                f"{self.width}x{self.height}",
                "-r",
                str(Fraction(self.fps).limit_denominator(MOST_RATE)),
                "-i",
                "-",
            ]
            command += [*self._sound, "-c:a", "aac", "-b:a", "128k", "-ar", "44100"] if self._sound else ["-an"]
            command += ["-c:v", "libx264", "-preset", "veryfast", "-crf", "18", "-pix_fmt", "yuv420p"]
            command += ["-movflags", "+faststart", "-f", "mp4", str(temporary)]
            try:
                self._process = subprocess.Popen(
                    command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=self._errors
                )
            except OSError as error:
                raise BackendUnavailable(
                    f"{executable} cannot be started ({error.strerror})", "pip install imageio-ffmpeg"
                ) from None
            self._stack = stack.pop_all()
        return self

    def write(self, image: np.ndarray) -> None:
        """Append one frame. Raises InputError if its size differs or the file cannot be written."""
        if image.shape[:2] != (self.height, self.width):
            raise InputError(f"a frame of shape {image.shape} in a clip of {self.height} rows x {self.width} columns")
        assert self._process is not None and self._process.stdin is not None, "use VideoWriter in a with block"
        try:
            self._process.stdin.write(np.ascontiguousarray(image[:, :, :3]).data)
        except OSError:  # ffmpeg has ended, with a message
            raise self._failure() from None
        self.frames += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        process = self._process
        assert process is not None and process.stdin is not None
        failure: InputError | None = None
        try:
            if kind is not None:
                process.kill()
            process.stdin.close()
        except OSError:
            pass
        status = process.wait()
        if kind is None and self.frames == 0:
            failure = InputError(f"{self.path}: a clip needs at least one frame")
        elif kind is None and status != 0:
            failure = self._failure()
        if failure is not None:
            kind, error, trace = type(failure), failure, None
        self._stack.__exit__(kind, error, trace)
        if failure is not None:
            raise failure

    def _failure(self) -> InputError:
        assert self._process is not None
        self._process.wait()
        self._errors.seek(0)
        output = self._errors.read().decode("utf-8", "replace")
        return InputError(f"{self.path} cannot be written: {reason(output, self.path)}")


def reason(output: str, path: Path) -> str:
    """Return why a clip was not written, from the output of ffmpeg, whose lines begin with memory addresses."""
    if FULL in output or shutil.disk_usage(path.parent).free < MIN_FREE_BYTES:
        return DISK_FULL
    lines = [re.sub(r"^(\[[^]]*\] *)+", "", line) for line in output.strip().splitlines()]
    return lines[-1] if lines else "ffmpeg stopped"


def render_clip(
    simulation: Simulation,
    path: Path | str,
    steps: int,
    steps_per_frame: int = 10,
    picture: Picture = Picture(),
    *,
    progress: bool = True,
) -> Path:
    """Advance `simulation` by `steps` steps and draw its start, every `steps_per_frame` steps and its end into an MP4.

    The view and the range of colours grow with the motion. Shows a progress bar on standard error, if it takes longer
    than a second. Raises InputError, BackendUnavailable, and Diverged (then there is no clip).
    """
    if steps < 0 or steps_per_frame < 1:
        raise InputError(
            f"a clip of {steps} steps, {steps_per_frame} a frame: needs at least 0, and at least 1 a frame"
        )

    def state() -> Frame:
        others = {name: simulation.read(name) for name in presentation_of(simulation.scene).drawn(simulation.scene)}
        return simulation.read("position"), simulation.time, others.get("normal"), others.get("velocity")

    def states() -> Iterator[Frame]:
        yield state()
        done = 0
        while done < steps:
            now = min(steps_per_frame, steps - done)
            simulation.advance(now)
            simulation.check()
            done += now
            yield state()

    total = 1 + -(-steps // steps_per_frame)
    return _write_clip(simulation.scene, states(), total, path, picture, simulation.body.inverse_mass, progress)


def _write_clip(
    scene: Scene,
    states: Iterable[Frame],
    total: int,
    path: Path | str,
    picture: Picture,
    inverse_mass: np.ndarray | None,
    progress: bool = True,
) -> Path:
    width, height = picture.width & ~1, picture.height & ~1
    writer = VideoWriter(path, width, height, picture.fps)
    drawing = OffscreenRenderer(scene, width, height, legend=picture.legend, view_options=picture.view_options)
    with drawing as renderer, writer, ExitStack() as stack:
        renderer.caption = scene.title if picture.caption is None else picture.caption
        renderer.show_bodies(inverse_mass)
        if picture.fitted is not None:
            renderer.fix(picture.fitted)
        start, bar, task = perf_counter(), None, None
        for position, time, normal, velocity in states:
            renderer.fit(position, time)
            renderer.draw(position, time, normal, velocity)
            writer.write(renderer.image())
            if bar is None and progress and perf_counter() - start > PROGRESS_AFTER:
                bar, task = _progress_bar(writer.path.name, total)
                stack.enter_context(bar)
            if bar is not None and task is not None:
                bar.update(task, completed=writer.frames)
    return writer.path


def _progress_bar(name: str, total: int) -> tuple[Progress, TaskID]:
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

    from softlab.app.output.bar import Bar

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("frames"))
    bar = Bar((*columns, TimeRemainingColumn()))
    return bar, bar.add_task(f"drawing {name}", total=total)


def check_render(path: Path | str) -> Path:
    """Return `path`, if `render` could write it; raises InputError. Call it before the simulation runs."""
    return check_target(path, (FRAME, CLIP), "a picture or a clip")


def render(
    source: Simulation | np.ndarray,
    path: Path | str,
    *,
    scene: Scene | None = None,
    steps: int = 0,
    steps_per_frame: int = 10,
    picture: Picture = Picture(),
    time: float = 0.0,
    inverse_mass: np.ndarray | None = None,
    velocity: np.ndarray | None = None,
    foam: FoamPoints | None = None,
) -> Path:
    """Draw into `frame.png` or `clip.mp4`, according to the suffix, and return the path.

    `source`: a simulation (a frame shows its current state; a clip advances it by `steps`), or positions, (particles,
    dimensions) for a frame and (frames, particles, dimensions) for a clip, which need their `scene`, and in space the
    `time` [s] for its moving colliders; `inverse_mass`, as in State, marks inactive bodies; `velocity` [m/s] and `foam`
    of a fluid's frame, if known. Raises InputError, BackendUnavailable.
    """
    path = check_render(path)
    clip = path.suffix.lower() == CLIP
    if isinstance(source, Simulation):
        if clip:
            return render_clip(source, path, steps, steps_per_frame, picture)
        scene, time, inverse_mass = source.scene, source.time, source.body.inverse_mass
        velocity = source.read("velocity") if "velocity" in presentation_of(scene).drawn(scene) else None
    position = source.read("position") if isinstance(source, Simulation) else source
    if scene is None:
        raise InputError("positions alone cannot be drawn; give their scene, too")
    if not clip:
        return render_frame(
            scene, position, path, picture, time=time, inverse_mass=inverse_mass, velocity=velocity, foam=foam
        )
    if position.ndim != 3:
        raise InputError(f"positions of shape {position.shape}; a clip needs (frames, particles, {scene.dimensions})")
    states = ((frame, time, None, None) for frame in position)
    return _write_clip(scene, states, len(position), path, picture, inverse_mass)
