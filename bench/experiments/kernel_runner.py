"""Measurement of the kernels of one grid: opened, checked, timed in turn, with their energy.

Like bench/experiments/group.py for forced kernels: an error of one of them is stored as the reason why it was skipped, and
the others go on.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.experiments.checks import FULL_SIZE_STEPS, Check, against_reference, compare, displaced
from softlab.bench.experiments.group import GroupRunner, close_quietly
from softlab.bench.measure.cases import Case, Kind, record_skip
from softlab.bench.measure.energy import STAGE, Counter, energy_counter, measure_energy, power_limit
from softlab.bench.measure.timing import Sample, Subject
from softlab.model.core.simulation import Simulation, State

MAX_CHECKED = 4096 * 4096  # masses up to which float64, too, is checked at its own size
NO_JOULES = "energy_skipped"  # the measure that says why there are none


class KernelRunner(GroupRunner):
    """Measures groups of kernels; an error of one does not stop the others."""

    refusals = (Exception,)

    def __init__(self, *arguments: Any):
        super().__init__(*arguments)
        self._references: dict[Kind, Check] = {}  # one check at the small size serves every size
        self._defaults: dict[Kind, str | None] = {}
        self._opened: dict[Kind, Simulation] = {}  # as the backend likes, until its kernel's turn comes
        self._counters: dict[str, Counter | None] = {}

    def measure(self, group: Sequence[Case]) -> None:
        """Check and time the cases of one group, all of one grid."""
        try:
            super().measure(group)
        finally:
            self._opened.clear()  # they are closed

    # ------------------------------------------------------------------ opening

    def _open(self, case: Case, stack: ExitStack) -> Simulation:
        """Open a simulation and compile its kernels."""
        self.report(f"{case}: opening")
        begin = time.perf_counter()
        simulation = self._enter(case, stack)
        self._first_steps(simulation)
        variant = (case.backend, case.precision, case.kernel)
        if variant not in self._compiled:
            self._compiled.add(variant)
            self.summary.compile_seconds += time.perf_counter() - begin
        simulation.rewind()
        return simulation

    def _enter(self, case: Case, stack: ExitStack) -> Simulation:
        """Open a case as requested; the first of a size with the backend's own choice of kernel, which is recorded."""
        variant = (case.scene.canonical(), case.backend, case.threads, case.precision)
        if variant not in self._defaults:
            self._defaults[variant] = None  # until it is known: a choice that breaks must not break every kernel
            options: dict[str, Any] = {"threads": case.word or "1x", "precision": case.precision}
            try:
                first = open_simulation(case.scene, case.backend, **options)
            except Exception as error:
                self.report(f"{case}: the backend's own choice fails: {error}")
            else:
                self._defaults[variant] = first.kernel
                self._opened[variant, first.kernel] = close_quietly(stack, first)
        opened = self._opened.pop((variant, case.kernel), None)
        return opened or close_quietly(stack, case.open())

    # ------------------------------------------------------------------ checking

    def _check(self, cases: Sequence[Case], simulations: dict[Kind, Simulation]) -> dict[Kind, str]:
        """Compare each kernel with NumPy at the small size, and with the simplest kernel at its own size."""
        warnings: dict[Kind, str] = {}
        witnesses: dict[str, tuple[str, State, np.ndarray]] = {}
        for case in cases:
            kind = case.simulation_kind
            simulation = simulations[kind]
            self.report(f"{case}: checking")
            try:
                reference = self._references.get(kind) or against_reference(simulation)
                self._references[kind] = reference
                difference = self._full_size_check(case, simulation, witnesses)
            except Exception as error:
                self._fail(case, error)
                del simulations[kind]
                continue
            self._store_checks(case, simulation.kernel, reference, difference)
            self._store_default(case)
            for check in (reference, difference):
                if isinstance(check, Check) and not check.good:
                    warnings[kind] = f"wrong answer: {check.error:.2g} spacings off ({check.note})"
                    self.summary.wrong.append((str(case), warnings[kind]))
        return warnings

    @staticmethod
    def _full_size_check(
        case: Case, simulation: Simulation, witnesses: dict[str, tuple[str, State, np.ndarray]]
    ) -> Check | str:
        """Compare a few steps from a displaced state with the first kernel of this size and precision."""
        if case.particles > MAX_CHECKED and case.precision != "float32":
            return (
                "at this size only float32 is compared with another kernel: loading and comparing a state takes seconds"
            )
        witness = witnesses.get(case.precision)
        state = witness[1] if witness else displaced(simulation)
        simulation.load(state)
        simulation.advance(FULL_SIZE_STEPS)
        simulation.check()
        if witness is None:
            name = f"{simulation.backend} {simulation.kernel}"
            witnesses[case.precision] = (name, state, simulation.read("position"))
            return "the other kernels of this size are compared with this one"
        note = f"own size, {FULL_SIZE_STEPS} steps, against {witness[0]}, {case.precision}"
        return compare(simulation, witness[2], note)

    def _store_default(self, case: Case) -> None:
        name = self._defaults.get((case.scene.canonical(), case.backend, case.threads, case.precision))
        if name is not None:
            self._store(case, {"default": (float(name == case.kernel), "", f"the backend's choice: {name}")})

    def _fail(self, case: Case, error: Exception) -> None:
        self._diverged(case, error)
        record_skip(self.store, self.summary, case, f"{type(error).__name__}: {error}")

    # ------------------------------------------------------------------ timing

    def _interleaved(self, subjects: Sequence[Subject], wanted: Sequence[int]) -> Iterator[tuple[Subject, Sample]]:
        broken: set[int] = set()
        for turn in range(max(wanted, default=0)):
            for k, subject in enumerate(subjects):
                if turn >= wanted[k] or k in broken:
                    continue
                try:
                    sample = subject.sample(self._neighbours)
                except Exception as error:
                    broken.add(k)
                    self._fail(subject.name, error)
                else:
                    yield subject, sample

    def _sample(self, subjects: Sequence[Subject], warnings: dict[Kind, str]) -> None:
        super()._sample(subjects, warnings)
        for subject in subjects:
            if self.effort.energy_seconds and subject.name.energy:
                self._measure_energy(subject)

    def _measure_energy(self, subject: Subject) -> None:
        """Store one sample with joules; none where the counter moved too rarely or stepping failed."""
        case: Case = subject.name
        if case.backend not in self._counters:
            self._counters[case.backend] = energy_counter(case.backend)
        counter = self._counters[case.backend]
        if counter is None or self.store.sample_count(case.description, self.summary.machine, case.sources, STAGE):
            return
        self.report(f"{case}: joules")
        run, reason = self.summary.run, "the counter advanced too rarely, or a step takes too long"
        measured = None
        try:
            measured = measure_energy(subject, counter, self.effort.energy_seconds)
        except Exception as error:  # the times, which stand, have marks of their own
            reason = f"{type(error).__name__}: {error}"
        if measured is None:
            self._store(case, {NO_JOULES: (None, "J", reason)})
            return
        self.store.add_sample(
            run, case.description, case.sources, measured.seconds, measured.steps, stage=STAGE, joules=measured.joules,
            suspect=measured.suspect(subject.seconds_per_step, power_limit(case.backend)),
        )  # fmt: skip
