"""Claims from declared sentences (`Sentence` of bench/measure/declaration.py): one sentence about each backend."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from softlab.bench.measure.declaration import Experiment, Sentence
from softlab.labbook.claims.claim import Claim, Claims, Maker, where
from softlab.plots.core.backends import on_backends, timed
from softlab.plots.core.data import Results, Source

Selected = TypeVar("Selected", bound=Sequence[object])


def by_backend(select: Callable[[Source, str], Selected], sentence: Sentence) -> Maker:
    """Make the claim of a sentence, on what `select` returns of the first machine that has it, for each backend."""

    def make(results: Results) -> Claim:
        selected = on_backends(results, select)
        text, numbers = sentence.of((backend, where(backend, source), rows) for backend, source, rows in selected)
        return Claim(text, numbers, bool(numbers))

    return make


def claims_of(experiment: Experiment) -> Claims:
    """Return the claims of an experiment by name."""
    select = timed(experiment.rows)
    return Claims({name: by_backend(select, sentence) for name, sentence in experiment.sentences.items()})
