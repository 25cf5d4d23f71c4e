"""Making mistakes in copies of the sources, and running tests against them."""

from __future__ import annotations

import importlib.util
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from .mistake import ROOT, Mistake, path_of

COPIED = (
    "model", "cpu_backend", "gpu_backend", "app", "bench", "plots", "labbook", "tests", "docs", "softlab", "setup.py",
    "pyproject.toml", "README.md",
)  # fmt: skip
NOTICED, SURVIVED, HANGS, NO_TEST = "noticed", "SURVIVED", "noticed (hangs)", "NO SUCH TEST"
FAILED, INTERRUPTED, USAGE, NOTHING = 1, 2, 4, 5  # of pytest's exit statuses: 2 also where a file does not import


@dataclass(frozen=True)
class Result:
    """What became of a mistake: one of the words above, the first test that failed (or what pytest said), how long it took."""

    mistake: Mistake
    outcome: str
    told: str
    seconds: float


class Copy:
    """A copy of the sources in a temporary folder, with kernels' caches of its own, in which one mistake at a time is made."""

    def __init__(self, root: Path = ROOT):
        self.folder = Path(tempfile.mkdtemp(prefix="softlab-mistakes-"))
        self._running: subprocess.Popen[str] | None = None
        self._starting, self._ended = threading.Lock(), False
        ignored = shutil.ignore_patterns("__pycache__", "*.nbi", "*.nbc", ".*")
        for name in COPIED:
            if (root / name).is_dir():
                shutil.copytree(root / name, self.folder / name, ignore=ignored)
            elif (root / name).exists():
                shutil.copy2(root / name, self.folder / name)

    def run(self, tests: Sequence[str], timeout: float, options: Sequence[str] = ()) -> tuple[int | None, str]:
        """Run these tests up to the first that fails. Returns (pytest's exit status or None after the timeout, its output)."""
        simulated = [
            test for test in tests if test.startswith("simulator/")
        ]  # the simulator is chosen before numba starts
        others = [test for test in tests if test not in simulated]
        parts = [(part, how) for part, how in ((simulated, "1"), (others, "0")) if part] or [([], "0")]
        status, said, end = 0, "", time.monotonic() + timeout
        for part, how in parts:
            status, said = self._run([*options, *part], end - time.monotonic(), {"NUMBA_ENABLE_CUDASIM": how})
            if status != 0:
                break
        return status, said

    def _run(self, arguments: Sequence[str], timeout: float, environment: dict[str, str]) -> tuple[int | None, str]:
        words = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "-p", "no:cacheprovider"]
        words += ["-n0"] if importlib.util.find_spec("xdist") else []  # mistakes, not tests, are what runs side by side
        environment = (
            os.environ
            | environment
            | {
                "PYTHONPATH": str(self.folder),
                "PYTHONDONTWRITEBYTECODE": "1",  # else a change within the second of the last one would go unseen
                "NUMBA_CACHE_DIR": str(self.folder / ".numba"),
            }
        )
        with self._starting:
            if self._ended:
                return None, "stopped"
            self._running = running = subprocess.Popen(
                [*words, *(word if word.startswith("-") else path_of(word, self.folder) for word in arguments)], cwd=self.folder, env=environment, text=True,
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=os.name == "posix",
            )  # fmt: skip
        try:
            said, _ = running.communicate(timeout=timeout)
            return running.returncode, said
        except subprocess.TimeoutExpired:
            self._kill()
            running.communicate()
            return None, f"over {timeout:.0f} s"

    def stop(self) -> None:
        """End what runs in it; nothing more is started."""
        with self._starting:
            self._ended = True
            self._kill()

    def _kill(self) -> None:
        running = self._running
        if running is None or running.poll() is not None:
            return
        if os.name == "posix":
            os.killpg(running.pid, signal.SIGKILL)  # its own session: the tests' own processes, too
        else:
            running.kill()

    def try_out(self, mistake: Mistake, timeout: float, tests: Sequence[str] | None = None) -> Result:
        """Make the mistake, run `tests` (None: those near by, then what of them only `--rest` runs), put the text back."""
        begin, text = time.monotonic(), mistake.read(self.folder)
        file = self.folder / mistake.file
        file.write_text(mistake.applied(text), encoding="utf-8")
        try:
            judged = _judged(*self.run(mistake.tests if tests is None else tests, timeout))
            if tests is None and judged[0] in (SURVIVED, NO_TEST):
                rest = _judged(*self.run(mistake.tests, timeout, ["--rest"]))
                judged = judged if rest[0] == NO_TEST else rest
        finally:
            file.write_text(text, encoding="utf-8")
        return Result(mistake, *judged, time.monotonic() - begin)

    def remove(self) -> None:
        self.stop()
        shutil.rmtree(self.folder, ignore_errors=True)


def _judged(status: int | None, said: str) -> tuple[str, str]:
    lines = said.strip().splitlines()
    failed = next((line.removeprefix("FAILED ").split(" - ")[0] for line in lines if line.startswith("FAILED ")), "")
    broken = next((line for line in lines if line.startswith("ERROR ")), "")
    if status is None:
        return HANGS, said
    if status == 0:
        return SURVIVED, lines[-1] if lines else ""
    if status in (USAGE, NOTHING) or "ERROR: not found" in said:
        return NO_TEST, broken or (lines[-1] if lines else "")
    return NOTICED, failed or broken or (lines[-1] if lines else f"exit status {status}")


def try_all(
    mistakes: Sequence[Mistake], *, workers: int = 2, timeout: float = 900.0, tests: Sequence[str] | None = None,
    tell: Callable[[Result], None] = lambda result: None,
) -> list[Result]:  # fmt: skip
    """Every mistake, `workers` at a time; `tell` hears of each when it is done. Ctrl-C ends what runs, removes the copies, and
    is raised again."""
    waiting: queue.SimpleQueue[Mistake] = queue.SimpleQueue()
    for mistake in mistakes:
        waiting.put(mistake)
    done: list[Result] = []
    copies: list[Copy] = []
    stopped = threading.Event()

    def work(copy: Copy) -> None:
        while not stopped.is_set():
            try:
                mistake = waiting.get_nowait()
            except queue.Empty:
                return
            result = copy.try_out(mistake, timeout, tests)
            if not stopped.is_set():
                done.append(result)
                tell(result)

    threads: list[threading.Thread] = []
    try:
        copies += [Copy() for _ in range(min(workers, len(mistakes)))]
        threads += [threading.Thread(target=work, args=(copy,), daemon=True) for copy in copies]
        for thread in threads:
            thread.start()
        for thread in threads:
            while thread.is_alive():
                thread.join(0.2)  # in short waits: Ctrl-C is heard on every system
    finally:
        stopped.set()
        for copy in copies:
            copy.stop()
        for thread in threads:
            thread.join(10.0)  # what it ran has ended: it puts the text back and goes
        for copy in copies:
            copy.remove()
    return done
