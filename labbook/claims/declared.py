"""Sentences of the lab book that experiments declare (`Sentence` of bench/measure/declaration.py)."""

from __future__ import annotations

from functools import partial

from softlab.bench.measure.declaration import Experiment, Sentence
from softlab.labbook.claims.claim import Claim, Claims, where
from softlab.plots.core.data import Results
from softlab.plots.core.declared import panels


def claims_of(experiment: Experiment) -> Claims:
    """Return the claims of an experiment by name."""
    return {name: partial(_claim, experiment, sentence) for name, sentence in experiment.sentences.items()}


def _claim(experiment: Experiment, sentence: Sentence, results: Results) -> Claim:
    backends = [(backend, where(backend, source), rows) for backend, source, rows in panels(experiment, results)]
    text, numbers = sentence.of(backends)
    return Claim(text, numbers, bool(numbers))
