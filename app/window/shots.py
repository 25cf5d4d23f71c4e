"""Pictures and clips of the demo's window as files; a number is added if the file exists."""

from __future__ import annotations

from pathlib import Path

from softlab.app.output.offscreen import read_pixels
from softlab.app.output.pictures import write_png
from softlab.app.output.video import VideoWriter
from softlab.app.window.demo import Demo
from softlab.model.base.errors import SoftlabError

FPS = 60


def free_path(demo: Demo, suffix: str) -> Path:
    """Return the path of a file in the working folder that does not exist yet, named by the current world and its step."""
    name = "".join(c if c.isalnum() or c in "-_" else "-" for c in demo.world.scene.name)
    stem = f"softlab-{name}-step{demo.world.step}"
    path, number = Path.cwd() / f"{stem}{suffix}", 2
    while path.exists():
        path, number = Path.cwd() / f"{stem}-{number}{suffix}", number + 1
    return path


class Shots:
    """`screenshot`: the last one; `recording`: True while frames go into a clip. Call `take(width, height)` after each
    frame; it saves that many pixels from the lower left."""

    def __init__(self, demo: Demo):
        self.demo = demo
        self.screenshot: Path | None = None
        self._wanted = self._begins = False
        self._clip: VideoWriter | None = None

    @property
    def recording(self) -> bool:
        """True if frames go into a clip."""
        return self._clip is not None

    def ask(self) -> None:
        """Save the next frame, which is then complete (S)."""
        self._wanted = True

    def toggle_clip(self) -> None:
        """Begin a clip with the next frame, or end it and write its file."""
        if self._clip is None:
            self._begins = True
        else:
            self.end_clip()

    def take(self, width: int, height: int) -> None:
        """Save what was requested of the current frame."""
        if self._begins:
            self._begins = False
            self._begin(width & ~1, height & ~1)
        if self._clip is not None:
            self._add(self._clip, width & ~1, height & ~1)
        if self._wanted:
            self._wanted = False
            try:
                self.screenshot = write_png(free_path(self.demo, ".png"), read_pixels(width, height))
                self.demo.say(f"saved {self.screenshot}")
            except SoftlabError as error:
                self.demo.say(str(error))

    def _begin(self, width: int, height: int) -> None:
        try:
            clip = VideoWriter(free_path(self.demo, ".mp4"), width, height, FPS)
            clip.__enter__()
        except SoftlabError as error:
            self.demo.say(str(error))
            return
        self._clip = clip
        self.demo.say(f"recording {clip.path.name}")

    def _add(self, clip: VideoWriter, width: int, height: int) -> None:
        if (width, height) != (clip.width, clip.height):
            self.end_clip("the window's size changed: ")
            return
        try:
            clip.write(read_pixels(width, height))
        except SoftlabError as error:
            self._clip = None
            clip.__exit__(type(error), error, None)
            self.demo.say(str(error))

    def end_clip(self, why: str = "") -> None:
        """Finish the clip, if there is one."""
        clip, self._clip = self._clip, None
        if clip is None:
            return
        try:
            clip.__exit__(None, None, None)
            self.demo.say(f"{why}saved {clip.path}, {clip.frames} frames")
        except SoftlabError as error:
            self.demo.say(str(error))
