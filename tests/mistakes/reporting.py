"""Mistakes in measuring and reporting: figures, sentences, results, exit statuses."""

from __future__ import annotations

from .mistake import mistakes_of

FIGURES = mistakes_of({
    "plots/figures/lab_step.py": {
        "test_figure_axes.py": {
            "an axis in s with ticks in ms": ('x_label="step size / ms"', 'x_label="step size / s"'),
            "ticks ten times too small": ('[f"{1000 * dt:g}" for dt in steps]', '[f"{100 * dt:g}" for dt in steps]'),
        },
    },
    "plots/figures/energies.py": {
        "test_figure_axes.py": {
            "energies in mJ": ('ax.set_ylabel("energy / J")', 'ax.set_ylabel("energy / mJ")'),
            "kinetic energy under the name of the springs'": ('("spring", "in the springs"', '("kinetic", "in the springs"'),
        },
    },
    "plots/core/bandwidth.py": {
        "test_figure_axes.py test_figures.py::test_fraction_of_the_copy_bandwidth test_ladder.py": {
            "what stays in a cache counts as memory's": ("> (last or UNKNOWN_CACHE)", ">= 0"),
            "the GPU's share of the host's bandwidth": ('"gpu_copy_bandwidth" if backend == "gpu" else "copy_bandwidth"', '"copy_bandwidth" if backend == "gpu" else "gpu_copy_bandwidth"'),
        },
    },
    "plots/figures/joules.py": {
        "test_figure_axes.py": {"joules of a step under the name of a million": ("MILLION = 1e6", "MILLION = 1e3")},
    },
    "plots/figures/roofline.py": {
        "test_figure_axes.py": {"the roof of a mass, not of the grid": ("return self.pass_seconds * timing.particles /", "return self.pass_seconds /")},
    },
    "plots/figures/convergence.py": {
        "test_convergence.py::test_figure_and_sentence": {"milliseconds that are seconds": ("lambda entry: 1e3 * entry.seconds", "lambda entry: entry.seconds")},
    },
    "plots/figures/scaling/threads.py": {
        "test_figure_axes.py": {
            "a speed-up upside down": ("return lambda timing, seconds: bases[timing.rows, timing.columns].median / seconds", "return lambda timing, seconds: seconds / bases[timing.rows, timing.columns].median"),
        },
    },
    "plots/core/style.py": {
        "test_figure_axes.py": {
            "times in kiloseconds": ('EngFormatter(unit="s")', 'EngFormatter(unit="ks")'),
            "curves of the quickest repeat": ("y = np.array([value(timing, timing.median) for timing in right])", "y = np.array([value(timing, timing.low) for timing in right])"),
        },
    },
    "plots/core/data.py": {
        "test_figures.py test_claims_by_hand.py test_claims_accuracy.py": {
            "wrong answers take part": ("return [timing for timing in timings if not is_wrong(timing)]", "return list(timings)"),
            "an infinite error is right": ('infinite = timing.error is not None and timing.error == float("inf")', "infinite = False"),
            "curves of any precision": ("and timing.precision == precision\n            and timing.graphics == graphics", "and timing.graphics == graphics"),
        },
    },
})  # fmt: skip

HAND = "test_claims_by_hand.py test_claims_accuracy.py"
CLAIMS = mistakes_of({
    "plots/core/apart.py": {
        "plots/test_apart.py": {
            "overlapping repeats are a difference": ("return -1 if high < 1 else 1 if low > 1 else 0", "return -1 if a.median < b.median else 1"),
            "a session bears any ratio": ("< 1 + SMALL", "< 1"),
            "few repeats are as good as many": ("if timing.count < FEW else 1.0", "if timing.count < 0 else 1.0"),
        },
    },
    "labbook/claims/claim.py": {
        HAND: {
            "the smallest grid told as the largest": ('not measured.", (-1,))', 'not measured.", (0,))'),
            "the bandwidth of the smallest grid": ("((largest,),) = needed(timings[-1:])", "((largest,),) = needed(timings[:1])"),
            "float64 told of the smallest grid": ("single, double = needed(both)[-1]", "single, double = needed(both)[0]"),
            "the GPU is flat as far as it was measured": ("if timing.median > FLAT * curve[0].median:", "if timing.median < FLAT * curve[0].median:"),
        },
    },
    "labbook/claims/comparison.py": {
        HAND: {
            "the slower backend is the faster one": ("if last.ratio < 1:", "if last.ratio > 1:"),
            "with graphics the slower backend is the faster one": ("pair.clear and pair.ratio < 1]", "pair.clear and pair.ratio > 1]"),
            "crossover told at the smallest size": ("first, last = usable[0], usable[-1]", "first, last = usable[0], usable[0]"),
            "drawing told at the smallest size": ("without, drawn = both[-1]", "without, drawn = both[0]"),
        },
    },
    "labbook/claims/accuracy.py": {
        HAND: {
            "at equal error the slower backend is the faster one": ('("GPU", "CPU", ratio) if ratio > 1', '("GPU", "CPU", ratio) if ratio < 1'),
            "float32's floor told at twenty times": ("if single.error < 2 * double.error:", "if single.error < 20 * double.error:"),
            "the finest step told as the coarsest": ("coarse, fine = max(runs, key=lambda p: p.dt), min(", "coarse, fine = min(runs, key=lambda p: p.dt), min("),
        },
    },
    "labbook/claims/findings.py": {
        HAND: {"smaller steps make it worse at any rate": ("worse = worse and smallest.value > 2 * least.value", "worse = worse and smallest.value > 20 * least.value")},
    },
    "labbook/claims/hard.py": {
        HAND: {
            "failed hard runs are no bug": ("failed otherwise, which is a bug of this lab:", "failed otherwise:"),
            "failed hard runs support the claim": ('"runs": float(len(rows))}, not counts["fail"])', '"runs": float(len(rows))}, True)'),
            "backends that differ are no bug": ("a bug of this lab: {'; '.join(different)}.", "{'; '.join(different)}."),
        },
    },
})  # fmt: skip

