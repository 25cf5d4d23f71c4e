"""Passes over a sheet in bands of its rows of tiles, each band on its own stream.

A pass in one launch ends when its last block does; until then more and more of the GPU is idle. A band's next pass
reads and overwrites only the band and its two neighbours: it can begin when these three have done the current pass,
while other bands have not. So passes overlap along the sheet, and work between two passes of a band (sending its rows
to another GPU, waiting for another's) does not delay other bands. Made for streams that are captured in a graph: from
Python each band is a launch.
"""

from __future__ import annotations

from collections.abc import Callable

from numba import cuda

from softlab.gpu_backend.core.device import Stream
from softlab.model.base.errors import BackendUnavailable

MOST_BANDS = 4  # besides those at cut edges: with three, one is ready whenever blocks end


def band_cuts(count: int, least: int, above: int = 0, below: int = 0) -> tuple[int, ...]:
    """Return the starts of the bands of `count` rows of tiles, and the end.

    `above` and `below` rows at the ends are separate bands (0: none), the others bands of `least` rows or more; (0,
    count) if there are too few rows for several.
    """
    inner = count - above - below
    if inner < 1:
        return 0, count
    bands = max(1, min(MOST_BANDS, inner // least))
    middle = [above + inner * k // bands for k in range(bands + 1)]
    return (*((0,) if above else ()), *middle, *((count,) if below else ()))


def urgent_stream() -> Stream:
    """Return a stream, for numba, whose blocks have priority over those of others; `close_stream` ends it."""
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


def close_stream(stream: Stream) -> None:
    """End a stream of `urgent_stream`, after its work is done."""
    from cuda.bindings import runtime

    runtime.cudaStreamDestroy(runtime.cudaStream_t(int(stream)))


class Bands:
    """Bands of the rows of tiles `cuts[k]` to before `cuts[k + 1]`.

    `streams`: their streams, which `fork` starts after the work of `stream`, and which `join` lets it wait for.
    `above`, `below`: true if the first and the last band are at cut edges, whose blocks have priority.
    """

    def __init__(self, stream: Stream, cuts: tuple[int, ...], above: bool = False, below: bool = False):
        self.cuts, self._stream = cuts, stream
        count = len(cuts) - 1
        self._urgent_streams = {k: urgent_stream() for k, cut in ((0, above), (count - 1, below)) if cut}
        self.streams = [self._urgent_streams.get(k) or cuda.stream() for k in range(count)]
        last, this = ([cuda.event(timing=False) for _ in range(count)] for _ in range(2))
        self._done = last, this  # events: the bands' ends of a pass
        self._begun = cuda.event(timing=False)
        self._first = True

    def fork(self) -> None:
        """Start all bands, after the work queued on `stream`."""
        self._begun.record(self._stream)
        for stream in self.streams:
            self._begun.wait(stream)
        self._first = True

    def each(self, launch: Callable[[int, int, Stream], None]) -> None:
        """Do one pass: launch(first, end, stream) for the rows of tiles of every band."""
        before, after = self._done
        for k, stream in enumerate(self.streams):
            for other in (k - 1, k + 1):
                if not self._first and 0 <= other < len(self.streams):
                    before[other].wait(stream)
            launch(self.cuts[k], self.cuts[k + 1], stream)
            after[k].record(stream)
        self._done, self._first = (after, before), False

    def join(self) -> None:
        """Let `stream` wait for all bands, and for other work on their streams."""
        done = self._done[1]
        for k, stream in enumerate(self.streams):
            done[k].record(stream)
            done[k].wait(self._stream)

    def close(self) -> None:
        """Free what numba does not; nothing may be running."""
        for stream in self._urgent_streams.values():
            close_stream(stream)
        self._urgent_streams = {}
