"""Makes the film: script, narration, frames, and one MP4 with a file of captions.

>>> from softlab.labbook.film.film import write_film
>>> from softlab.plots.core.read import load
>>> write_film(load("softlab-results/results.sqlite"), Path("film.mp4"))
"""

from __future__ import annotations

import tempfile
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from softlab.app.output.offscreen import OffscreenRenderer
from softlab.app.output.video import CLIP, VideoWriter, ffmpeg_path
from softlab.app.output.voice import speak
from softlab.bench.measure.progress import progress_bar
from softlab.gpu_backend.core.device import gpu_available, simulated
from softlab.labbook.film.canvas import FULL, Format, Stage
from softlab.labbook.film.script import script
from softlab.labbook.film.sound import breaths, read_sound, spoken, write_track
from softlab.labbook.film.timeline import Part, Shot, caption_at, fitted, reading_seconds, subtitles, timeline
from softlab.model.base.errors import InputError
from softlab.model.base.files import check_target, replacing
from softlab.model.scene.scene import load_scene
from softlab.plots.core.data import Results

BEGUN, SPEECH = 0.02, 0.25  # fractions of the progress bar: the script, and the narration, if there is a voice
SUBTITLES = ".srt"


@dataclass(frozen=True)
class Film:
    """Result: the files, the length, the number of frames, and the voice, or why there is none."""

    path: Path
    captions: Path
    seconds: float
    frames: int
    voice: str
    spoken: bool


def write_film(results: Results, path: Path, form: Format = FULL, voice: bool = True, show: bool = True) -> Film:
    """Make the film of the results, and a file of its captions (.srt) in the same folder.

    `voice` False: captions only. `show`: a progress bar. Both files are written completely or not at all. Raises
    InputError (nothing was measured, the file), BackendUnavailable (ffmpeg, off-screen OpenGL).
    """
    check_target(path, (CLIP,), "a film")
    if not results.sources:
        raise InputError("there are no measurements; measure first (softlab sweep)")
    ffmpeg_path()
    with OffscreenRenderer(load_scene("lab-grid"), 16, 16, legend=False):
        pass  # reports what is missing before all the work
    stage = Stage(form)
    with tempfile.TemporaryDirectory(prefix="softlab-film-") as work, progress_bar(show) as bar:
        task = bar.add_task("film: script", total=1.0)
        shots = script(results, form, computing_backend())
        bar.update(task, description="film: narration", completed=BEGUN)
        sounds, rate, voice_name = _narration(shots, form, Path(work)) if voice else ({}, 1, "none was asked for")
        lengths = Lengths({text: len(samples) / rate for text, samples in sounds.items()})
        pauses = {text: breaths(samples, rate) for text, samples in sounds.items()}
        parts = timeline(fitted(shots, lengths, form), lengths, form.fps, stage.captions, pauses)
        track = Path(work) / "narration.wav" if sounds else None
        if track is not None:
            write_track(track, parts, sounds, rate, form.fps)
        total = parts[-1].first + parts[-1].count
        begun = SPEECH if sounds else BEGUN
        with replacing(path.with_suffix(SUBTITLES)) as captions:
            captions.write_text(subtitles(parts), encoding="utf-8")
            with VideoWriter(path, form.width, form.height, form.fps, track) as writer:
                for part, frame in _frames(stage, parts, total):
                    writer.write(frame)
                    done = begun + (1 - begun) * writer.frames / total
                    bar.update(task, description=f"film: {part.shot.name}", completed=done)
    return Film(path, path.with_suffix(SUBTITLES), total / form.fps, total, voice_name, bool(sounds))


class Lengths(dict[str, float]):
    """Duration [s] of each sentence: as spoken, or else as long as a reader needs."""

    def __missing__(self, text: str) -> float:
        return reading_seconds(text)


def computing_backend() -> str:
    """Return the backend that computes states for the film."""
    return "gpu" if gpu_available()[0] and not simulated() else "cpu"


def _narration(shots: Sequence[Shot], form: Format, folder: Path) -> tuple[dict[str, np.ndarray], int, str]:
    """Return (sounds of all sentences that the film may have, their rate [1/s], the voice); empty without a voice."""
    texts = list(dict.fromkeys(line.text for shot in shots for line in shot.lines if line.rank <= form.rank))
    files, voice_name = speak([spoken(text) for text in texts], folder)
    if files is None:
        return {}, 1, voice_name
    read = [read_sound(file) for file in files]
    return {text: samples for text, (samples, _) in zip(texts, read, strict=True)}, read[0][1], voice_name


def _frames(stage: Stage, parts: Sequence[Part], total: int) -> Iterator[tuple[Part, np.ndarray]]:
    """Yield every frame of the film, with its part."""
    fps = stage.form.fps
    for part in parts:
        with _closing(part.shot.picture(stage.area, part.count, fps)) as pictures:
            for number, picture in enumerate(pictures, part.first):
                caption = caption_at(part, number / fps)
                yield part, stage.frame(part.shot.heading, picture, caption, (number + 1) / total)


@contextmanager
def _closing(pictures: Iterator[Image.Image]) -> Iterator[Iterator[Image.Image]]:
    """Close a generator of pictures at once, even if the film is stopped, so that its renderers are freed."""
    try:
        yield pictures
    finally:
        if isinstance(pictures, Generator):
            pictures.close()
