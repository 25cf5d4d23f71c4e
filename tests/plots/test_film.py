"""The film: what it tells is the book's, as long as it is spoken or read; files that are whole or not there; who speaks."""

from __future__ import annotations

import subprocess
import wave
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from synthetic_store import CPU_RECORD, GPU_RECORD, Maker

from softlab.app.output import voice
from softlab.app.output.offscreen import opengl_available
from softlab.app.output.video import ffmpeg_path
from softlab.bench.store.database import Store
from softlab.labbook.build import CLAIMS
from softlab.labbook.film import film, race, stills
from softlab.labbook.film.canvas import CAPTION_LINES, FULL, QUICK, READABLE, Area, Format, Stage, divided
from softlab.labbook.film.film import Lengths, write_film
from softlab.labbook.film.race import races, thinned
from softlab.labbook.film.script import script
from softlab.labbook.film.sound import breaths
from softlab.labbook.film.timeline import (
    Line,
    Shot,
    caption_at,
    fitted,
    reading_seconds,
    shot_seconds,
    subtitles,
    timeline,
)
from softlab.model.base.errors import InputError
from softlab.model.scene.scene import load_scene
from softlab.plots.core.data import Results
from softlab.plots.core.read import load

TINY = Format(160, 90, 5, 2.0, 60.0, 16**2, everything=False, rank=0, curtain=3)
RATE = 8000  # 1/s


@cache
def opengl() -> tuple[bool, str]:
    return opengl_available()


def swept(record: dict[str, Any]) -> Results:
    """Times of 16 x 16 and 32 x 32 masses of a machine."""
    store = Store(":memory:")
    maker = Maker(store, record, "m")
    with store.transaction():
        for n in (16, 32):
            for threads in (1, 2, 4):
                how = {"threads": threads * record["cores"], "layer": "omp", "wait_policy": "passive"}
                maker.timing((n, n), threads * 1e-8 * n * n, backend="cpu", **how)
            if record["gpu"]:
                maker.timing((n, n), 1e-7 * n, backend="gpu")
    return load(store)


@pytest.fixture(scope="module")
def both() -> Results:
    """A machine with a GPU."""
    return swept(GPU_RECORD)


def drawn(area: Area, count: int, fps: int) -> Iterator[Image.Image]:
    for number in range(count):
        yield Image.new("RGB", (area.width, area.height), (number % 256, 0, 0))


def shot(name: str, *lines: tuple[str, int], least: float = 0.0) -> Shot:
    return Shot(name, name, tuple(Line(text, rank) for text, rank in lines), drawn, least)


# ---------------------------------------------------------------------- what is told


def test_the_sentences_are_the_books_and_nothing_is_said_of_what_was_not_measured(both: Results) -> None:
    shots = {made.name: made for made in script(both, replace(TINY, masses=32**2, rank=9), "cpu")}
    told = [line.text for made in shots.values() for line in made.lines]
    assert CLAIMS["overtakes"](both).sentence in told
    assert CLAIMS["threads-best"](both).sentence in told
    assert "answers" not in shots and not any("not measured" in text for text in told)  # no accuracy runs
    stage = Stage(FULL)
    for text in told:
        pieces = stage.captions(text)
        assert " ".join(pieces).replace("\n", " ") == text
        assert all(piece.count("\n") < CAPTION_LINES for piece in pieces)


def test_a_race_is_as_fast_as_the_store_says(both: Results) -> None:
    small, large = races(both, 32**2)
    assert (small.scene.grid.rows, large.scene.grid.rows) == (16, 32) and small.is_local
    cpu, gpu = large.runners
    assert (cpu.timing.backend, gpu.timing.backend) == ("cpu", "gpu") and "16 threads" in cpu.name
    wall = 100 * cpu.timing.median
    assert large.steps(cpu, wall) == 100
    assert large.steps(gpu, wall) == int(100 * cpu.timing.median / gpu.timing.median)
    assert large.slowed(300, 30) == pytest.approx(large.wall / (10 * (1 - race.STILL)))
    assert large.steps(gpu, large.wall) == round(large.simulated / large.scene.method.dt)


def test_without_a_gpu_threads_race() -> None:
    results = swept(CPU_RECORD)
    (found,) = races(results, 32**2)
    assert [runner.timing.threads for runner in found.runners] == [2, 8]
    assert races(results, 10) == []