RESULTS = mistakes_of({
    "bench/store/results.py": {
        "test_results.py": {
            "suspect only beyond half": ("SPREAD_LIMIT = 0.10", "SPREAD_LIMIT = 0.50"),
            "quartiles are extremes": ("np.percentile(per_step, (25, 75))", "np.percentile(per_step, (0, 100))"),
            "an error of other sources counts": ("current = error is not None and error.sources == sources", "current = error is not None"),
        },
    },
    "bench/store/database.py": {
        "test_results.py": {
            "another machine's measure is held": ("AND machine = :machine AND {schema.SOURCES} AND name = :name LIMIT 1", "AND {schema.SOURCES} AND name = :name LIMIT 1"),
            "another stage's samples are held": ("AND {schema.SOURCES} AND stage = :stage", "AND {schema.SOURCES}"),
        },
    },
    "bench/measure/timing.py": {
        "test_timing.py": {
            "a busy neighbour is not noticed": ("if busy > spare + BUSY_NEIGHBOUR:", "if busy > cores + BUSY_NEIGHBOUR:"),
            "one's own time is a neighbour's": ("max(0.0, (used - self._seen[1]) - (process - self._seen[2])) / passed", "max(0.0, used - self._seen[1]) / passed"),
            "a sample does not wait for the device": ("simulation.advance(steps)\n            simulation.synchronize()\n            return", "simulation.advance(steps)\n            return"),
            "a drawn sample does not wait for the device": ("            self.renderer.show(simulation)\n        simulation.synchronize()", "            self.renderer.show(simulation)"),
            "restoring is a part of the sample": ("self._snapshot = simulation.snapshots\n        simulation.synchronize()", "self._snapshot = simulation.snapshots"),
            "short samples are not marked": ("if seconds < SHORTEST_SAMPLE:", "if seconds < 0 * SHORTEST_SAMPLE:"),
        },
    },
    "bench/measure/samples.py": {
        "test_marks.py": {
            "a sample's marks are dropped on the way to the store": ("(sample.suspect, warning(subject.name), simulated)", "(warning(subject.name), simulated)"),
            "a wrong answer's mark is dropped": ("(sample.suspect, warning(subject.name), simulated)", "(sample.suspect, simulated)"),
        },
    },
    "bench/measure/costs_timing.py": {
        "test_marks.py": {"marks of ratios are dropped": ("for mark in (*beside, *(sample.suspect for sample in samples)) if mark)", "for mark in () if mark)")},
    },
    "bench/experiments/accuracy/experiment.py": {
        "test_marks.py": {"samples of accuracy runs are not stored": ("in in_turns(store, summary.run, STAGE, subjects, repeats):", "in ():")},
    },
    "bench/experiments/accuracy/judgement.py": {
        "test_judgement.py": {"resolved at the reference's own error": ("RESOLVED = 10", "RESOLVED = 1")},
    },
    "bench/experiments/accuracy/judge.py": {
        "test_judgement.py": {
            "a run tells what its reference does not resolve": ("if error < 10 * estimate / scene.grid.spacing:", "if error < estimate / scene.grid.spacing:"),
        },
    },
    "bench/reference/cache.py": {
        "test_reference.py": {"references of sub-folders' sources": ('folder.rglob("*.py")', 'folder.glob("*.py")')},
    },
    "bench/stress/trial.py": {
        "test_hard_judged.py test_hard.py": {
            "a bound that is not looked at": ('{"<": self.value < self.bound, ">": self.value > self.bound}', '{"<": True, ">": self.value > self.bound}'),
            "rest with a thousand times the force": ("RESIDUAL = 1e-9", "RESIDUAL = 1e-6"),
        },
    },
    "bench/stress/experiment.py": {
        "test_hard.py": {
            "a scene that should be refused passes": ('return outcome("refused", refusal, checks) if refusal else outcome("fail", "was not refused", checks)', 'return outcome("refused", refusal or "", checks)'),
        },
    },
})  # fmt: skip

EXITS = mistakes_of({
    "softlab/cli.py": {
        "test_exits.py": {
            "a diverged run is done": ("if ended := result.diverged or result.incomplete:", "if ended := result.incomplete:"),
            "an incomplete run is done": ("if ended := result.diverged or result.incomplete:", "if ended := result.diverged:"),
        },
    },
    "app/command/command_line.py": {
        "test_exits.py": {"Ctrl-C is what typer makes of it": ("except (KeyboardInterrupt, BrokenPipeError) as error:", "except ZeroDivisionError as error:")},
    },
    "model/base/errors.py": {
        "test_exits.py": {"a backend that is not there is bad input": ("exit_status = 3", "exit_status = 2")},
    },
    "bench/options.py": {
        "test_exits.py": {"what Ctrl-C ended is 1": ("raise typer.Exit(130)", "raise typer.Exit(1)")},
    },
    "bench/stress/experiment.py": {
        "test_exits.py": {"hard cases that fail are done": ("return 1 if failed(summary) else 0", "return 0 if failed(summary) else 0")},
    },
    "bench/advice_commands.py": {
        "test_exits.py": {"no advice is done": ("if advice.best is None:\n            raise typer.Exit(2)", "if advice.best is None:\n            raise typer.Exit(0)")},
    },
})  # fmt: skip

REPORTING = (*FIGURES, *CLAIMS, *RESULTS, *EXITS)
