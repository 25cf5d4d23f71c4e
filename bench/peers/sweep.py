"""`softlab sweep --peers`: the lab compared with programs that a user could choose instead.

For every scene and size, each backend and precision is a group: the lab (its own choice of kernel, as many threads as
cores) and every peer that can run the scene here, in one process, sampled in turn (A B C A B C ...). Before a time is
stored, each state is compared with the lab's CPU in float64 `exact` math, at that very size. In the store all of them,
the lab too, are configurations with a `peer`, so that ordinary figures and tables do not use them. Resumable, safe
under Ctrl-C; a peer that is not installed is skipped with its reason.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from typing import Any

from softlab.bench.experiments.group import GroupRunner, close_quietly
from softlab.bench.experiments.sweep import Asked, Sweep
from softlab.bench.measure.cases import Case, Kind, SweepSummary, record_skip
from softlab.bench.measure.experiment import Report, backends_here
from softlab.bench.measure.gpu import gpu_simulated
from softlab.bench.measure.timing import Subject
from softlab.bench.peers.answers import Judge
from softlab.bench.peers.base import Peer
from softlab.bench.peers.cases import Beside, PeerCase, group_of
from softlab.bench.peers.registry import OURS, PEERS
from softlab.bench.peers.scenes import peer_scenes
from softlab.bench.store.database import Store
from softlab.model.base.memory import available_bytes, readable
from softlab.model.core.build import build
from softlab.model.core.simulation import Simulation


def run_peers(
    store: Store, *, scenes: Iterable[str] | None = None, peers: Sequence[Peer] = PEERS, **how: Any
) -> SweepSummary:
    """Measure the comparisons that the store lacks, and return a summary.

    `scenes`: words of bench/peers/scenes.py; `how`: fields of `Asked` of bench/experiments/sweep.py.

    Raises SceneError (an impossible choice), InputError (the store), BackendUnavailable (a requested backend).
    """
    usual: dict[str, Any] = {"command": "softlab sweep --peers", "again": False}
    asked = Asked(**usual | how)
    effort, quick = asked.effort(), asked.quick
    here = backends_here(asked.backends)
    lengths = None if asked.sizes is None else list(asked.sizes)
    wanted_scenes = peer_scenes(scenes, quick)
    planned = [(scene, sized) for scene in wanted_scenes for sized in scene.sized(quick, lengths)]
    peers = [peer for peer in peers if any(scene.word in peer.scenes for scene in wanted_scenes)]
    wanted = list(asked.backends or ("cpu", "gpu"))  # peers of an unavailable backend are skipped with their reason
    groups = [
        group_of(scene, sized, name, precision, peers)
        for scene, sized in planned
        for name in wanted
        for precision in asked.precisions
    ]
    summary = SweepSummary.begun(store, "peers")
    return _Comparison(PeerRunner(store, effort, summary, here, {})).compare(
        groups, peers, asked.progress, asked.command
    )


class _Comparison(Sweep):
    """A sweep whose groups are softlab and its peers at one size; `refused`: cases that cannot run here, with
    reasons."""

    whole = True
    refused: Sequence[tuple[PeerCase, str]] = ()

    def compare(
        self, groups: Sequence[Sequence[PeerCase]], peers: Sequence[Peer], progress: bool, command: str
    ) -> SweepSummary:
        """Measure the groups that the store lacks; the lab is measured again next to a peer that is missing."""
        available = {peer.name: peer.available() for peer in peers}
        able: list[list[PeerCase]] = []
        for group in groups:
            reasons = [self._refusal(case, available) for case in group]
            pairs = list(zip(group, reasons, strict=True))
            self.refused = [*self.refused, *((case, reason) for case, reason in pairs if case.peer and reason)]
            runnable = [case for case, reason in pairs if not reason]
            if len(runnable) > 1 or all(
                self._missing(case) <= 0 for case in runnable
            ):  # the lab alone is no comparison
                able.append(runnable)
        self.run(able, progress, command)
        self.summary.skipped += [(str(case), reason) for case, reason in self.refused]
        return self.summary

    def _weight(self, case: Case) -> float:
        return 1.0

    def _refusal(self, case: PeerCase, available: dict[str, tuple[bool, str]]) -> str | None:
        here = self.runner.backends
        if case.peer is None:
            return None if case.backend in here else f"no {case.backend} here"
        works, text = available[case.peer.name]
        if not works:
            return f"{case.peer.label}: {text}"
        if case.backend not in here or (case.backend == "gpu" and gpu_simulated()):
            return f"{case.peer.label}: softlab has no {case.backend} here to compare with"
        reason = case.peer.refusal(case.scene)
        return f"{case.peer.label}: {reason}" if reason else None

    def _measure(self, cases: Sequence[Any], report: Report) -> None:
        for case, reason in self.refused:
            self._skip(case, reason)
        self.refused = ()
        lacking = [case for case in cases[1:] if self._missing(case) > 0] or cases[1:]
        affordable = self._affordable([cases[0], *lacking])
        self.runner.report = lambda text: report(text, 0)
        if len(affordable) > 1 and affordable[0].peer is None:
            self.runner.measure(affordable)
        report(str(cases[0]), len(cases))

    def _affordable(self, cases: Sequence[Any]) -> list[Any]:
        """Return the cases that fit into time and memory when all are open at once; record the others as skipped."""
        affordable, free, used = [], available_bytes(), 0
        for case in super()._affordable(cases):
            if used + case.host_bytes > 0.8 * free:
                left = readable(max(0, int(0.8 * free) - used))
                self._skip(case, f"needs {readable(case.host_bytes)} of main memory, of which {left} may be used")
            else:
                used += case.host_bytes
                affordable.append(case)
        return affordable

    def estimate(self, case: Any) -> float | None:
        """Return the time [s] of the check and all repeats, from the last size; None if unknown."""
        needed = super().estimate(case)
        if needed is None:
            return None
        particles, seconds, _ = self.costs[case.kind]
        return needed + case.steps_checked * seconds * max(1.0, case.particles / particles)


class PeerRunner(GroupRunner):
    """Measures softlab and its peers at one size. If a peer fails, the others continue."""

    refusals = (Exception,)

    def __init__(self, *how: Any):
        super().__init__(*how)
        self._judge = Judge(self.store, self.summary, self.effort.max_seconds)

    def measure(self, group: Sequence[Case]) -> None:
        """Check and time the cases of one group, the lab's first."""
        self._body = build(group[0].scene)
        super().measure(group)

    def _enter(self, case: Any, stack: ExitStack) -> Any:
        if case.peer is None:
            return super()._enter(case, stack)
        opened = close_quietly(stack, case.peer.open(case.scene, case.precision, case.threads or 1))
        return Beside(case.peer, opened, self._body)

    def _variant(self, case: Case, simulation: Simulation) -> Kind:
        return case.kind

    def _reason(self, case: Any, error: BaseException) -> str:
        return f"{case.peer.label if case.peer else OURS}: {error or type(error).__name__}"

    def _check(self, cases: Sequence[Any], simulations: dict[Kind, Simulation]) -> dict[Kind, str]:
        """Store the distance of each state from the lab's in float64; return the marks of the samples."""
        marks: dict[Kind, str] = {}
        for case in cases:
            simulation = simulations[case.simulation_kind]
            self._store(case, {"kernel": (None, "", simulation.kernel)})
            self.report(f"{case}: checking")
            try:
                mark = self._judge.check(case, simulation, self._body)
            except Exception as error:
                self._skip(case, error)
                del simulations[case.simulation_kind]
            else:
                marks |= {case.simulation_kind: mark} if mark else {}
        return marks

    def _skip(self, case: Any, error: BaseException) -> None:
        record_skip(self.store, self.summary, case, self._reason(case, error))

    def _wanted(self, subjects: Sequence[Subject]) -> list[int]:
        wanted = [max(1, missing) for missing in super()._wanted(subjects)]
        return [max(wanted), *wanted[1:]]

    def _sample(self, subjects: Sequence[Subject], warnings: dict[Kind, str]) -> None:
        if len(subjects) < 2 or subjects[0].name.peer is not None:
            return
        try:
            super()._sample(subjects, warnings)
        except Exception as error:
            reason = f"stopped while this size was sampled: {error or type(error).__name__}"
            for subject in subjects:
                record_skip(self.store, self.summary, subject.name, reason)
