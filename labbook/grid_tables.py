"""The lab book's tables of the hand-out's grid: CPU and GPU with and without graphics, and threads."""

from __future__ import annotations

from softlab.bench.measure import words
from softlab.bench.measure.timing import DRAW_EVERY
from softlab.bench.store.results import Timing
from softlab.labbook.tables import DASH, Table, table
from softlab.plots.core.data import Results, Source, is_suspect, sound
from softlab.plots.figures.crossover import Pair, pairs

MARK = "?"
SUSPECT = "?: suspect"
COLUMNS = 4  # sizes of the table of threads


def graphics_tables(results: Results) -> list[Table]:
    """Return a table of the machine that timed both processors: times per step and their ratio, with and without graphics."""
    source = results.first(pairs)
    if source is None:
        return []
    plain, drawn = (
        {pair.gpu.particles: pair for pair in pairs(source, graphics=graphics)} for graphics in (False, True)
    )
    rows = [
        [words.count(masses), *_cells(plain.get(masses)), *_cells(drawn.get(masses))]
        for masses in sorted(plain.keys() | drawn.keys())
    ]
    title = (
        f"Time of a step without graphics, and with every {DRAW_EVERY} steps drawn (float32, square grids). CPU: the "
        f"{source.processor}{source.bracket} with its fastest number of threads; GPU: the {source.gpu}. Ratio: CPU time over "
        f"GPU time; in brackets, no difference beyond measurement noise{_marked(rows)}"
    )
    head = ["Masses", "CPU", "GPU", "Ratio", "CPU, drawn", "GPU, drawn", "Ratio, drawn"]
    return [table(title, head, rows, left=0)]


def _cells(pair: Pair | None) -> list[str]:
    if pair is None:
        return [DASH] * 3
    ratio = words.number(pair.ratio, 2)
    return [_time(pair.cpu), _time(pair.gpu), ratio if pair.clear else f"({ratio})"]


def _time(timing: Timing) -> str:
    return words.seconds(timing.median) + MARK * is_suspect(timing)


def _marked(rows: list[list[str]]) -> str:
    return f". {SUSPECT}" if any(cell.endswith(MARK) for row in rows for cell in row) else ""


def thread_tables(results: Results) -> list[Table]:
    """Return a table of each machine: speed-up and efficiency of threads over the fewest that were timed, up to all cores."""
    return [drawn for source in results.featured if (drawn := _threads(source))]


def _threads(source: Source) -> Table | None:
    by_threads: dict[int, dict[int, Timing]] = {}
    for word in dict.fromkeys(t.thread_word for t in source.timings if t.backend == "cpu"):
        for timing in sound(source.select("cpu", word)):
            if timing.threads and timing.threads <= source.machine.record["cores"]:
                by_threads.setdefault(timing.threads, {})[timing.particles] = timing
    if len(by_threads) < 2:
        return None
    fewest = min(by_threads)
    sizes = sorted(set.intersection(*map(set, by_threads.values())))
    sizes = (
        [sizes[round(k * (len(sizes) - 1) / (COLUMNS - 1))] for k in range(COLUMNS)] if len(sizes) > COLUMNS else sizes
    )
    rows = [
        [str(threads), *(_speed_up(by_threads[fewest][size], timings[size], fewest, threads) for size in sizes)]
        for threads, timings in sorted(by_threads.items())
    ]
    base = "one thread" if fewest == 1 else f"{fewest} threads"
    title = (
        f"Speed-up of a step over {base} and, in brackets, efficiency (speed-up over the number of threads as a multiple of "
        f"the baseline's), by number of masses. {source.processor}{source.bracket}{_marked(rows)}"
    )
    if fewest > 1:
        title += ". One thread was not timed here: softlab sweep --threads 1 --threads 1x"
    return table(title, ["Threads", *(words.count(size) for size in sizes)], rows, left=0)


def _speed_up(base: Timing, timing: Timing, fewest: int, threads: int) -> str:
    ratio = base.median / timing.median
    mark = MARK * (is_suspect(base) or is_suspect(timing))
    return f"{words.number(ratio, 2)} ({words.percent(ratio * fewest / threads)}){mark}"