def test_fine_grids_are_drawn_by_every_nth_line() -> None:
    for side, every in ((32, 1), (1024, 31), (100, 3), (256, 5), (512, 8)):
        scene = load_scene("lab-grid").replace({"grid.rows": side, "grid.columns": side})
        small, found = thinned(scene)
        assert found == every and small.grid.rows == (side - 1) // every + 1 <= race.MOST_LINES
        assert small.grid.spacing == small.springs.rest_length == every


# ---------------------------------------------------------------------- when


def test_sentences_are_left_out_by_rank_until_the_film_is_short_enough() -> None:
    shots = [shot("a", ("one", 0), ("two", 3)), shot("b", ("three", 3)), shot("c", ("four", 1))]
    lengths = {name: 10.0 for name in ("one", "two", "three", "four")}
    whole = sum(shot_seconds(each, lengths) for each in shots)

    def left(most: float, rank: int = 9) -> list[list[str]]:
        form = replace(FULL, least=0.0, most=most, rank=rank)
        return [[line.text for line in each.lines] for each in fitted(shots, lengths, form)]

    assert left(whole) == [["one", "two"], ["three"], ["four"]]
    assert left(whole - 1) == [["one", "two"], ["four"]]
    assert left(25) == [["one"], ["four"]] and left(1) == [["one"]]
    assert left(whole, rank=1) == [["one"], ["four"]]
    held = fitted(shots, lengths, replace(FULL, least=90.0))
    assert sum(shot_seconds(each, lengths) for each in held) == pytest.approx(90)


def test_captions_are_there_while_their_sentence_is_said() -> None:
    text = "a sentence of some words: " + "and so on " * 20 + "to its end."
    parts = timeline([shot("a", (text, 0)), shot("b", ("short", 0))], Lengths(), 30, Stage(FULL).captions)
    assert [part.first for part in parts] == [0, parts[0].count]
    (said,) = parts[0].sentences
    assert said.end - said.start == pytest.approx(reading_seconds(text))
    assert said.captions[0][0] == said.start and said.captions[-1][1] == pytest.approx(said.end)
    assert all(a[1] == b[0] for a, b in zip(said.captions, said.captions[1:], strict=False))
    for start, _, shown in said.captions:
        assert caption_at(parts[0], start) == shown
    assert caption_at(parts[0], 0.0) == said.captions[0][2] and caption_at(parts[1], 1e9) == "short"
    blocks = subtitles(parts).split("\n\n")
    assert len(blocks) == len(said.captions) + 1 and blocks[0].startswith("1\n00:00:00,400 --> ")


def test_a_caption_waits_for_the_voice_to_draw_breath() -> None:
    text = "some words, " * 16 + "and the end."
    tone = np.sin(np.arange(6 * RATE) / 3).astype(np.float32)
    tone[round(2.9 * RATE) : round(3.3 * RATE)] = 0.0
    assert breaths(tone, RATE) == pytest.approx([3.1], abs=0.01)
    how = ([shot("a", (text, 0))], {text: 6.0}, 30, Stage(FULL).captions)
    (first, _) = timeline(*how)[0].sentences[0].captions
    (waiting, after) = timeline(*how, {text: breaths(tone, RATE)})[0].sentences[0].captions
    assert waiting[1] == after[0] == pytest.approx(waiting[0] + 3.1, abs=0.01) != first[1]


def test_the_answers_are_the_books_first_table() -> None:
    store = Store(":memory:")
    maker = Maker(store, GPU_RECORD, "m")
    for dt, error in ((0.01, 5e-4), (0.02, 5e-3)):
        maker.point("lab-curtain", "rk4", dt, error, 1e-3, None, "float32", "gpu")
    results = load(store)
    rows, whose = stills.answers(results)
    assert {row[0] for row in rows} == {"Lab curtain (S1)"} and "Made-up GPU" in whose
    assert rows[0][2] == "0.1, 0.03, 0.01" and rows[1][3] == "rk4" and rows[1][stills.PROCESSOR].startswith("GPU")
    first, last = (list(stills.draw_answers(results, Stage(TINY).area, 4, 5))[place] for place in (0, -1))
    assert np.asarray(first).sum() > np.asarray(last).sum()  # more rows, more ink


def test_a_sentence_is_divided_at_a_breath() -> None:
    assert divided("one two three, four five six", 2) == ["one two three,", "four five six"]
    assert " ".join(divided("a b c d e", 3)) == "a b c d e"


# ---------------------------------------------------------------------- the film


def sayings(texts: Sequence[str], folder: Path) -> tuple[list[Path], str]:
    """Every text as a tone of 1.2 s."""
    files = [folder / f"{number}.wav" for number in range(len(texts))]
    tone = (8000 * np.sin(np.arange(round(1.2 * RATE)) / 4)).astype("<i2")
    for file in files:
        with wave.open(str(file), "wb") as sound:
            sound.setparams((1, 2, RATE, 0, "NONE", ""))
            sound.writeframes(tone.tobytes())
    return files, "a tone"


