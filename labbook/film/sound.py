"""Narration: sentences in their spoken form, and their sounds on one track."""

from __future__ import annotations

import re
import wave
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from softlab.bench.measure import words
from softlab.labbook.film.timeline import Part

LOUDNESS = -20.0  # dB of full scale: root mean square while a voice speaks
PEAK = -1.5  # dB of full scale: largest value
QUIET = 0.01  # fraction of the peak below which there is silence before and after a sentence
BREATH = 0.04  # s of that silence that remain
SILENCE = 0.15  # s: shortest silence that counts as a pause
UNITS = {
    "ms": "milliseconds", "\N{MICRO SIGN}s": "microseconds", "ns": "nanoseconds", "s": "seconds",
    "GB/s": "gigabytes a second", "%": "percent", "m": "metres", "MB": "megabytes", "GiB": "gibibytes",
}  # fmt: skip
LETTERS = {"rk4": "R K four", "xpbd": "X P B D", "pbd": "P B D", "CPU": "C P U", "GPU": "G P U", "CUDA": "cuda"}
RAISED = {char.translate(words.SUPERSCRIPTS): char for char in "0123456789-"}


def spoken(text: str) -> str:
    """Return a caption in words that a voice reads correctly: numbers without thin spaces, units and powers of ten in
    full.
    """
    text = re.sub(rf"(\d)[{words.THIN}](?=\d)", r"\1", text).replace(words.THIN, " ").replace(words.SPACE, " ")
    text = re.sub(rf" ?{words.TIMES} ?10([\u207b\u2070\u00b9\u00b2\u00b3\u2074-\u2079]+)", _power, text)
    text = text.replace(" (committed)", "")  # the caption states it, and the beginning of the film
    for unit, name in UNITS.items():
        text = re.sub(rf"(?<=\d) {re.escape(unit)}(?![\w/])", f" {name}", text)
    for short, name in LETTERS.items():
        text = re.sub(rf"\b{short}\b", name, text)
    text = re.sub(r"\b(float)(\d+)", r"\1 \2", text)
    text = re.sub(r"\b([A-Z])(\d)\b", r"\1 \2", text)
    text = re.sub(r"\b(\d+)x\b", r"\1 x", text).replace(f" {words.TIMES} ", " by ")
    text = re.sub(rf"(?<![\w.])[{words.MINUS}-](?=\d)", "minus ", text)
    text = re.sub(r"(?<=\d) x (?=\d)", " by ", text)
    return re.sub(r"\s+", " ", text.replace("-", " ")).strip()


def _power(exponent: re.Match[str]) -> str:
    number = "".join(RAISED[char] for char in exponent[1])
    return f" times ten to the {number.replace('-', 'minus ')}"


def read_sound(file: Path) -> tuple[np.ndarray, int]:
    """Return (samples (n,) float32 in -1 to 1, without silence at the ends; their rate [1/s]).

    The file has 16 bits and one channel, as voices write.
    """
    with wave.open(str(file), "rb") as sound:
        rate, channels = sound.getframerate(), sound.getnchannels()
        frames = np.frombuffer(sound.readframes(sound.getnframes()), "<i2")
    samples = frames.reshape(-1, channels)[:, 0].astype(np.float32) / 2**15
    loud = np.flatnonzero(np.abs(samples) > QUIET * max(float(np.abs(samples).max(initial=0.0)), 1e-9))
    if len(loud):
        around = round(BREATH * rate)
        samples = samples[max(0, loud[0] - around) : loud[-1] + around]
    return samples, rate


def breaths(samples: np.ndarray, rate: int) -> list[float]:
    """Return the middles [s] of the silences in a sentence that are at least SILENCE long."""
    loud = np.flatnonzero(np.abs(samples) > QUIET * float(np.abs(samples).max(initial=0.0)))
    gaps = np.flatnonzero(np.diff(loud) >= SILENCE * rate)
    return [float(loud[gap] + loud[gap + 1]) / 2 / rate for gap in gaps]


def write_track(path: Path, parts: Sequence[Part], sounds: dict[str, np.ndarray], rate: int, fps: int) -> None:
    """Write every sentence at its time, at LOUDNESS, on a track as long as the film."""
    frames = parts[-1].first + parts[-1].count
    track = np.zeros(round(frames / fps * rate), np.float32)
    for sentence in (sentence for part in parts for sentence in part.sentences):
        begin = round(sentence.start * rate)
        samples = sounds[sentence.text][: max(0, len(track) - begin)]
        track[begin : begin + len(samples)] += samples
    with wave.open(str(path), "wb") as out:
        out.setnchannels(1)
        out.setsampwidth(2)
        out.setframerate(rate)
        out.writeframes((levelled(track) * (2**15 - 1)).astype("<i2").tobytes())


def levelled(track: np.ndarray) -> np.ndarray:
    """Return the track at LOUDNESS where it is not silent, or as near as its peak allows."""
    peak = float(np.abs(track).max(initial=0.0))
    if peak == 0:
        return track
    heard = track[np.abs(track) > QUIET * peak]
    wanted = 10 ** (LOUDNESS / 20) / float(np.sqrt(np.mean(heard.astype(np.float64) ** 2)))
    return np.clip(track * wanted, -(10 ** (PEAK / 20)), 10 ** (PEAK / 20))
