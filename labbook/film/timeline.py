"""When what is said and shown: shots of sentences, each as long as it is spoken or read, in frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from labbook.film.canvas import Format, Picture

LEAD, PAUSE, TAIL = 0.4, 0.35, 0.5  # s before the first sentence of a shot, between two, and after the last
READING = 17.0  # characters a second, of captions that nobody speaks
LEAST_READING = 1.5  # s
DIGIT = 4  # letters that a digit takes longer to say
NEAR = 1.5  # s: how far a caption may wait for the voice to draw breath


@dataclass(frozen=True)
class Line:
    """A sentence. `rank`: the greater, the sooner it is left out of a film that would be too long."""

    text: str
    rank: int = 0


@dataclass(frozen=True)
class Shot:
    """`picture` draws so many frames; `least`: seconds that they must be, however little is said."""

    name: str
    heading: str
    lines: tuple[Line, ...]
    picture: Picture
    least: float = 2.0


@dataclass(frozen=True)
class Said:
    """A sentence in time: from `start` to `end` [s]; `captions`: (start, end, text of at most two lines)."""

    text: str
    start: float
    end: float
    captions: tuple[tuple[float, float, str], ...]


@dataclass(frozen=True)
class Part:
    """A shot in time: its first frame, and how many."""

    shot: Shot
    first: int
    count: int
    said: tuple[Said, ...]


def reading_seconds(text: str) -> float:
    """How long a reader needs."""
    return max(LEAST_READING, len(text) / READING)


def shot_seconds(shot: Shot, lengths: Mapping[str, float]) -> float:
    """How long [s] a shot is shown: its sentences with the pauses around them, by the `lengths` [s] of each."""
    spoken = sum(lengths[line.text] for line in shot.lines) + PAUSE * (len(shot.lines) - 1)
    return max(shot.least, LEAD + spoken + TAIL)


def fitted(shots: Sequence[Shot], lengths: Mapping[str, float], form: Format) -> list[Shot]:
    """The shots, less those sentences without which the film is no longer than it may be: of the greatest rank first, the
    last of them before the others. A shot without sentences is left out. A film that is too short holds its shots longer."""
    kept = [
        replace(shot, lines=tuple(line for line in shot.lines if line.rank <= form.rank))
        for shot in shots
    ]  # fmt: skip
    kept = [shot for shot in kept if shot.lines]

    def total() -> float:
        return sum(shot_seconds(shot, lengths) for shot in kept)

    while total() > form.most:
        spare = [(line.rank, place, line) for place, shot in enumerate(kept) for line in shot.lines if line.rank]
        if not spare:
            break
        _, place, worst = max(spare, key=lambda entry: entry[:2])
        lines = tuple(line for line in kept[place].lines if line is not worst)
        kept[place : place + 1] = [replace(kept[place], lines=lines)] if lines else []
    short = form.least - total()
    if short > 0 and kept:
        kept = [replace(shot, least=shot_seconds(shot, lengths) + short / len(kept)) for shot in kept]
    return kept


def timeline(
    shots: Sequence[Shot],
    lengths: Mapping[str, float],
    fps: int,
    captions: Callable[[str], list[str]],
    pauses: Mapping[str, Sequence[float]] | None = None,
) -> list[Part]:
    """The shots one after the other, in whole frames. `captions` divides a sentence; `pauses`: when the voice draws breath in
    it [s from its start]."""
    parts, first = [], 0
    for shot in shots:
        begin = first / fps
        at, said = begin + LEAD, []
        for line in shot.lines:
            end = at + lengths[line.text]
            breaths = [at + pause for pause in (pauses or {}).get(line.text, ())]
            said.append(Said(line.text, at, end, tuple(_shared(captions(line.text), at, end, breaths))))
            at = end + PAUSE
        count = round(shot_seconds(shot, lengths) * fps)
        parts.append(Part(shot, first, count, tuple(said)))
        first += count
    return parts


def _shared(
    pieces: Sequence[str], start: float, end: float, breaths: Sequence[float]
) -> list[tuple[float, float, str]]:
    """Each piece as long as its share of what is said, or to the breath that is drawn near its end."""
    weights = [len(piece) + DIGIT * sum(map(str.isdigit, piece)) for piece in pieces]
    found, at = [], start
    for number, piece in enumerate(pieces, 1):
        until = start + (end - start) * sum(weights[:number]) / sum(weights)
        near = [breath for breath in breaths if abs(breath - until) < NEAR and breath > at]
        if number < len(pieces) and near and piece.endswith((",", ";", ":", ".")):
            until = min(near, key=lambda breath: abs(breath - until))
        found.append((at, until, piece))
        at = until
    return found


def caption_at(part: Part, seconds: float) -> str:
    """What is to be read at that time of the film; a caption stays until the next one."""
    shown = [text for said in part.said for start, _, text in said.captions if start <= seconds + 1e-9]
    first = part.said[0].captions[0][2] if part.said else ""
    return shown[-1] if shown else first


def subtitles(parts: Sequence[Part]) -> str:
    """The captions as a SubRip file."""
    blocks = [
        f"{number}\n{_clock(start)} --> {_clock(end)}\n{text}\n"
        for number, (start, end, text) in enumerate(
            (caption for part in parts for said in part.said for caption in said.captions), 1
        )
    ]
    return "\n".join(blocks)


def _clock(seconds: float) -> str:
    """`00:01:02,345`."""
    whole = round(1000 * seconds)
    minutes, rest = divmod(whole, 60_000)
    hours, minutes = divmod(minutes, 60)
    return f"{hours:02d}:{minutes:02d}:{rest // 1000:02d},{rest % 1000:03d}"
