"""Passes over a sheet in bands of its rows of tiles, each band on a stream of its own.

A pass in one launch ends when its last block does, and until then ever more of the GPU is idle. What a band's next pass reads
and overwrites lies in itself and its two neighbours: it begins when these three have done this one, while other bands are
still at it. So passes overlap along the sheet, and what is asked of a band between two passes (its rows sent to another GPU,
another's waited for) keeps no other band from going on. Made for streams that are captured in a graph: from Python each band
is a launch.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import cuda

from model.core.errors import BackendUnavailable

MOST_BANDS = 4  # besides those at cut edges: three are enough for one to be ready whenever blocks end


def band_cuts(count: int, least: int, above: int = 0, below: int = 0) -> tuple[int, ...]:
    """Where bands of `count` rows of tiles begin, and the end: `above` and `below` rows at the ends are bands by themselves
    (0: none), the others bands of `least` rows or more; (0, count) where there is no room for several."""
    inner = count - above - below
    if inner < 1:
        return 0, count
    bands = max(1, min(MOST_BANDS, inner // least))
    middle = [above + inner * k // bands for k in range(bands + 1)]
    return (*((0,) if above else ()), *middle, *((count,) if below else ()))


def urgent_stream() -> Any:
    """A stream whose blocks go before those of others, for numba; `close_stream` ends it."""
    try:
        from cuda.bindings import runtime
    except ImportError as error:
        raise BackendUnavailable(f"cuda.bindings is missing ({error})", "pip install cuda-bindings") from None
    status, _, greatest = runtime.cudaDeviceGetStreamPriorityRange()
    if int(status) == 0:
        status, stream = runtime.cudaStreamCreateWithPriority(runtime.cudaStreamDefault, greatest)
    if int(status) != 0:
        raise RuntimeError(f"CUDA stream: {status!s}")
    return cuda.external_stream(int(stream))


def close_stream(stream: Any) -> None:
    """End a stream of `urgent_stream`, once what was asked of it has been done."""
    from cuda.bindings import runtime

    runtime.cudaStreamDestroy(runtime.cudaStream_t(int(stream)))


class Bands:
    """Of rows of tiles `cuts[k]` to before `cuts[k + 1]`; `streams`: theirs, which `fork` lets begin where `stream` is, and
    `join` lets it wait for. `above`, `below`: whether the first and the last are at cut edges, whose blocks go first."""

    def __init__(self, stream: Any, cuts: tuple[int, ...], above: bool = False, below: bool = False):
        api: Any = cuda
        self.cuts, self._stream = cuts, stream
        count = len(cuts) - 1
        self._own = {k: urgent_stream() for k, cut in ((0, above), (count - 1, below)) if cut}
        self.streams = [self._own.get(k) or api.stream() for k in range(count)]
        last, this = ([api.event(timing=False) for _ in range(count)] for _ in range(2))
        self._done = last, this  # which bands were done with a pass
        self._begun = api.event(timing=False)
        self._first = True

    def fork(self) -> None:
        """All bands begin, once what `stream` was asked for has been done."""
        self._begun.record(self._stream)
        for stream in self.streams:
            self._begun.wait(stream)
        self._first = True

    def each(self, launch: Callable[[int, int, Any], None]) -> None:
        """One pass: launch(first, end, stream) for the rows of tiles of every band."""
        before, after = self._done
        for k, stream in enumerate(self.streams):
            for other in (k - 1, k + 1):
                if not self._first and 0 <= other < len(self.streams):
                    before[other].wait(stream)
            launch(self.cuts[k], self.cuts[k + 1], stream)
            after[k].record(stream)
        self._done, self._first = (after, before), False

    def join(self) -> None:
        """`stream` waits for all bands, and for what was asked of their streams besides."""
        done = self._done[1]
        for k, stream in enumerate(self.streams):
            done[k].record(stream)
            done[k].wait(self._stream)

    def close(self) -> None:
        """Free what numba does not; nothing may be under way."""
        for stream in self._own.values():
            close_stream(stream)
        self._own = {}
