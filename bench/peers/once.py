"""`python -m softlab.bench.peers.once`: every peer of a backend opened once at a small size, its answer checked, a line each.

For a new machine, or one that is available for minutes only. Nothing is stored, and the times are of single short runs,
not to be quoted. The exit status is 1 if a result is wrong that should not be, or an installed peer fails.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.experiments.checks import displaced
from softlab.bench.peers.answers import distances
from softlab.bench.peers.bars.tip import BARS, Tip
from softlab.bench.peers.base import Opened, Peer
from softlab.bench.peers.cuda_cpp import CudaConstants
from softlab.bench.peers.registry import PEERS
from softlab.bench.peers.scenes import SCENES, PeerScene
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

SIZES = {
    "grid": (48, 300, 700),
    "rigid": (2,),
    **dict.fromkeys(BARS, (2,)),
}  # masses (towers) per side: grids for one block, resident tiles, passes
OTHERS = (40,)
STEPS, TRIAL = 60, 64
MAY_FAIL = ("implicit-4", "implicit-1")  # scenes on which few iterations may not be enough, which is a finding


def contestants(word: str, scene: Scene, backend: str) -> Iterator[tuple[str, Peer, Opened | None]]:
    """Yield (name, peer, None), and for CUDA C++ on tiles each of its tiles as (name, peer, opened)."""
    for peer in PEERS:
        if peer.backend != backend or word not in peer.scenes:
            continue
        if peer.name != "cuda_cpp_blocked" or not peer.available()[0]:
            yield peer.name, peer, None
            continue
        from softlab.bench.peers import cuda_cpp_blocked, cuda_driver

        (processors,) = cuda_driver.attributes("MULTIPROCESSOR_COUNT")
        for kernel, tile in cuda_cpp_blocked.candidates(scene.grid.rows, scene.grid.columns, processors):
            name = f"{peer.name} {kernel} {tile.name}"
            try:
                opened = cuda_cpp_blocked.Blocked(CudaConstants(scene, "float32"), "float32", kernel, tile)
            except Exception as error:
                print(f"  {name}: cannot be opened: {error}", flush=True)
                continue
            yield name, peer, opened


def run(word: str, scene: Scene, what: PeerScene, backend: str, threads: int) -> int:
    """Return the number of failed checks."""
    if what.tip is not None:
        return _bars(word, scene, what.tip(scene), backend, threads)
    steps = what.check_steps if what.bound else STEPS
    with open_simulation(scene, "cpu", precision="float64", math="exact") as judge:
        start = judge.state() if scene.bodies else displaced(judge)
        judge.load(start)
        judge.advance(steps)
        expected = judge.state().position
    rows, columns = scene.grid.rows, getattr(scene.grid, "columns", 1)
    print(f"{word}, {rows} x {columns}, {steps} steps", flush=True)

    def check(name: str, peer: Peer, opened: Opened | None) -> int:
        begin = time.perf_counter()
        with opened or peer.open(scene, "float32", threads) as running:
            return _report(name, peer, running, scene, what, start, expected, steps, begin)

    return _each(word, scene, backend, check)


def _each(word: str, scene: Scene, backend: str, check: Callable[[str, Peer, Opened | None], int]) -> int:
    """Return the number of failures of all peers that can run the scene. `check(name, peer, opened)`: of one."""
    failed = 0
    for name, peer, opened in contestants(word, scene, backend):
        able, reason = peer.available()
        refusal = peer.refusal(scene) if able else reason
        if refusal:
            print(f"  {name}: skipped: {refusal}", flush=True)
            continue
        try:
            failed += check(name, peer, opened)
        except Exception as error:
            failed += 1
            print(f"  {name}: BROKE: {type(error).__name__}: {error}", flush=True)
    return failed


def _bars(word: str, scene: Scene, exact: Tip, backend: str, threads: int) -> int:
    """Return the number of failures like `run`, for a bar whose exact result is known.

    Errors due to few iterations are reported, but not counted.
    """
    print(f"{word}, {len(scene.tetrahedra_set.tetrahedra)} tetrahedra, {exact.frames} frames", flush=True)

    def check(name: str, peer: Peer, _: Opened | None) -> int:
        peer_tip, begin = peer.tip(scene), time.perf_counter()
        with peer.open(scene, "float32", threads) as running:
            running.synchronize()
            ready, begin = time.perf_counter() - begin, time.perf_counter()
            running.advance(exact.frames)
            running.synchronize()
            each = 1e3 * (time.perf_counter() - begin) / exact.frames
            position = running.read()[0]
        law = f", by its own law {peer_tip.error(scene, position):.2g}" if peer_tip else ""
        off = exact.error(scene, position)
        print(
            f"  {name}: tip {off:.2g} of its way off{law}, {each:.3g} ms a frame, open after {ready:.1f} s", flush=True
        )
        return 0

    return _each(word, scene, backend, check)


def _report(
    name: str, peer: Peer, opened: Opened, scene: Scene, what: PeerScene, start: State, expected: np.ndarray, steps: int,
    begin: float,
) -> int:  # fmt: skip
    """Print the result of one peer; return 1 if it is wrong and should not be."""
    opened.synchronize()
    ready = time.perf_counter() - begin
    opened.load(start.position, start.velocity)
    opened.advance(steps)
    opened.synchronize()
    error, _ = distances(opened.read()[0], expected, build(scene), scene.grid.spacing)
    opened.load(start.position, start.velocity)
    opened.advance(TRIAL)
    opened.synchronize()
    begin = time.perf_counter()
    opened.advance(TRIAL)
    opened.synchronize()
    each = 1e6 * (time.perf_counter() - begin) / TRIAL
    bound = what.bound or peer.bound(scene, "float32")
    wrong = not (math.isfinite(error) and error <= bound)
    expected_to = wrong and what.word in MAY_FAIL
    verdict = "too far off, as few iterations are" if expected_to else "WRONG" if wrong else "ok"
    print(
        f"  {name}: {verdict}, {error:.2g} spacings off (bound {bound:.2g}), about {each:.3g} us a step, {opened.kernel}, "
        f"open after {ready:.1f} s",
        flush=True,
    )
    return int(wrong and not expected_to)


def main(arguments: Iterable[str] | None = None) -> int:
    """Run the command line; return the exit status, 1 if a peer failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--backend", choices=("cpu", "gpu"), default="gpu")
    parser.add_argument("--scene", action="append", choices=list(SCENES), help="only this one; repeatable")
    parser.add_argument("--size", type=int, action="append", help="masses (towers) a side; repeatable")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=math.inf, help="start no further scene after so long")
    chosen = parser.parse_args(None if arguments is None else list(arguments))
    begin, failed = time.perf_counter(), 0
    for word in chosen.scene or SCENES:
        what = SCENES[word]
        for scene in what.sized(False, chosen.size or SIZES.get(word, OTHERS)):
            if time.perf_counter() - begin > chosen.seconds:
                print(f"{word}: left out, {chosen.seconds:g} s are used up")
                break
            failed += run(word, scene, what, chosen.backend, chosen.threads)
    print(f"{failed} failed, {time.perf_counter() - begin:.0f} s")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