def decoded(path: Path, *how: str) -> bytes:
    command = [ffmpeg_path(), "-loglevel", "error", "-i", str(path), *how, "-"]
    return subprocess.run(command, capture_output=True, check=True).stdout


@pytest.fixture
def quick_to_compute(monkeypatch: pytest.MonkeyPatch) -> None:
    if not opengl()[0]:
        pytest.skip(f"no off-screen OpenGL: {opengl()[1]}")
    monkeypatch.setattr(race, "LEAST_TIME", 0.1)
    monkeypatch.setattr(race, "FALL", 0.0)


def test_a_film(both: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick_to_compute: None) -> None:
    monkeypatch.setattr(film, "speak", sayings)
    made = write_film(both, tmp_path / "film.mp4", TINY, show=False)
    assert made.spoken and made.voice == "a tone"
    pixels = decoded(made.path, "-f", "rawvideo", "-pix_fmt", "rgb24")
    assert len(pixels) == made.frames * TINY.width * TINY.height * 3
    frames = np.frombuffer(pixels, np.uint8).reshape(made.frames, TINY.height, TINY.width, 3)
    assert len(np.unique(frames[made.frames // 2].reshape(-1, 3), axis=0)) > 10
    sound = np.frombuffer(decoded(made.path, "-f", "s16le", "-ar", str(RATE), "-ac", "1"), "<i2")
    assert len(sound) / RATE == pytest.approx(made.seconds, abs=0.15) and made.seconds == made.frames / TINY.fps
    assert np.abs(sound[: round(0.2 * RATE)]).max() < 200 < np.abs(sound[RATE : 2 * RATE]).max()  # after the lead
    assert made.captions.read_text(encoding="utf-8").startswith("1\n00:00:00,400 -->")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["film.mp4", "film.srt"]


def test_what_fails_leaves_no_file(
    both: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick_to_compute: None
) -> None:
    ended: list[bool] = []

    def broken(area: Area, count: int, fps: int) -> Iterator[Image.Image]:
        try:
            yield from drawn(area, 3, fps)
            raise KeyboardInterrupt
        finally:
            ended.append(True)

    monkeypatch.setattr(film, "script", lambda *_: [replace(shot("a", ("text", 0)), picture=broken)])
    with pytest.raises(KeyboardInterrupt):
        write_film(both, tmp_path / "film.mp4", TINY, voice=False, show=False)
    assert ended == [True] and list(tmp_path.iterdir()) == []


def test_what_cannot_be_made_is_told_at_once(both: Results, tmp_path: Path) -> None:
    for results, name, told in (
        (both, "film.avi", "must end in .mp4"), (both, "no/film.mp4", "does not exist"), (Results(()), "film.mp4", "measure"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=told):
            write_film(results, tmp_path / name, TINY, show=False)


def test_small_print_of_a_small_film_is_readable() -> None:
    """Ten true pixels at least, whatever is asked for; of what does not fit less is said, and then it is cut."""
    small, large = (Area(form.width, form.height, form.height / 720).canvas() for form in (QUICK, FULL))
    assert small.wide("a line", 14) * small.scale == pytest.approx(large.wide("a line", READABLE))
    assert small.wide("a line", 30) == pytest.approx(large.wide("a line", 30), rel=0.05)
    texts = "a long line of words", "a short line"
    narrow = 1.01 * large.wide(texts[1])
    assert large.fitting(texts, 1e3) == texts[0] and large.fitting(texts, narrow) == texts[1]
    assert large.fitting(texts, narrow / 2).endswith("\N{HORIZONTAL ELLIPSIS}")


def test_the_formats_are_ones_that_a_film_can_have() -> None:
    for form in (FULL, QUICK, TINY):
        assert form.width % 2 == form.height % 2 == 0 and form.least < form.most
    assert FULL.least >= 100 and FULL.most <= 140


def test_the_doctor_tells_of_the_voice(monkeypatch: pytest.MonkeyPatch) -> None:
    from softlab.app.command.doctor import _voice

    def available(answer: Any) -> None:
        monkeypatch.setattr(voice, "voice_available", lambda: answer)

    available((True, "espeak-ng"))
    assert _voice().works and _voice().detail == "espeak-ng"
    available((False, "espeak-ng is not installed"))
    assert not _voice().works and "captions only" in _voice().detail and "narration" in _voice().remedy
