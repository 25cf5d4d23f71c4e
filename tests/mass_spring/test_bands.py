"""Passes in bands overlap, and in any order that streams and events allow they are those of one pass after another."""

from __future__ import annotations

import random
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from softlab.gpu_backend.mass_spring import bands
from softlab.gpu_backend.mass_spring.bands import Bands, band_cuts


class Stream:
    """What it was asked for, in order: work, or an event's place to wait for."""

    def __init__(self) -> None:
        self.asked: list[Any] = []


class Event:
    """As CUDA's: a wait is for what had been asked of the recording stream when it was recorded last."""

    def record(self, stream: Stream) -> None:
        self.of = stream, len(stream.asked)

    def wait(self, stream: Stream) -> None:
        stream.asked.append(self.of)


class Cuda:
    """The part of numba.cuda that bands ask for."""

    def __init__(self) -> None:
        self.streams: list[Stream] = []

    def stream(self) -> Stream:
        self.streams.append(Stream())
        return self.streams[-1]

    def event(self, timing: bool) -> Event:
        return Event()


def run(streams: list[Stream], choose: random.Random) -> None:
    """All that was asked, in any order that is allowed."""
    done = dict.fromkeys(map(id, streams), 0)
    while True:
        able = []
        for stream in streams:
            if done[id(stream)] < len(stream.asked):
                first = stream.asked[done[id(stream)]]
                if callable(first) or done[id(first[0])] >= first[1]:
                    able.append((stream, first))
        if not able:
            break
        stream, first = choose.choice(able)
        if callable(first):
            first()
        done[id(stream)] += 1
    assert all(done[id(stream)] == len(stream.asked) for stream in streams), "nothing waits for ever"


@given(
    cuts=st.lists(st.integers(1, 4), min_size=1, max_size=6), passes=st.integers(1, 6), seed=st.integers(0, 10**6),
    edges=st.tuples(st.booleans(), st.booleans()),
)  # fmt: skip
def test_any_allowed_order_gives_what_passes_in_turn_give(
    cuts: list[int], passes: int, seed: int, edges: tuple[bool, bool]
) -> None:
    """A pass adds up a row and the two beside it, from one buffer into the other; rows below a cut edge are replaced between
    passes by what is asked of the last band's stream."""
    with pytest.MonkeyPatch.context() as patch:
        api = Cuda()
        patch.setattr(bands, "cuda", api)
        patch.setattr(bands, "urgent_stream", api.stream)
        patch.setattr(bands, "close_stream", lambda stream: None)
        main, ends = Stream(), (0, *np.cumsum(cuts))
        found = Bands(main, ends, *edges)
        rows = int(ends[-1]) + 2  # with one of zeros at both ends
        wanted = np.zeros((2, rows), np.int64)
        wanted[0, 1:-1] = np.arange(1, rows - 1)
        state = wanted.copy()

        def sums(buffers: np.ndarray, source: int, first: int, end: int) -> None:
            old = buffers[source]
            buffers[1 - source, first + 1 : end + 1] = (
                old[first:end] + old[first + 1 : end + 1] + old[first + 2 : end + 2]
            )

        found.fork()
        for number in range(passes):
            found.each(
                lambda first, end, stream, source=number % 2: stream.asked.append(
                    lambda: sums(state, source, first, end)
                )
            )
            found.streams[-1].asked.append(lambda source=number % 2: state[1 - source].__setitem__(-1, 5 + source))
            sums(wanted, number % 2, 0, rows - 2)
            wanted[1 - number % 2, -1] = 5 + number % 2
        found.join()
        seen: list[np.ndarray] = []
        main.asked.append(lambda: seen.append(state.copy()))
        run([main, *api.streams], random.Random(seed))
        assert (seen[0] == wanted).all(), "what comes after all of them finds all done"


@given(count=st.integers(1, 300), least=st.integers(1, 40), above=st.integers(0, 5), below=st.integers(0, 5))
def test_every_row_of_tiles_is_in_one_band(count: int, least: int, above: int, below: int) -> None:
    cuts = band_cuts(count, least, above, below)
    assert cuts[0] == 0 and cuts[-1] == count and sorted(set(cuts)) == list(cuts)
    if len(cuts) > 2:
        assert not above or cuts[1] == above
        assert not below or cuts[-2] == count - below
        middle = [end - first for first, end in pairwise(cuts)][bool(above) : -1 if below else None]
        assert len(middle) == 1 or min(middle) >= least
