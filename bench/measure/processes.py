"""Independent tasks on several processes at once: what is prepared before the first measurement."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed

from softlab.bench.measure.progress import progress_bar


def run_in_processes(
    tasks: Mapping[str, Callable[[], object]], workers: int, progress: bool, title: str
) -> Sequence[str]:
    """Run the tasks, first ones first, and return the names of those that raised nothing.

    An error in a process is dropped; it is raised again where the result is needed. Ctrl-C ends the processes and
    is raised.
    """
    context = multiprocessing.get_context("spawn")  # a fork would share a CUDA context, which none survives
    done: list[str] = []
    workers = min(workers, len(tasks))
    pool = ProcessPoolExecutor(workers, context, signal.signal, (signal.SIGINT, signal.SIG_IGN))
    try:
        futures: dict[Future[object], str] = {pool.submit(task): name for name, task in tasks.items()}
        with progress_bar(progress) as bar:
            shown = bar.add_task(f"{title} on {workers} processes", total=len(tasks))
            for future in as_completed(futures):
                if future.exception() is None:
                    done.append(futures[future])
                bar.update(shown, advance=1)
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
    return done
