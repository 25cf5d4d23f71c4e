"""Timeline of the film: shots of sentences, each as long as it is spoken or read, in frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from softlab.labbook.film.canvas import Format, Picture

LEAD, PAUSE, TAIL = 0.4, 0.35, 0.5  # s before the first sentence of a shot, between two, and after the last
READING = 17.0  # characters per second, of captions without a voice
LEAST_READING = 1.5  # s
DIGIT = 4  # letters of the same spoken length as a digit
NEAR = 1.5  # s: how far a caption may shift to a pause of the voice


@dataclass(frozen=True)
class Line:
    """A sentence; `rank`: sentences of the highest rank are left out first if the film would be too long."""

    text: str
    rank: int = 0


@dataclass(frozen=True)
class Shot:
    """A shot; `picture` draws its frames; `least`: minimum duration [s], however short its text."""

    name: str
    heading: str
    lines: tuple[Line, ...]
    picture: Picture
    least: float = 2.0


@dataclass(frozen=True)
class TimedSentence:
    """A sentence in time: from `start` to `end` [s]; `captions`: (start, end, text of at most two lines)."""

    text: str
    start: float
    end: float
    captions: tuple[tuple[float, float, str], ...]


@dataclass(frozen=True)
class Part:
    """A shot in time: its first frame, and their number."""

    shot: Shot
    first: int
    count: int
    sentences: tuple[TimedSentence, ...]


def reading_seconds(text: str) -> float:
    """Return the time that a reader needs [s]."""
    return max(LEAST_READING, len(text) / READING)


def shot_seconds(shot: Shot, lengths: Mapping[str, float]) -> float:
    """Return the length of a shot [s]: its sentences with the pauses around them, by the `lengths` [s] of each."""
    spoken = sum(lengths[line.text] for line in shot.lines) + PAUSE * (len(shot.lines) - 1)
    return max(shot.least, LEAD + spoken + TAIL)


def fitted(shots: Sequence[Shot], lengths: Mapping[str, float], form: Format) -> list[Shot]:
    """Return the shots without the sentences that make the film too long.

    Sentences of the highest rank are removed first, the last of them before the others. A shot without sentences is
    left out. If the film is too short, its shots are extended.
    """
    chosen = [
        replace(shot, lines=tuple(line for line in shot.lines if line.rank <= form.rank))
        for shot in shots
    ]  # fmt: skip
    chosen = [shot for shot in chosen if shot.lines]

    def total() -> float:
        return sum(shot_seconds(shot, lengths) for shot in chosen)

    while total() > form.most:
        spare = [(line.rank, place, line) for place, shot in enumerate(chosen) for line in shot.lines if line.rank]
        if not spare:
            break
        _, place, worst = max(spare, key=lambda entry: entry[:2])
        lines = tuple(line for line in chosen[place].lines if line is not worst)
        chosen[place : place + 1] = [replace(chosen[place], lines=lines)] if lines else []
    short = form.least - total()
    if short > 0 and chosen:
        chosen = [replace(shot, least=shot_seconds(shot, lengths) + short / len(chosen)) for shot in chosen]
    return chosen


def timeline(
    shots: Sequence[Shot],
    lengths: Mapping[str, float],
    fps: int,
    captions: Callable[[str], list[str]],
    pauses: Mapping[str, Sequence[float]] | None = None,
) -> list[Part]:
    """Return the shots one after another, in whole frames.

    `captions` divides a sentence; `pauses`: when the voice pauses in it [s from its start].
    """
    parts, first = [], 0
    for shot in shots:
        begin = first / fps
        at, sentences = begin + LEAD, []
        for line in shot.lines:
            end = at + lengths[line.text]
            breaths = [at + pause for pause in (pauses or {}).get(line.text, ())]
            sentences.append(TimedSentence(line.text, at, end, tuple(_shared(captions(line.text), at, end, breaths))))
            at = end + PAUSE
        count = round(shot_seconds(shot, lengths) * fps)
        parts.append(Part(shot, first, count, tuple(sentences)))
        first += count
    return parts


def _shared(
    pieces: Sequence[str], start: float, end: float, breaths: Sequence[float]
) -> list[tuple[float, float, str]]:
    """Return each piece with its time, in proportion to its length, or up to a pause near its end."""
    weights = [len(piece) + DIGIT * sum(map(str.isdigit, piece)) for piece in pieces]
    timed, at = [], start
    for number, piece in enumerate(pieces, 1):
        until = start + (end - start) * sum(weights[:number]) / sum(weights)
        near = [breath for breath in breaths if abs(breath - until) < NEAR and breath > at]
        if number < len(pieces) and near and piece.endswith((",", ";", ":", ".")):
            until = min(near, key=lambda breath: abs(breath - until))
        timed.append((at, until, piece))
        at = until
    return timed


def caption_at(part: Part, seconds: float) -> str:
    """Return the caption at that time of the film; a caption stays until the next one."""
    shown = [text for sentence in part.sentences for start, _, text in sentence.captions if start <= seconds + 1e-9]
    first = part.sentences[0].captions[0][2] if part.sentences else ""
    return shown[-1] if shown else first


def subtitles(parts: Sequence[Part]) -> str:
    """Return the captions as a SubRip file."""
    blocks = [
        f"{number}\n{_clock(start)} --> {_clock(end)}\n{text}\n"
        for number, (start, end, text) in enumerate(
            (caption for part in parts for sentence in part.sentences for caption in sentence.captions), 1
        )
    ]
    return "\n".join(blocks)


def _clock(seconds: float) -> str:
    """Return e.g. `00:01:02,345`."""
    whole = round(1000 * seconds)
    minutes, rest = divmod(whole, 60_000)
    hours, minutes = divmod(minutes, 60)
    return f"{hours:02d}:{minutes:02d}:{rest // 1000:02d},{rest % 1000:03d}"
